"""A camera's card on the pages of a calibration and an adjustment: figures and parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.picture_coverage import (
    evenly_over_picture,
    outward_px,
    radial_profile,
)
from videogrammetry.calibration.quality import CameraQuality
from videogrammetry.report.correlation_figure import correlation_grid, correlation_words
from videogrammetry.report.html import Cell, count, deviation, escape, figure, number, table
from videogrammetry.report.picture_figures import (
    MOST_ARROWS,
    MOST_CROSSES,
    MOST_TIPS,
    arrows_note,
    coverage_map,
    coverage_note,
    residual_vectors,
    residuals_over_radius,
)
from videogrammetry.report.svg import histogram
from videogrammetry.types import FloatArray

UNITS = {
    **dict(zip(("f", "x0", "y0"), ("px",) * 3, strict=True)),
    "A1": "px⁻²",
    "A2": "px⁻⁴",
    "A3": "px⁻⁶",
    "B1": "px⁻¹",
    "B2": "px⁻¹",
    "time_offset": "intervals",
}
#: Of a page of many cameras all together: arrows, arrows with texts, crosses, dots.
_ARROWS_A_PAGE, _TIPS_A_PAGE, _CROSSES_A_PAGE, _DOTS_A_PAGE = 20_000, 3000, 2000, 6000
_DOTS = 600

CAMERA_STYLE = """
.camera>div{min-width:0}
@media print{.camera{grid-template-columns:minmax(0,1.25fr) minmax(0,1fr)}
figure{break-inside:avoid}.card.camera{break-inside:auto}h2,h3{break-after:avoid}}
"""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A row of the table; ``sigma`` None where it was held; ``why`` in words."""

    name: str
    value: float
    sigma: float | None
    significance: float | None
    why: str


@dataclass(frozen=True, kw_only=True)
class CameraPart:
    """What the card shows.

    Attributes
    ----------
    quality : of the camera. xy_px, residual_px, used, labels : its observations.
    interior : (x0, y0) and ``r0_px``; remark : a few words after the counts.
    cameras : number of cameras on the page: they share its room.
    """

    quality: CameraQuality
    rms_px: float
    xy_px: FloatArray
    residual_px: FloatArray
    used: npt.NDArray[np.bool_]
    labels: Sequence[str]
    interior: tuple[float, float]
    r0_px: float
    parameters: Sequence[Parameter]
    remark: str = ""
    cameras: int = 1


def camera_card(part: CameraPart) -> str:
    """The camera's card."""
    quality = part.quality
    width, height = quality.image_size_px
    heading = (
        f'<h2 class="wide" style="margin:0">{escape(quality.name)}</h2><p class="note wide">'
        f"{width} x {height} px, {len(quality.pictures)} pictures, {count(quality.points)} "
        f"points used, {quality.rejected} rejected, RMS {part.rms_px:.4f} px a coordinate"
        f"{part.remark}</p>"
    )
    most = min(MOST_ARROWS, _ARROWS_A_PAGE // part.cameras)
    tips = min(MOST_TIPS, _TIPS_A_PAGE // part.cameras)
    crosses = min(MOST_CROSSES, _CROSSES_A_PAGE // part.cameras)
    vectors = residual_vectors(
        (width, height), part.xy_px, part.residual_px, part.used, part.labels, most, tips, crosses
    )
    note = arrows_note(quality.points, quality.rejected, most, crosses)
    left = figure("Residuals over the picture", vectors, note)
    left += figure(
        "Correlations of what was estimated",
        correlation_grid(quality.correlations),
        "White 0, red +1, blue -1; rest the pointer on a cell for its number."
        + (
            " rx, ry, rz, tx, ty, tz: the camera's place in the rig."
            if "rx" in quality.correlations.names
            else ""
        ),
    ) + correlation_words(quality.correlations)
    return (
        f'<section class="card camera">{heading}<div>{left}</div><div>{_right(part)}</div>'
        f'<div class="wide"><h3>Parameters</h3>{_parameters(part)}</div></section>\n'
    )


def _right(part: CameraPart) -> str:
    """Histogram, run over the radius, coverage."""
    width, height = part.quality.image_size_px
    centre = np.array([(width - 1) / 2 + part.interior[0], (height - 1) / 2 + part.interior[1]])
    xy, residual = part.xy_px[part.used], part.residual_px[part.used]
    dots = evenly_over_picture(xy, min(_DOTS, _DOTS_A_PAGE // part.cameras))
    from_centre = xy[dots] - centre
    corner = np.hypot(
        np.maximum(centre[0], width - centre[0]), np.maximum(centre[1], height - centre[1])
    )
    radial = residuals_over_radius(
        np.hypot(*from_centre.T),
        outward_px(from_centre, residual[dots]),
        radial_profile(xy, residual, centre),
        float(corner),
    )
    return (
        figure(
            "Residuals, both coordinates",
            histogram(part.residual_px, part.used),
            "Line: normal distribution of the same RMS.",
        )
        + figure(
            "Residuals over the radius",
            radial,
            "A mean that leaves zero by more than its band: the lens model misses something.",
        )
        + figure(
            "Points used in each part of the picture",
            coverage_map(part.quality.coverage, (width, height)),
            coverage_note(part.quality.coverage),
            style="narrow",
        )
    )


def _parameters(part: CameraPart) -> str:
    rows: list[list[str | Cell]] = []
    styles = []
    for one in part.parameters:
        held = one.sigma is None
        rows.append(
            [
                one.name,
                number(one.value, one.sigma),
                "" if one.sigma is None else deviation(one.sigma),
                UNITS.get(one.name, ""),
                _times(one.significance),
                Cell(one.why, "why"),
            ]
        )
        styles.append("off" if held else "")
    header: list[str | Cell] = [
        "",
        "value",
        "std. dev.",
        "unit",
        "value / std. dev.",
        Cell("", "l"),
    ]
    note = f'<p class="note">r0 = {number(part.r0_px)} px, held fixed.</p>'
    return table(header, rows, styles) + note


def _times(ratio: float | None) -> str:
    if ratio is None or not math.isfinite(ratio):
        return ""
    return f"{ratio:.1f}" if ratio < 100 else count(round(ratio))
