"""Scale bars against each other and against coordinates, before and after the adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.calibration.network_check import bar_name
from videogrammetry.calibration.network_input import NetworkInput, ScaleBars
from videogrammetry.calibration.network_result import BoolArray, NetworkRejection
from videogrammetry.errors import CalibrationError
from videogrammetry.types import FloatArray

#: Start values are good to a few per cent; beyond this a bar's length is a mistake.
GROSS_PART = 0.1
#: Fewer bars than this can contradict each other, but not tell which is wrong.
MIN_TO_JUDGE = 3
#: How near a power of ten a scale must be to look like another unit.
UNIT_PART = 0.1
_UNITS = {1e3: "metres", 1e2: "decimetres", 1e1: "centimetres", 25.4: "inches", 1e-3: "micrometres"}


def unit_hint(scale: float) -> str:
    """What a scale between table and truth suggests.

    Examples
    --------
    >>> unit_hint(1002.0), unit_hint(3.7)
    (': are these metres?', '')
    """
    for factor, unit in _UNITS.items():
        if abs(np.log(scale / factor)) < UNIT_PART:
            return f": are these {unit}?"
    return ""


def bar_lengths(network: NetworkInput, position_mm: FloatArray) -> FloatArray:
    """(B,) distances between the bars' ends."""
    bars = network.scale_bars
    return np.asarray(np.linalg.norm(position_mm[bars.point_a] - position_mm[bars.point_b], axis=1))


def check_bars(
    network: NetworkInput,
) -> tuple[NetworkInput, list[NetworkRejection], list[str]]:
    """Set aside bars that miss the majority's scale by far; compare with known points.

    ``network`` has start values. The least squares that follow would bend the whole
    network to a length that is wrong by a tenth; smaller contradictions are the data
    snooping's to find.

    Raises
    ------
    CalibrationError : two bars, or a majority that does not agree; known points of
        another scale than the bars.
    """
    bars = network.scale_bars
    if not len(bars):
        return network, [], []
    lengths = bar_lengths(network, network.points.position_mm)
    name = [bar_name(network, i) for i in range(len(bars))]
    if (lengths <= 0).any():
        bad = name[int(np.flatnonzero(lengths <= 0)[0])]
        raise CalibrationError(f"scale bar {bad}: both its ends have the same coordinates")
    ratio = bars.length_mm / lengths
    middle = float(np.median(ratio))
    if (network.points.kind != "free").sum() >= 2 and abs(np.log(middle)) > GROSS_PART:
        worst = int(np.abs(np.log(ratio)).argmax())
        raise CalibrationError(
            f"scale bar {name[worst]} is {bars.length_mm[worst]:.6g} mm long, but the fixed or "
            f"weighted points give {lengths[worst]:.6g} mm, {1 / ratio[worst]:.4g} times that"
            f"{unit_hint(middle)} Lengths are in mm; correct the points, or the bar"
        )
    wrong = np.abs(np.log(ratio / middle)) > GROSS_PART
    if not wrong.any() and (len(bars) > 2 or ratio.max() / ratio.min() < 1 + GROSS_PART):
        return network, [], []
    if len(bars) < MIN_TO_JUDGE or 2 * (~wrong).sum() <= len(bars):
        raise CalibrationError(contradiction(network, ratio))
    rejected = [
        NetworkRejection(
            kind="scale-bar",
            value=float(ratio[i] / middle),
            test="ratio",
            image="",
            point=name[i],
            reason=f"its {bars.length_mm[i]:.6g} mm are {ratio[i] / middle:.4g} times what the "
            f"other {int((~wrong).sum())} bars say",
        )
        for i in np.flatnonzero(wrong)
    ]
    warnings = [f"scale bar {r.point} left out: {r.reason}" for r in rejected]
    return replace(network, scale_bars=bars_at(bars, ~wrong)), rejected, warnings


def bars_at(bars: ScaleBars, mask: BoolArray) -> ScaleBars:
    """Some of the bars."""
    certificates = bars.certificate or ("",) * len(bars)
    return ScaleBars(
        point_a=bars.point_a[mask],
        point_b=bars.point_b[mask],
        length_mm=bars.length_mm[mask],
        sigma_mm=bars.sigma_mm[mask],
        certificate=tuple(c for c, keep in zip(certificates, mask, strict=True) if keep),
    )


def contradiction(network: NetworkInput, ratio: FloatArray) -> str:
    """The message of bars none of which can be blamed; ``ratio``: stated over measured."""
    bars = network.scale_bars
    if (network.points.kind != "free").sum() >= 2:
        worst = int(np.abs(np.log(ratio)).argmax())
        return (
            f"the scale bars and the fixed or weighted points contradict each other: bar "
            f"{bar_name(network, worst)} is {bars.length_mm[worst]:.6g} mm long, by the points "
            f"{bars.length_mm[worst] / ratio[worst]:.6g} mm, and nothing tells which is wrong; "
            "check lengths, coordinates and their sigmas"
        )
    low, high = int(ratio.argmin()), int(ratio.argmax())
    return (
        f"the scale bars contradict each other: by {bar_name(network, low)} "
        f"({bars.length_mm[low]:.6g} mm) the object is {ratio[high] / ratio[low] - 1:.3%} smaller "
        f"than by {bar_name(network, high)} ({bars.length_mm[high]:.6g} mm), and {len(bars)} bars "
        "cannot tell which is wrong; check lengths, units and ends, or give a third bar"
    )
