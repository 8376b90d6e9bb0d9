"""Adjustment of a photogrammetric network: tables in, tables out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.adjustment import Adjustment, AdjustOptions, Dispersion
from videogrammetry.calibration.network_bars import (
    MIN_TO_JUDGE,
    bar_lengths,
    check_bars,
    contradiction,
)
from videogrammetry.calibration.network_build import (
    Built,
    build_network,
    offered_names,
)
from videogrammetry.calibration.network_check import check_network
from videogrammetry.calibration.network_frame_start import check_start_values, on_start_values
from videogrammetry.calibration.network_input import NetworkCamera, NetworkInput
from videogrammetry.calibration.network_outcome import network_outcome
from videogrammetry.calibration.network_result import (
    BoolArray,
    NetworkAdjustment,
    NetworkOptions,
    NetworkRejection,
)
from videogrammetry.calibration.network_start import start_network
from videogrammetry.calibration.network_warnings import doubts
from videogrammetry.errors import CalibrationError


@dataclass(frozen=True, kw_only=True)
class Solved:
    """An adjusted network with the tables it was made of."""

    tables: NetworkInput
    built: Built
    adjustment: Adjustment
    dispersion: Dispersion


def adjust_network(
    network: NetworkInput, options: NetworkOptions | None = None
) -> NetworkAdjustment:
    """Adjust pictures, points and cameras of a network together.

    The bundle of the collinearity equations (Hu et al. 2012, Eqs. 1-5): every image
    point is the picture of its object point, plus a residual of the stated standard
    deviation; a scale bar observes the distance of two points, a weighted point its
    coordinates. Start values that are not given are found (``start_network``). Then
    a robust start, least squares, data snooping (Pope's test, with the sigma0 that the
    residuals give, at the level of the critical value) and, of cameras with
    ``free = None``, a test of the distortion parameters, until nothing changes.

    Parameters
    ----------
    network : the tables. What cannot take part (points in one picture, pictures of
        too few points, pictures without a link to the others) is left out and listed.
    options : see :class:`NetworkOptions`.

    Raises
    ------
    CalibrationError
        The tables do not determine the unknowns, or contradict each other: what,
        where, and what to do.
    ValueError
        Arrays of wrong shape, not finite, indices out of range.

    References
    ----------
    Baarda 1968; Pope 1976; Luhmann et al., Close-Range Photogrammetry, sec. 2.4, 4.4.
    """
    options = options or NetworkOptions()
    checked = check_network(network)
    rejected, warnings = list(checked.rejected), list(checked.warnings)
    started = _started(checked.network, rejected, warnings)
    started, bad_bars, remarks = check_bars(started)
    rejected += bad_bars
    warnings += remarks
    solved = _solve(started, network.cameras, options)
    _check(solved)
    warnings += solved.built.warnings
    warnings += doubts(
        solved.tables, solved.built, solved.adjustment, solved.dispersion, _scale_given(network)
    )
    return network_outcome(
        solved.tables, solved.built, solved.adjustment, solved.dispersion, rejected, warnings
    )


def _scale_given(network: NetworkInput) -> bool:
    return len(network.scale_bars) > 0 or network.datum != "free"


def _started(
    network: NetworkInput, rejected: list[NetworkRejection], warnings: list[str]
) -> NetworkInput:
    """The network with start values; what found none is left out."""
    start = start_network(network, partial=True)
    started = on_start_values(start.network, network)
    # The start has a scale of its own only where the table gives no coordinates.
    scaled = started is not start.network
    warnings += [d for d in start.report.doubts if not (scaled and "scale is unknown" in d)]
    warnings += check_start_values(started, network)
    reasons = dict(start.report.left_out)
    placed = np.asarray(np.isfinite(started.points.position_mm).all(axis=1))
    posed = np.array([i.rotation is not None for i in started.images], bool)
    seen = started.observations
    good = np.asarray(posed[seen.image] & placed[seen.point], bool)
    if good.all():
        return started
    lost = [started.images[i].name for i in np.flatnonzero(~posed)]
    if lost:
        warnings.append(
            f"{len(lost)} pictures could not be oriented and are left out: {', '.join(lost[:8])}; "
            "they share too few points with the others, or their points are named wrongly"
        )
    for name in lost:
        reason = reasons.get(name, "in a group of pictures that nothing ties to the largest")
        rejected.append(_left_out("image", name, "", reason))
    for i in np.flatnonzero(~placed):
        reason = "no position was found: its rays do not meet, or are parallel"
        rejected.append(_left_out("point", "", started.points.name[i], reason))
    again = check_network(_at(started, good))
    rejected += again.rejected
    warnings += again.warnings
    return again.network


def _left_out(kind: str, image: str, point: str, reason: str) -> NetworkRejection:
    return NetworkRejection(
        kind=kind, value=0.0, test="start", image=image, point=point, reason=reason
    )


def _at(network: NetworkInput, rows: BoolArray) -> NetworkInput:
    """The network of some of its observations."""
    seen = network.observations
    return replace(
        network,
        observations=replace(
            seen,
            image=seen.image[rows],
            point=seen.point[rows],
            xy_px=seen.xy_px[rows],
            cov_px2=seen.cov_px2[rows],
        ),
    )


def _solve(tables: NetworkInput, given: Sequence[NetworkCamera], options: NetworkOptions) -> Solved:
    """The adjustment, its tests made with a noise that the residuals confirm."""
    offered = offered_names(tables)
    adjust = AdjustOptions(
        critical_value=tables.critical_value,
        estimate_floor=options.estimate_floor,
        robust_start=options.robust_start,
        significance=options.significance if any(offered) else 0.0,
        num_threads=options.num_threads,
        baarda=False,
    )
    built = build_network(tables, given, eccentricity=options.eccentricity)
    network = built.network
    try:
        adjustment = network.adjust(adjust, offered)
    except CalibrationError as error:
        raise CalibrationError(f"{error}. {_too_much_is_free(tables)}") from error
    return Solved(
        tables=tables,
        built=built,
        adjustment=adjustment,
        dispersion=network.dispersion(),
    )


def _too_much_is_free(tables: NetworkInput) -> str:
    seen = tables.observations
    known = int((tables.points.kind[np.unique(seen.point)] != "free").sum())
    return (
        f"There are {len(seen)} image points of {len(np.unique(seen.point))} points ({known} of "
        f"them fixed or weighted) in {len(tables.images)} pictures: take more pictures, tilted and "
        "turned about the camera's axis, free fewer of the camera's parameters, or give more "
        "points of known position"
    )


def _check(solved: Solved) -> None:
    adjustment, tables = solved.adjustment, solved.tables
    if not adjustment.converged:
        raise CalibrationError(
            f"the adjustment does not converge ({adjustment.message.strip()}): free fewer "
            "parameters of the cameras, give start values (f_px, points, poses), or look for "
            "points under wrong names"
        )
    seen = tables.observations
    for index, camera in enumerate(tables.cameras):
        mine = np.array([i.camera == index for i in tables.images])[seen.image]
        if mine.any() and adjustment.used[mine].mean() < 0.5:
            raise CalibrationError(
                f"camera {camera.name}: only {adjustment.used[mine].mean():.0%} of its "
                f"{int(mine.sum())} image points agree with the others; are the points named "
                "alike in all pictures, and is image_size_px right?"
            )
    for dropped in adjustment.dropped:
        camera = solved.built.given[dropped.camera]
        if dropped.undetermined and dropped.name == "f" and not np.isfinite(camera.interior[0]):
            raise CalibrationError(
                f"camera {camera.name}: the pictures do not determine f; give f_px, or tilt the "
                "camera by 30 degrees and more in some pictures"
            )
    bars = adjustment.scale_bars
    used = int(bars.used.sum())
    if (
        len(bars.used)
        and not bars.used.all()
        and 2 * used <= len(bars.used) + (used < MIN_TO_JUDGE - 1)
    ):
        lengths = bar_lengths(tables, solved.built.network.positions_mm)
        raise CalibrationError(contradiction(tables, tables.scale_bars.length_mm / lengths))


__all__ = [
    "NetworkAdjustment",
    "NetworkOptions",
    "adjust_network",
]
