"""From an adjusted network to its tables, with everything a posteriori."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from videogrammetry.adjustment import Adjustment, Dispersion
from videogrammetry.calibration.network_bars import bar_lengths
from videogrammetry.calibration.network_build import Built, start_values
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_result import (
    AdjustedBars,
    AdjustedCamera,
    AdjustedImages,
    AdjustedObservations,
    AdjustedPoints,
    DroppedUnknown,
    NetworkAdjustment,
    NetworkRejection,
    NetworkSummary,
)
from videogrammetry.types import INTERIOR_NAMES, FloatArray

CAMERA_UNKNOWNS = (*INTERIOR_NAMES, "aspect", "time_offset")
#: Normal quantile of a power of 80 %: with the critical value, the non-centrality delta0.
POWER_80 = 0.8416212335729143
#: The critical value behind the reliability where no test is made.
DEFAULT_CRITICAL_VALUE = 3.29
#: The covariance of so many points is 72 MB; of more, only each point's own is kept.
MAX_FULL_COVARIANCE = 1000
#: Below this redundancy number an observation is not controlled at all.
UNCONTROLLED = 1e-6


def network_outcome(
    tables: NetworkInput,
    built: Built,
    adjustment: Adjustment,
    dispersion: Dispersion,
    rejected: Sequence[NetworkRejection],
    warnings: Sequence[str],
) -> NetworkAdjustment:
    """The result's tables."""
    sigma0 = adjustment.sigma0
    observations = _observations(tables, adjustment)
    images = _images(tables, built, adjustment, dispersion)
    bars = _bars(tables, built, adjustment)
    lines = [
        *rejected,
        *_rejected_observations(tables, observations),
        *_rejected_bars(tables, bars),
        *_rejected_priors(tables, adjustment),
        *_dropped(tables, adjustment),
    ]
    used = observations.used
    return NetworkAdjustment(
        cameras=tuple(
            _camera(tables, built, adjustment, dispersion, index)
            for index in range(len(tables.cameras))
        ),
        images=images,
        points=_points(tables, built, adjustment, dispersion),
        observations=observations,
        scale_bars=bars,
        rejected=tuple(lines),
        warnings=tuple(dict.fromkeys(warnings)),
        summary=NetworkSummary(
            observations=adjustment.num_observations + adjustment.num_prior,
            image_coordinates=adjustment.num_observations,
            unknowns=adjustment.num_unknowns,
            redundancy=adjustment.redundancy,
            sigma0=sigma0,
            sigma0_px=sigma0 * tables.sigma_px,
            sigma_px=tables.sigma_px,
            rms_px=_rms(observations.residual_px[used]),
            images=len(images),
            points=len(tables.points),
            datum=tables.datum,
            rounds=adjustment.rounds,
            converged=adjustment.converged,
        ),
        known_factor=adjustment.point_factor if adjustment.point_redundancy > 0 else None,
        known_redundancy=adjustment.point_redundancy,
    )


def _rms(residual: FloatArray) -> float:
    return float(np.sqrt(np.mean(residual**2))) if residual.size else 0.0


def _observations(tables: NetworkInput, adjustment: Adjustment) -> AdjustedObservations:
    """Residuals with reliability.

    delta0 = critical value + 0.84 is the non-centrality that the test finds with 80 %
    power; an error of delta0 sigma / sqrt(r) is the smallest so found (Baarda's inner
    reliability), and it moves the unknowns by up to delta0 sqrt((1 - r) / r) of their
    standard deviations (outer reliability).
    """
    seen = tables.observations
    sigma = np.sqrt(seen.cov_px2[:, [0, 2]])
    r = np.clip(adjustment.redundancy_numbers, 0.0, 1.0)
    delta0 = (tables.critical_value or DEFAULT_CRITICAL_VALUE) + POWER_80
    with np.errstate(divide="ignore"):
        controlled = np.where(r > UNCONTROLLED, r, np.nan)
        detectable = delta0 * adjustment.sigma0 * sigma / np.sqrt(controlled)
        external = delta0 * np.sqrt((1.0 - controlled) / controlled)
    return AdjustedObservations(
        image=seen.image,
        point=seen.point,
        xy_px=seen.xy_px,
        sigma_px=sigma,
        residual_px=adjustment.residual_px,
        normalised=adjustment.normalised / adjustment.sigma0,
        redundancy=r,
        detectable_px=detectable,
        external=external,
        used=adjustment.used,
    )


def _camera(
    tables: NetworkInput,
    built: Built,
    adjustment: Adjustment,
    dispersion: Dispersion,
    index: int,
) -> AdjustedCamera:
    camera = tables.cameras[index]
    values = built.network.camera_unknowns(index)
    places = dispersion.camera_index[index]
    free = [k for k in range(len(CAMERA_UNKNOWNS)) if places[k] >= 0]
    cov = adjustment.sigma0**2 * dispersion.cov[np.ix_(places[free], places[free])]
    sigma = np.zeros(len(CAMERA_UNKNOWNS))
    sigma[free] = np.sqrt(np.diag(cov))
    start = start_values(built.given[index], camera)
    tested = [k for k in free if k >= 3]
    mine = (
        adjustment.used
        & np.array([i.camera == index for i in tables.images])[tables.observations.image]
    )
    return AdjustedCamera(
        name=camera.name,
        image_size_px=camera.image_size_px,
        r0_px=camera.r0_px,
        measured=camera.measured,
        values=dict(zip(CAMERA_UNKNOWNS, map(float, values), strict=True)),
        sigma=dict(zip(CAMERA_UNKNOWNS, map(float, sigma), strict=True)),
        free=tuple(CAMERA_UNKNOWNS[k] for k in free),
        cov=cov,
        significance={
            CAMERA_UNKNOWNS[k]: float(abs(values[k] - start[k]) / sigma[k]) for k in tested
        },
        dropped=tuple(
            DroppedUnknown(name=d.name, value=d.value, sigma=d.sigma, undetermined=d.undetermined)
            for d in adjustment.dropped
            if d.camera == index
        ),
        num_images=len(np.unique(tables.observations.image[mine])),
        num_points=int(mine.sum()),
        rms_px=_rms(adjustment.residual_px[mine]),
    )


def _images(
    tables: NetworkInput, built: Built, adjustment: Adjustment, dispersion: Dispersion
) -> AdjustedImages:
    count = len(tables.images)
    rotation, translation = np.empty((count, 3, 3)), np.empty((count, 3))
    cov, cov_centre = np.zeros((count, 6, 6)), np.zeros((count, 3, 3))
    for i, pose in enumerate(built.poses):
        rotation[i], translation[i] = built.network.pose(pose)
        place = int(dispersion.pose_index[pose])
        if place >= 0:
            block = slice(place, place + 6)
            cov[i] = adjustment.sigma0**2 * dispersion.cov[block, block]
        # Centre -R't; R <- exp([w]) R moves it by -R'[t] w, t by -R'.
        jacobian = -rotation[i].T @ np.hstack([_cross(translation[i]), np.eye(3)])
        cov_centre[i] = jacobian @ cov[i] @ jacobian.T
    used = adjustment.used
    of = tables.observations.image
    return AdjustedImages(
        name=tuple(i.name for i in tables.images),
        camera=np.array([i.camera for i in tables.images], np.int32),
        rotation=rotation,
        translation_mm=translation,
        cov=cov,
        centre_mm=-np.einsum("nji,nj->ni", rotation, translation),
        cov_centre_mm2=cov_centre,
        points=np.bincount(of[used], minlength=count).astype(np.int32),
        rms_px=_rms_by(of, adjustment, count),
    )


def _cross(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _rms_by(group: np.ndarray, adjustment: Adjustment, count: int) -> FloatArray:
    """RMS of the used residuals per coordinate of each picture or point; 0 of none."""
    used = adjustment.used
    squares = (adjustment.residual_px[used] ** 2).mean(axis=1)
    number = np.bincount(group[used], minlength=count)
    total = np.bincount(group[used], weights=squares, minlength=count)
    return np.asarray(np.sqrt(total / np.maximum(number, 1)))


def _points(
    tables: NetworkInput, built: Built, adjustment: Adjustment, dispersion: Dispersion
) -> AdjustedPoints:
    points = tables.points
    n = len(points)
    factor = adjustment.sigma0**2
    full = factor * dispersion.point_covariance(np.arange(n)) if n <= MAX_FULL_COVARIANCE else None
    of, used = tables.observations.point, adjustment.used
    return AdjustedPoints(
        name=points.name,
        position_mm=built.network.positions_mm,
        cov_mm2=factor * dispersion.point_cov_mm2,
        full_cov_mm2=full,
        kind=points.kind,
        images=np.bincount(of[used], minlength=n).astype(np.int32),
        rms_px=_rms_by(of, adjustment, n),
        normal=points.normal,
        diameter_mm=points.diameter_mm,
    )


def _bars(tables: NetworkInput, built: Built, adjustment: Adjustment) -> AdjustedBars:
    bars, result = tables.scale_bars, adjustment.scale_bars
    lengths = bar_lengths(tables, built.network.positions_mm)
    return AdjustedBars(
        point_a=bars.point_a,
        point_b=bars.point_b,
        length_mm=bars.length_mm,
        sigma_mm=bars.sigma_mm,
        residual_mm=bars.length_mm - lengths,
        normalised=result.normalised / adjustment.sigma0,
        redundancy=result.redundancy,
        used=result.used,
        certificate=bars.certificate or ("",) * len(bars),
    )


def _rejected_observations(
    tables: NetworkInput, table: AdjustedObservations
) -> list[NetworkRejection]:
    """A line for each image point left out, the largest first."""
    w = np.abs(table.normalised).max(axis=1, initial=0.0)
    w = np.where(np.isfinite(w), w, np.inf)
    out = np.flatnonzero(~table.used)
    lines = []
    for i in out[np.argsort(-w[out], kind="stable")]:
        size = float(np.hypot(*table.residual_px[i]))
        lines.append(
            NetworkRejection(
                kind="observation",
                value=float(w[i]),
                test="tau",
                image=tables.images[table.image[i]].name,
                point=tables.points.name[table.point[i]],
                reason=f"misses the others by {size:.2f} px, {w[i]:.1f} of its standard deviations",
            )
        )
    return lines


def _rejected_bars(tables: NetworkInput, bars: AdjustedBars) -> list[NetworkRejection]:
    return [
        NetworkRejection(
            kind="scale-bar",
            value=float(abs(bars.normalised[i])),
            test="tau",
            image="",
            point=f"{tables.points.name[bars.point_a[i]]}-{tables.points.name[bars.point_b[i]]}",
            reason=f"its {bars.length_mm[i]:.6g} mm are {bars.residual_mm[i]:+.4g} mm off the "
            f"others, {abs(bars.normalised[i]):.1f} standard deviations",
        )
        for i in np.flatnonzero(~bars.used)
    ]


def _rejected_priors(tables: NetworkInput, adjustment: Adjustment) -> list[NetworkRejection]:
    """Weighted points whose stated coordinates do not fit."""
    prior = adjustment.points
    weighted = tables.points.kind == "weighted"
    out = np.flatnonzero(weighted & ~prior.used)
    return [
        NetworkRejection(
            kind="point",
            value=float(prior.test[i]),
            test="tau",
            image="",
            point=tables.points.name[i],
            reason="its stated coordinates miss the pictures by "
            f"{np.linalg.norm(prior.residual_mm[i]):.4g} mm; it was determined by these alone",
        )
        for i in out
    ]


def _dropped(tables: NetworkInput, adjustment: Adjustment) -> list[NetworkRejection]:
    lines = []
    for d in adjustment.dropped:
        ratio = abs(d.value) / d.sigma if d.sigma > 0 else np.inf
        lines.append(
            NetworkRejection(
                kind="parameter",
                value=float(ratio),
                test="undetermined" if d.undetermined else "significance",
                image="",
                point="",
                reason=f"camera {tables.cameras[d.camera].name}: {d.name} is not determined by the "
                f"pictures (sigma {d.sigma:.3g})"
                if d.undetermined
                else f"camera {tables.cameras[d.camera].name}: {d.name} = {d.value:.3g} is "
                f"{ratio:.1f} times its standard deviation",
            )
        )
    return lines
