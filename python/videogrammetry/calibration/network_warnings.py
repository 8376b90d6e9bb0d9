"""What a user should doubt in the adjustment of a network."""

from __future__ import annotations

import numpy as np

from videogrammetry.adjustment import Adjustment, AdjustOptions, Dispersion, principal_extents
from videogrammetry.calibration.network_build import Built
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.types import INTERIOR_NAMES

#: The w-test at its usual level loses one good observation in a thousand; look beyond this.
LOOK_REJECTED_PART = 0.05
#: Normalised residuals beyond this are no chance: one good one in a million.
LOOK_NORMALISED = 5.0
#: A stated sigma this many times off misweighs image points against lengths.
LOOK_SIGMA_RATIO = 2.0
#: Two parameters as alike as this can hardly be told apart.
LOOK_CORRELATION = 0.99
#: Objects flatter than this part of their extent are planes to the cameras.
FLAT_PART = 0.01
#: Tolerable standard deviation of f, as a part of f.
LOOK_F_PART = 0.002
#: Whoever photographs smaller objects than this (mm) knows it; others gave metres.
SMALL_OBJECT_MM = 10.0


def doubts(
    tables: NetworkInput,
    built: Built,
    adjustment: Adjustment,
    dispersion: Dispersion,
    scale_given: bool,
) -> list[str]:
    """Warnings, each with what causes it and what helps."""
    return [
        *_of_fit(tables, adjustment),
        *_of_cameras(tables, built, adjustment, dispersion),
        *_of_scale(tables, built, scale_given),
    ]


def _of_fit(tables: NetworkInput, adjustment: Adjustment) -> list[str]:
    warnings = []
    if adjustment.rounds >= AdjustOptions.max_rounds:
        warnings.append(
            f"rejections still changed after {adjustment.rounds} adjustments; the last ones stand"
        )
    part = 1.0 - float(adjustment.used.mean())
    if part > LOOK_REJECTED_PART:
        warnings.append(
            f"{part:.0%} of the image points were rejected, where one in a hundred is usual: the "
            "model does not fit (are too few camera parameters free?), or points are named wrongly"
        )
    ratio = adjustment.sigma0
    known = tables.points.kind != "free"
    enough = adjustment.redundancy > 20
    if enough and not 1 / LOOK_SIGMA_RATIO < ratio < LOOK_SIGMA_RATIO:
        weights = (
            "; image points are weighted wrongly against scale bars and known points: set sigma_px"
            if len(tables.scale_bars) or known.any()
            else ""
        )
        warnings.append(
            f"sigma0 = {ratio:.3g}: the image points scatter by {ratio * tables.sigma_px:.3g} px "
            f"where {tables.sigma_px:.3g} px was stated{weights}"
        )
    bars = adjustment.scale_bars
    warnings += _not_tested(tables, adjustment)
    for i in np.flatnonzero(~bars.used):
        a, b = tables.scale_bars.point_a[i], tables.scale_bars.point_b[i]
        warnings.append(
            f"scale bar {tables.points.name[a]}-{tables.points.name[b]} contradicts the others by "
            f"{abs(bars.residual_mm[i]):.4g} mm and was left out: check its length and its ends"
        )
    return warnings


def _not_tested(tables: NetworkInput, adjustment: Adjustment) -> list[str]:
    """Contradictions that stay in the result because no data snooping was asked for."""
    if tables.critical_value > 0 or not adjustment.sigma0 > 0:
        return []
    warnings = []
    bars, names = adjustment.scale_bars, tables.points.name
    w = np.abs(bars.normalised) / adjustment.sigma0
    for i in np.flatnonzero(bars.used & (w > LOOK_NORMALISED)):
        a, b = tables.scale_bars.point_a[i], tables.scale_bars.point_b[i]
        warnings.append(
            f"scale bar {names[a]}-{names[b]} contradicts the rest ({w[i]:.1f} standard "
            "deviations) and takes part, for snooping = false: check lengths, ends and known points"
        )
    w = np.abs(adjustment.normalised).max(axis=1, initial=0.0) / adjustment.sigma0
    large = np.flatnonzero(adjustment.used & (w > LOOK_NORMALISED))
    if len(large):
        seen, worst = tables.observations, int(large[w[large].argmax()])
        warnings.append(
            f"{len(large)} image points miss the others by more than {LOOK_NORMALISED:g} standard "
            f"deviations and take part, for snooping = false; most ({w[worst]:.1f}) point "
            f"{names[seen.point[worst]]} in {tables.images[seen.image[worst]].name}"
        )
    return warnings


def _of_cameras(
    tables: NetworkInput, built: Built, adjustment: Adjustment, dispersion: Dispersion
) -> list[str]:
    warnings = []
    flat = float(principal_extents(built.network.positions_mm)[2]) < FLAT_PART
    for index, camera in enumerate(tables.cameras):
        for d in adjustment.dropped:
            if d.camera == index and d.undetermined:
                why = ": all points lie in a plane, seen with hardly a tilt" if flat else ""
                warnings.append(
                    f"camera {camera.name}: {d.name} is not determined by these pictures (sigma "
                    f"{d.sigma:.3g}) and is held at its start value{why}"
                )
        warnings += _weak_focal(tables, built, adjustment, dispersion, index, flat)
        warnings += _alike(camera.name, index, dispersion)
    return warnings


def _weak_focal(
    tables: NetworkInput,
    built: Built,
    adjustment: Adjustment,
    dispersion: Dispersion,
    index: int,
    flat: bool,
) -> list[str]:
    """f against the distance from the object: of a plane seen square they are one unknown."""
    place = int(dispersion.camera_index[index][0])
    if place < 0:
        return []
    f = float(built.network.camera_unknowns(index)[0])
    sigma = adjustment.sigma0 * float(np.sqrt(dispersion.cov[place, place]))
    if sigma < LOOK_F_PART * f:
        return []
    name = tables.cameras[index].name
    if flat:
        return [
            f"camera {name}: all points lie in a plane and the pictures are hardly tilted, so that "
            f"f ({f:.1f} px, sigma {sigma:.2g}) and the distance can hardly be told apart: tilt "
            "the camera by 30 degrees and more, turn it by 90 degrees in some, or give f a "
            "sigma"
        ]
    return [
        f"camera {name}: f ({f:.1f} px) is weakly determined (sigma {sigma:.2g} px): take pictures "
        "from nearer and with more depth in the object, or give f a sigma"
    ]


def _alike(name: str, index: int, dispersion: Dispersion) -> list[str]:
    """Interior parameters that the pictures cannot tell apart, the radial ones excepted."""
    places = dispersion.camera_index[index]
    names = (*INTERIOR_NAMES, "aspect", "time_offset")
    free = [k for k in range(len(places)) if places[k] >= 0]
    sigma = np.sqrt(np.diag(dispersion.cov))
    pairs = []
    for i, a in enumerate(free):
        for b in free[i + 1 :]:
            if names[a][0] == names[b][0] == "A":  # powers of one radius are always alike
                continue
            pa, pb = int(places[a]), int(places[b])
            r = dispersion.cov[pa, pb] / (sigma[pa] * sigma[pb])
            if abs(r) > LOOK_CORRELATION:
                pairs.append(f"{names[a]} and {names[b]} ({r:+.3f})")
    if not pairs:
        return []
    return [
        f"camera {name}: highly correlated: {', '.join(pairs)}; use them only together, free "
        "fewer, or turn the camera by 90 degrees about its axis in some pictures"
    ]


def _of_scale(tables: NetworkInput, built: Built, scale_given: bool) -> list[str]:
    positions = built.network.positions_mm
    extent = float(np.ptp(positions, axis=0).max())
    if not scale_given:
        return [
            "no scale bar and no known point gives the scale: lengths are those of the start "
            "values, and their standard deviations hold for ratios of lengths alone"
        ]
    if extent < SMALL_OBJECT_MM:
        return [
            f"the object is {extent:.3g} mm long: if that is not so, points or scale bars are in "
            "other units than millimetres"
        ]
    return []
