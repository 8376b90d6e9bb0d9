"""What residuals look like over a picture: arrows, their run over the radius, coverage."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.picture_coverage import (
    PictureCoverage,
    RadialProfile,
    evenly_over_picture,
)
from videogrammetry.report.chart import Series, chart
from videogrammetry.report.colours import GREY, PALETTE
from videogrammetry.report.html import escape
from videogrammetry.report.svg import BLUE, EMPTY, LINE, RED, SOFT, drawing, round_down
from videogrammetry.types import FloatArray

_WIDTH = 620.0
#: Arrows in one drawing; more only hide each other and fill the page.
MOST_ARROWS = 4000
#: Rejected observations in one drawing: the largest.
MOST_CROSSES = 400
#: More arrows than this go into one path, without tips.
MOST_TIPS = 700
#: Length of a typical arrow (95th percentile) as a part of the drawing's width.
_ARROW_PART = 0.04
_HEAD = 4.0


def residual_vectors(
    image_size_px: tuple[int, int],
    xy_px: FloatArray,
    residual_px: FloatArray,
    used: npt.NDArray[np.bool_],
    labels: Sequence[str],
    most: int = MOST_ARROWS,
    tips: int = MOST_TIPS,
    crosses: int = MOST_CROSSES,
) -> str:
    """Residuals as magnified arrows from their points; rejected ones red, with a cross.

    Parameters
    ----------
    xy_px, residual_px, used : (N, 2), (N, 2), (N,).
    labels : N names for the tips.
    most : arrows at most, thinned evenly over the picture.
    tips : more arrows than this have no texts. crosses : rejected ones at most, the largest.
    """
    width, height = image_size_px
    scale = _WIDTH / width
    bottom = height * scale + 34
    length = np.hypot(*residual_px.T)
    typical = float(np.percentile(length[used], 95)) if used.any() else 0.0
    magnification = _ARROW_PART * _WIDTH / typical if typical > 0 else 1.0
    # A rejected residual may be very long: it is cut, its number stands in the tip.
    shown = np.minimum(1.0, 6 * typical / np.maximum(length, 1e-300))[:, None] * residual_px
    arrows = shown * magnification
    start = (xy_px + 0.5) * scale
    parts = [
        f'<rect x="0.5" y="0.5" width="{_WIDTH - 1:.1f}" height="{height * scale - 1:.1f}" '
        f'fill="#fbfcfe" stroke="{LINE}"/>',
        f'<path d="{_thirds(_WIDTH, height * scale)}" stroke="{LINE}" stroke-dasharray="2 5"/>',
    ]
    # No arrow leaves the picture; drawings of one size may share the name of their clip.
    frame = f"picture-{height * scale:.1f}"
    parts.append(
        f'<clipPath id="{frame}"><rect width="{_WIDTH:.0f}" height="{height * scale:.1f}"/>'
        f'</clipPath><g clip-path="url(#{frame})">'
    )
    kept = np.flatnonzero(used)
    kept = kept[evenly_over_picture(xy_px[kept], most)]
    if len(kept) > tips:
        path = "".join(_arrow(start[i], arrows[i]) for i in kept.tolist())
        parts.append(f'<path d="{path}" stroke="{BLUE}" stroke-width="0.8" fill="none"/>')
    else:
        for i in kept.tolist():
            x, y = start[i]
            parts.append(_single(start[i], arrows[i], BLUE, 1.1, labels[i], length[i]))
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.3" fill="{BLUE}"/>')
    out = np.flatnonzero(~used)
    for i in out[np.argsort(-length[out])][:crosses].tolist():
        x, y = start[i]
        parts.append(_single(start[i], arrows[i], RED, 1.5, labels[i], length[i]))
        parts.append(
            f'<path d="M{x - 3:.1f} {y - 3:.1f}l6 6m0 -6l-6 6" stroke="{RED}" stroke-width="1.3"/>'
        )
    parts += ["</g>", _scale_bar(magnification, height * scale + 20, typical)]
    return drawing(_WIDTH, bottom, parts, "residual vectors")


def arrows_note(
    used: int, rejected: int, most: int = MOST_ARROWS, crosses: int = MOST_CROSSES
) -> str:
    """What of the observations the drawing leaves out; "" where it has all."""
    words = []
    if used > most:
        words.append(f"{most} of {used} arrows, thinned evenly over the picture")
    if rejected > crosses:
        words.append(f"the largest {crosses} of {rejected} rejected points")
    return f"Shown: {'; '.join(words)}." if words else ""


def _thirds(width: float, height: float) -> str:
    return "".join(
        f"M{k * width / 3:.1f} 0v{height:.1f}M0 {k * height / 3:.1f}h{width:.1f}" for k in (1, 2)
    )


def _arrow(start: FloatArray, arrow: FloatArray) -> str:
    """Shaft and head as a part of a path; a short arrow has a small head."""
    dx, dy = arrow
    size = float(np.hypot(dx, dy))
    text = f"M{start[0]:.1f} {start[1]:.1f}l{dx:.1f} {dy:.1f}"
    if size < 3.0:
        return text
    head = min(_HEAD, 0.4 * size) / size
    # The head's strokes lie at +-25 degrees from the shaft, backwards.
    c, s = 0.906 * head, 0.423 * head
    ax, ay = -c * dx + s * dy, -c * dy - s * dx
    bx, by = -c * dx - s * dy, -c * dy + s * dx
    return f"{text}l{ax:.1f} {ay:.1f}m{bx - ax:.1f} {by - ay:.1f}l{-bx:.1f} {-by:.1f}"


def _single(
    start: FloatArray, arrow: FloatArray, colour: str, width: float, label: str, length: float
) -> str:
    return (
        f'<path d="{_arrow(start, arrow)}" stroke="{colour}" stroke-width="{width}" fill="none">'
        f"<title>{escape(label)}: {length:.3f} px</title></path>"
    )


def _scale_bar(magnification: float, y: float, typical: float) -> str:
    bar_px = round_down(2 * typical if typical > 0 else 1.0)
    length = bar_px * magnification
    return (
        f'<path d="M1 {y - 4:.1f}v8m0 -4h{length:.1f}m0 -4v8" stroke="{SOFT}" fill="none"/>'
        f'<text x="{length + 8:.1f}" y="{y + 4:.1f}">{bar_px:g} px of residual</text>'
        f'<path d="M{_WIDTH - 128:.1f} {y - 3:.1f}l6 6m0 -6l-6 6" stroke="{RED}" '
        f'stroke-width="1.3"/><text x="{_WIDTH - 116:.1f}" y="{y + 4:.1f}">rejected</text>'
        f'<circle cx="{_WIDTH - 52:.1f}" cy="{y:.1f}" r="2" fill="{BLUE}"/>'
        f'<text x="{_WIDTH - 44:.1f}" y="{y + 4:.1f}">used</text>'
    )


def residuals_over_radius(
    radius_px: FloatArray, outward_px: FloatArray, profile: RadialProfile, reach_px: float
) -> str:
    """Residuals along the radius as dots, their mean with its band, and the RMS of the rings.

    Parameters
    ----------
    radius_px, outward_px : of the used observations that are drawn.
    profile : of all used observations. reach_px : from the principal point to the corner.
    """
    known = np.isfinite(profile.rms_px)
    rms = profile.rms_px[known]
    span = float(max(np.percentile(np.abs(outward_px), 98), 1.3 * rms.max(initial=0.0), 1e-9)
                 if len(outward_px) else 1.0)  # fmt: skip
    return chart(
        [
            Series(name="radial part, outwards", x=np.round(radius_px), y=outward_px, line=False,
                   points=True, colour=GREY, radius_px=1.3),
            Series(name="its mean in rings, ±2 std. dev.", x=profile.radius_px[known],
                   y=profile.outward_px[known], sigma=2 * profile.sigma_px[known],
                   colour=PALETTE[1], points=True),
            Series(name="RMS a coordinate", x=profile.radius_px[known], y=rms, colour=PALETTE[0],
                   dashed=True),
        ],
        x_label="distance from the principal point, px",
        y_label="residual, px",
        label="residuals over the radius",
        width=470.0,
        height=250.0,
        x_range=(0.0, reach_px),
        y_range=(-span, span),
        levels=(0.0,),
    )  # fmt: skip


def coverage_map(coverage: PictureCoverage, image_size_px: tuple[int, int]) -> str:
    """Number of used points in each cell, and large in each ninth of the picture."""
    width, height = image_size_px
    drawn_w = 470.0
    drawn_h = drawn_w * height / width
    counts = coverage.cells
    rows, columns = counts.shape
    cell_w, cell_h = drawn_w / columns, drawn_h / rows
    most = max(1, int(counts.max()))
    parts = []
    for (row, column), n in np.ndenumerate(counts):
        x, y = column * cell_w, row * cell_h
        shade = f'{BLUE}" opacity="{0.10 + 0.75 * math.sqrt(n / most):.2f}' if n else EMPTY
        parts.append(
            f'<rect x="{x + 0.5:.1f}" y="{y + 0.5:.1f}" width="{cell_w - 1:.1f}" '
            f'height="{cell_h - 1:.1f}" fill="{shade}"/>'
        )
        ink = "#fff" if n and math.sqrt(n / most) > 0.5 else "#1c2430"
        parts.append(
            f'<text x="{x + cell_w / 2:.1f}" y="{y + cell_h / 2 + 4:.1f}" '
            f'text-anchor="middle" style="fill:{ink}">{n}</text>'
        )
    parts.append(
        f'<path d="{_thirds(drawn_w, drawn_h)}" stroke="#1c2430" stroke-width="1.6" fill="none"/>'
    )
    return drawing(drawn_w, drawn_h, parts, "coverage of the picture")


def coverage_note(coverage: PictureCoverage) -> str:
    """The counts of the ninths in words."""
    text = f"{coverage.share:.0%} of the cells hold points. Ninths (thick lines), row by row: "
    text += "; ".join(" ".join(str(n) for n in row) for row in coverage.ninths.tolist())
    return text + (f". Empty: {', '.join(coverage.empty)}." if coverage.empty else ".")
