"""Figures of the falling object: the way of its centroid and the free fall.

Numbers come from the caller; here they are only drawn, apart from components
along the scene's axes and differences against a given truth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.report.chart import Marker, Series, chart
from videogrammetry.report.colours import GREY, INK, PALETTE, SOFT
from videogrammetry.report.html import Figure
from videogrammetry.report.space import Scene, row_of_stage
from videogrammetry.types import FloatArray, Measurement, matrix_from_cov6

#: The paper's line of the free fall: -g t^2 / 2 over the measured displacement.
PAPER_FALL_SLOPE, PAPER_FALL_OFFSET_MM = 1.0188, 0.9643

_FALL_LABEL = "measured vertical displacement x, mm"
_COMPONENTS = ("right", "up", "away")
_HISTORY_NOTES = {
    "displacement": "In free fall the component up is a parabola.",
    "velocity": "In free fall the component up is a straight line of slope \u2212g; central "
    "differences, undefined at both ends.",
}
_COLOURS = (PALETTE[0], PALETTE[1], PALETTE[2], INK)
_HALF, _TALL = 560.0, 300.0
#: A band narrower than this part of the largest value cannot be seen.
_VISIBLE_SIGMA = 0.005


@dataclass(frozen=True, kw_only=True)
class CentroidTruth:
    """What a simulation knows of the centroid, at the measurement's stages.

    Attributes
    ----------
    position_mm : (S, 3) in the measurement's frame, of the same points as
        ``Motion.centroid_points``.
    velocity_mm_s : (S, 3) or None.
    """

    position_mm: FloatArray
    velocity_mm_s: FloatArray | None = None


def trajectory_figures(
    measurement: Measurement,
    *,
    scene: Scene | None = None,
    truth: CentroidTruth | None = None,
    markers: Sequence[tuple[int, str]] = (),
) -> list[Figure]:
    """The centroid's trajectory, displacement and speed: the paper's Fig. 16.

    Parameters
    ----------
    measurement : what ``measure`` found.
    scene : what is up and away; a level camera's frame where None.
    truth : thin dashed lines, and two charts more: the errors with their sigma.
    markers : stages with a word each, such as (116, "impact").

    Raises
    ------
    ValueError
        If a marker's stage was not measured.
    """
    scene = scene or Scene()
    axes, motion = scene.axes(), measurement.motion
    time, unit = _time(measurement)
    rows = [(row_of_stage(measurement.trajectories.stage, s), word) for s, word in markers]
    lines = [Marker(float(time[row]), word) for row, word in rows]
    reference = row_of_stage(measurement.trajectories.stage, motion.reference_stage)
    moved = _components(motion.centroid_displacement_mm, axes)
    sigma = _sigmas(motion.centroid_displacement_cov_mm2, axes, moved)
    speed = _components(motion.centroid_velocity_mm_s, axes)
    speed_sigma = _sigmas(motion.centroid_velocity_cov_mm2_s2, axes, speed)
    true_moved = true_speed = None
    if truth is not None:
        true_moved = _components(truth.position_mm - truth.position_mm[reference], axes)
        if truth.velocity_mm_s is not None:
            true_speed = _components(truth.velocity_mm_s, axes)
    x_label = f"time, {unit}" if unit == "ms" else unit
    figures = [_path_figure(moved, true_moved, rows, scene)]
    for name, y_unit, values, sigmas, true in (
        ("displacement", "mm", moved, sigma, true_moved),
        ("velocity", "m/s", speed / 1e3, speed_sigma / 1e3, _scaled(true_speed, 1e-3)),
    ):
        figures.append(_history(name, y_unit, time, x_label, values, sigmas, true, lines))
    for name, y_unit, values, sigmas, true in (
        ("displacement", "mm", moved, sigma, true_moved),
        ("velocity", "mm/s", speed, speed_sigma, true_speed),
    ):
        if true is not None:
            figures.append(_errors(name, y_unit, time, x_label, values - true, sigmas, lines))
    return figures


def _time(measurement: Measurement) -> tuple[FloatArray, str]:
    """Times in ms, or stages where there is no frame rate."""
    table = measurement.trajectories
    if np.isfinite(table.time_s).all():
        return table.time_s * 1e3, "ms"
    return table.stage.astype(float), "stage"


def _scaled(values: FloatArray | None, factor: float) -> FloatArray | None:
    return None if values is None else np.asarray(values * factor)


def _components(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    """(S, 4): to the right, up, away, and the length."""
    turned = np.asarray(vectors, dtype=float) @ axes.T
    return np.concatenate([turned, np.linalg.norm(turned, axis=1, keepdims=True)], axis=1)


def _sigmas(cov6: FloatArray, axes: FloatArray, values: FloatArray) -> FloatArray:
    """(S, 4) standard deviations along the axes and along the vector itself."""
    turned = axes @ matrix_from_cov6(cov6) @ axes.T
    own = values[:, :3] / np.maximum(values[:, 3:], 1e-12)
    along = np.einsum("si,sij,sj->s", own, turned, own)
    variances = np.concatenate([np.einsum("sii->si", turned), along[:, None]], axis=1)
    sigmas: FloatArray = np.sqrt(np.maximum(variances, 0.0))
    return sigmas


def _path_figure(
    moved: FloatArray,
    true: FloatArray | None,
    rows: Sequence[tuple[int, str]],
    scene: Scene,
) -> Figure:
    """The trajectory in the planes of the front and of the right view, side by side."""
    drawn = []
    for index, name in ((0, "to the right"), (2, "away from camera 1")):
        series = [
            Series(name="measured", x=moved[:, index], y=moved[:, 1], points=True, radius_px=1.8)
        ]
        if true is not None:
            series.append(
                Series(
                    name="truth",
                    x=true[:, index],
                    y=true[:, 1],
                    colour=INK,
                    dashed=True,
                    width_px=1.0,
                )
            )
        for row, word in rows:
            series.append(
                Series(
                    name=word,
                    x=moved[row : row + 1, index],
                    y=moved[row : row + 1, 1],
                    line=False,
                    points=True,
                    radius_px=5,
                )
            )
        drawn.append(
            chart(
                series,
                x_label=f"{name}, mm",
                y_label="up, mm",
                label=f"Trajectory of the centroid, {name} and up",
                width=_HALF / 2,
                height=590,
                equal_aspect=True,
            )
        )
    return Figure(
        "Trajectory of the centroid",
        f'<div class="two">{"".join(drawn)}</div>',
        "Displacement of the points' mean: left in the front view, right seen from the right; "
        "both axes on one scale.",
    )


def _history(
    name: str,
    unit: str,
    time: FloatArray,
    x_label: str,
    values: FloatArray,
    sigmas: FloatArray,
    true: FloatArray | None,
    markers: Sequence[Marker],
) -> Figure:
    """Components and length over time."""
    known = np.abs(values[np.isfinite(values)])
    widest = np.where(np.isfinite(sigmas), sigmas, 0.0).max(initial=0.0)
    visible = widest > _VISIBLE_SIGMA * known.max(initial=0.0)
    series = [
        Series(
            name=word,
            x=time,
            y=values[:, k],
            sigma=sigmas[:, k] if visible else None,
            colour=colour,
            width_px=wide,
        )
        for k, (word, colour, wide) in enumerate(
            zip((*_COMPONENTS, "magnitude"), _COLOURS, (1.7, 1.7, 1.7, 2.2), strict=True)
        )
    ]
    if true is not None:
        series += [
            Series(
                name="truth" if k == 0 else "",
                x=time,
                y=true[:, k],
                colour="#000",
                dashed=True,
                width_px=0.9,
            )
            for k in range(3)
        ]
    return Figure(
        f"{name.capitalize()} of the centroid",
        chart(
            series,
            x_label=x_label,
            y_label=f"{name}, {unit}",
            width=_HALF,
            height=_TALL,
            markers=markers,
        ),
        _HISTORY_NOTES[name] + (" Bands: \u00b1 sigma." if visible else ""),
    )


def _errors(
    name: str,
    unit: str,
    time: FloatArray,
    x_label: str,
    errors: FloatArray,
    sigmas: FloatArray,
    markers: Sequence[Marker],
) -> Figure:
    """Measured less true, over the predicted band of +-sigma about zero."""
    largest = sigmas[:, :3].max(axis=1)
    series = [
        Series(
            name="\u00b1 largest predicted sigma",
            x=time,
            y=np.where(np.isfinite(largest), 0.0, np.nan),
            sigma=largest,
            colour=SOFT,
            width_px=0.6,
        )
    ]
    series += [
        Series(name=word, x=time, y=errors[:, k], colour=_COLOURS[k], width_px=1.2)
        for k, word in enumerate(_COMPONENTS)
    ]
    return Figure(
        f"Error of the {name}",
        chart(
            series,
            x_label=x_label,
            y_label=f"measured \u2212 true, {unit}",
            label=f"Error of the {name} of the centroid",
            width=_HALF,
            height=_TALL - 40,
            markers=markers,
        ),
        "Measured less true. Where the prediction is right, about two of three values of each "
        "line lie within the band.",
    )


def free_fall_figure(
    measured_mm: npt.ArrayLike,
    theoretical_mm: npt.ArrayLike,
    slope: float,
    offset_mm: float,
    *,
    sigma_mm: npt.ArrayLike | None = None,
    slope_sigma: float | None = None,
    offset_sigma_mm: float | None = None,
    paper: bool = True,
) -> list[Figure]:
    """Theory over measurement of a free fall with its line: the paper's Fig. 17.

    Parameters
    ----------
    measured_mm : (N,) vertical displacement, up positive (so falls are negative).
    theoretical_mm : (N,) -g t^2 / 2 at the same stages.
    slope, offset_mm : of the line theoretical = slope * measured + offset.
    sigma_mm : (N,) standard deviations of the measured, for the residuals' bars.
    slope_sigma, offset_sigma_mm : of the line.
    paper : draws the paper's line, 1.0188 x + 0.9643, for comparison.
    """
    x, y = np.asarray(measured_mm, dtype=float), np.asarray(theoretical_mm, dtype=float)
    seen = np.isfinite(x) & np.isfinite(y)
    ends = np.array([x[seen].min(), x[seen].max()]) if seen.any() else np.array([np.nan, np.nan])
    equation = f"y = {_plus_minus(slope, slope_sigma, 5)} x {_signed(offset_mm, offset_sigma_mm)}"
    series = [
        Series(name="measured", x=x, y=y, line=False, points=True, radius_px=2.6),
        Series(name=equation, x=ends, y=slope * ends + offset_mm, colour=PALETTE[1]),
    ]
    if paper:
        line = PAPER_FALL_SLOPE * ends + PAPER_FALL_OFFSET_MM
        named = f"paper: y = {PAPER_FALL_SLOPE} x + {PAPER_FALL_OFFSET_MM}"
        series.append(Series(name=named, x=ends, y=line, colour=GREY, dashed=True))
    deviation = 100 * (1 - 1 / slope)  # slope 1.0188: falls measured 1.85 % short
    size = "short" if deviation > 0 else "long"
    doubt = "" if slope_sigma is None else f" \u00b1 {100 * slope_sigma:.1g}"
    return [
        Figure(
            "Free fall: theory over measurement",
            chart(
                series,
                x_label=_FALL_LABEL,
                y_label="y = \u2212g t\u00b2/2, mm",
                width=_HALF,
                height=360,
            ),
            f"A slope of one is the truth; the measured falls are {abs(deviation):.2g}{doubt} % "
            f"too {size} (paper: 1.85 % too short).",
        ),
        _fall_residuals(x, y - (slope * x + offset_mm), sigma_mm),
    ]


def _fall_residuals(x: FloatArray, rest: FloatArray, sigma_mm: npt.ArrayLike | None) -> Figure:
    known = rest[np.isfinite(rest)]
    name = f"RMS {np.sqrt(np.mean(known**2)):.3f} mm" if len(known) else ""
    series = Series(
        name=name,
        x=x,
        y=rest,
        line=False,
        points=True,
        radius_px=2.2,
        sigma=sigma_mm,
    )
    return Figure(
        "What the line leaves",
        chart(
            [series],
            x_label=_FALL_LABEL,
            y_label="y \u2212 line, mm",
            label="Residuals of the free fall's line",
            width=_HALF,
            height=360,
        ),
        "Without a trend the fall is a parabola to this level."
        + ("" if sigma_mm is None else " Bars: \u00b1 predicted sigma."),
    )


def _plus_minus(value: float, sigma: float | None, places: int) -> str:
    if sigma is None or not math.isfinite(sigma):
        return f"{value:.{places}f}"
    return f"({value:.{places}f} \u00b1 {sigma:.{places}f})"


def _signed(value: float, sigma: float | None) -> str:
    sign = "+" if value >= 0 else "\u2212"
    return f"{sign} {_plus_minus(abs(value), sigma, 3)} mm"
