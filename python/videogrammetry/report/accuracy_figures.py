"""Figures of a scale bar's errors and of an object's deformation."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from PIL import Image

from videogrammetry.report.axes import Axes, tick_labels, ticks
from videogrammetry.report.chart import Marker, Series, chart
from videogrammetry.report.colours import GREY, INK, PALETTE, diverging_of, diverging_rgb
from videogrammetry.report.html import Figure, escape
from videogrammetry.report.svg import drawing
from videogrammetry.types import FloatArray

#: The paper's eleven lengths of a moving scale bar less its certificate.
PAPER_SCALE_BAR_ERRORS_MM = (
    0.279, 0.309, 0.257, 0.279, 0.367, 0.388, 0.545, 0.348, -0.113, -0.102, -0.170,
)  # fmt: skip
_HALF, _WIDE = 560.0, 1130.0


def scale_bar_figure(
    error_mm: npt.ArrayLike,
    sigma_mm: npt.ArrayLike,
    *,
    sigma_calibration_mm: npt.ArrayLike | None = None,
    speed_mm_s: npt.ArrayLike | None = None,
    limit_mm: float | None = None,
    paper: bool = True,
) -> list[Figure]:
    """Errors of a scale bar's length against the position's number and its speed.

    Parameters
    ----------
    error_mm : (N,) measured less certified length, NaN = not measured.
    sigma_mm : (N,) predicted standard deviations: image noise and calibration.
    sigma_calibration_mm : (N,) the calibration's part, a darker bar.
    speed_mm_s : (N,) of the bar's middle; None = no second figure.
    limit_mm : thin lines at +- this, such as the stated largest error.
    paper : the paper's eleven errors as grey dots behind.
    """
    error = np.asarray(error_mm, dtype=float)
    number = np.arange(1, len(error) + 1)
    tips = [f"position {k}: {e:+.3f} mm" for k, e in zip(number, error, strict=True)]
    name = "this run, \u00b1 predicted sigma"
    name += " (dark: calibration alone)" if sigma_calibration_mm is not None else ""

    def measured(x: npt.ArrayLike) -> Series:
        return Series(
            name=name,
            x=x,
            y=error,
            line=False,
            points=True,
            radius_px=4,
            sigma=sigma_mm,
            sigma_inner=sigma_calibration_mm,
            tips=tips,
        )

    levels = () if limit_mm is None else (-limit_mm, limit_mm)
    printed = np.array(PAPER_SCALE_BAR_ERRORS_MM)
    theirs = Series(
        name="paper",
        x=np.arange(1, len(printed) + 1),
        y=printed,
        colour=GREY,
        line=False,
        points=True,
        radius_px=3.4,
        tips=[f"paper, position {k + 1}: {e:+.3f} mm" for k, e in enumerate(printed)],
    )
    drawn = [theirs, measured(number)] if paper else [measured(number)]
    count = max(len(error), len(printed) if paper else 0, 1)
    figures = [
        Figure(
            "Scale bar: error of each position",
            chart(
                drawn,
                x_label="position",
                y_label="measured \u2212 certified, mm",
                label="Error of the scale bar's length at each position",
                width=_HALF,
                height=330,
                x_range=(0.4, count + 0.6),
                levels=levels,
            ),
            "A mean other than zero points to the scale, a slope over the speed to the "
            "cameras' synchronism."
            if speed_mm_s is not None
            else "",
        )
    ]
    if speed_mm_s is not None:
        speed = np.asarray(speed_mm_s, dtype=float) / 1e3
        figures.append(
            Figure(
                "Scale bar: error over speed",
                chart(
                    [measured(speed)],
                    x_label="speed of the bar, m/s",
                    y_label="measured \u2212 certified, mm",
                    label="Error of the scale bar's length over its speed",
                    width=_HALF,
                    height=330,
                    levels=levels,
                ),
            )
        )
    return figures


def deformation_figure(
    radial_change_mm: npt.ArrayLike,
    point_id: Sequence[int],
    *,
    time_ms: npt.ArrayLike | None = None,
    stage: Sequence[int] | None = None,
    markers: Sequence[Marker] = (),
    largest_mm: float | None = None,
) -> list[Figure]:
    """Change of each point's distance from the centroid: a map, and as lines.

    Parameters
    ----------
    radial_change_mm : (S, P) distance less that of the reference, NaN = unknown.
    point_id : (P,) in the order of the rows, from the top.
    time_ms, stage : (S,) along the axis: times, or stages, or 1 to S.
    markers : vertical lines at values of that axis.
    largest_mm : at the end of the colours; None: the largest there is.
    """
    change = np.atleast_2d(np.asarray(radial_change_mm, dtype=float))
    if time_ms is not None:
        x, x_label = np.asarray(time_ms, dtype=float), "time, ms"
    else:
        number = stage if stage is not None else range(1, len(change) + 1)
        x, x_label = np.asarray(list(number), dtype=float), "stage"
    known = np.isfinite(change)
    largest = largest_mm or (float(np.abs(change[known]).max()) if known.any() else 1.0) or 1.0
    return [
        Figure(
            "Deformation: change of each point's distance from the centroid",
            _map(change, point_id, x, x_label, markers, largest),
            "Each row is a point. Blue: nearer to the centroid than at the reference stage, "
            "red: farther; grey: not measured. Where a column has both colours the object is "
            "out of round.",
        ),
        Figure(
            "The same as lines",
            _lines(change, point_id, x, x_label, markers),
            "In colour the points with the largest shortening and lengthening; in grey the others.",
        ),
    ]


def _map(
    change: FloatArray,
    point_id: Sequence[int],
    x: FloatArray,
    x_label: str,
    markers: Sequence[Marker],
    largest: float,
) -> str:
    """The map as a picture of one pixel a value, axes and colours around it."""
    rows = max(1, len(point_id))
    row_height = min(18.0, max(4.0, 330.0 / rows))
    half = (x[1] - x[0]) / 2 if len(x) > 1 else 0.5
    axes = Axes(
        left=64,
        top=22,
        width=_WIDE - 64 - 96,
        height=rows * row_height,
        x_range=(float(x[0] - half), float(x[-1] + half)) if len(x) else (0.0, 1.0),
        y_range=(0.0, float(rows)),
    )
    bottom = axes.top + axes.height
    parts = [
        f'<image x="{axes.left}" y="{axes.top}" width="{axes.width}" height="{axes.height:.1f}" '
        f'preserveAspectRatio="none" style="image-rendering:pixelated" '
        f'href="{_png(change, largest)}"/>'
        if change.size
        else ""
    ]
    every = max(1, round(11 / row_height + 0.4))
    for k, number in enumerate(point_id):
        if k % every == 0:
            y = axes.top + (k + 0.5) * row_height + 4
            parts.append(
                f'<text x="{axes.left - 7:.1f}" y="{y:.1f}" text-anchor="end">{number}</text>'
            )
    x_ticks = ticks(*axes.x_range, 12)
    for value, text in zip(x_ticks, tick_labels(x_ticks), strict=True):
        at = float(axes.x(value))
        parts.append(
            f'<path d="M{at:.1f} {bottom:.1f}v4" stroke="{INK}"/><text x="{at:.1f}" '
            f'y="{bottom + 16:.1f}" text-anchor="middle">{text}</text>'
        )
    for marker in markers:
        at = float(axes.x(marker.x))
        parts.append(
            f'<path d="M{at:.1f} {axes.top - 4:.1f}V{bottom:.1f}" stroke="{INK}" '
            f'stroke-dasharray="3 3"/><text x="{at:.1f}" y="{axes.top - 8:.1f}" '
            f'text-anchor="middle" style="fill:{INK}">{escape(marker.label)}</text>'
        )
    parts.append(
        f'<text x="{axes.left + axes.width / 2:.1f}" y="{bottom + 34:.1f}" text-anchor="middle" '
        f'style="fill:{INK}">{x_label}</text><text transform="translate(14 '
        f'{axes.top + axes.height / 2:.1f}) rotate(-90)" text-anchor="middle" '
        f'style="fill:{INK}">point</text>'
    )
    parts += _diverging_bar(_WIDE - 74, axes.top, axes.height, largest)
    return drawing(_WIDE, bottom + 40, parts, "Deformation of the object over the stages")


def _png(change: FloatArray, largest: float) -> str:
    known = np.isfinite(change)
    rgb = diverging_rgb(np.where(known, change, 0.0) / largest)
    rgb[~known] = (208, 213, 220)
    picture = np.rint(rgb).astype(np.uint8).transpose(1, 0, 2)
    with io.BytesIO() as buffer:
        Image.fromarray(np.ascontiguousarray(picture)).save(buffer, "PNG")
        return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _diverging_bar(left: float, top: float, height: float, largest: float) -> list[str]:
    steps = 40
    parts = [
        f'<rect x="{left:.1f}" y="{top + k * height / steps:.2f}" width="12" '
        f'height="{height / steps + 0.4:.2f}" fill="{diverging_of(1 - 2 * (k + 0.5) / steps)}"/>'
        for k in range(steps)
    ]
    for share, y in ((1, top + 8), (0, top + height / 2 + 4), (-1, top + height)):
        text = f"{share * largest:+.3g}".replace("-", "\u2212") if share else "0"
        text += " mm" if share == 1 else ""
        parts.append(f'<text x="{left + 17:.1f}" y="{y:.1f}">{text}</text>')
    return parts


def _lines(
    change: FloatArray,
    point_id: Sequence[int],
    x: FloatArray,
    x_label: str,
    markers: Sequence[Marker],
) -> str:
    known = np.isfinite(change).any(axis=0)
    shortest = np.where(known, np.where(np.isfinite(change), change, np.inf).min(axis=0), np.inf)
    longest = np.where(known, np.where(np.isfinite(change), change, -np.inf).max(axis=0), -np.inf)
    chosen = {}
    if known.any():
        chosen = {int(np.argmax(longest)): PALETTE[6], int(np.argmin(shortest)): PALETTE[0]}
    others = [k for k in range(change.shape[1]) if k not in chosen]
    series = [
        Series(
            name="other points" if k == others[0] else "",
            x=x,
            y=change[:, k],
            colour=GREY,
            width_px=0.8,
        )
        for k in others
    ]
    series += [
        Series(name=f"point {point_id[k]}", x=x, y=change[:, k], colour=colour, width_px=2.0)
        for k, colour in chosen.items()
    ]
    return chart(
        series,
        x_label=x_label,
        y_label="change of distance, mm",
        label="Change of the points' distances from the centroid",
        width=_WIDE,
        height=280,
        markers=markers,
    )
