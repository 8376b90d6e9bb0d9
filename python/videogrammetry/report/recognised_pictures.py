"""Pictures of some stages and cameras with what was recognised in them: Fig. 14."""

from __future__ import annotations

import base64
import io
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from videogrammetry.report.colours import INK, NIGHT, SOFT
from videogrammetry.report.html import escape
from videogrammetry.report.labels import Labels
from videogrammetry.report.overlay import stretched
from videogrammetry.report.svg import drawing
from videogrammetry.types import FloatArray, IntArray, TargetRecords, Targets

Crop = tuple[int, int, int, int]
_HEAD, _SIDE, _GAP = 24.0, 78.0, 6.0
_HIGHEST = 440.0
_CODED, _NAMED, _NAMELESS = "#40e082", "#5abeff", "#ffa826"
#: A code ring's outer radius over its dot's.
_RING = 3.3


@dataclass(frozen=True)
class _Found:
    """Targets of one picture: ellipses, and the number to write (-1: none)."""

    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    number: IntArray
    coded: npt.NDArray[np.bool_]


def recognised_pictures(
    pictures: Mapping[tuple[int, str], npt.NDArray[Any]],
    targets: TargetRecords | Mapping[tuple[int, str], Targets],
    *,
    stages: Sequence[int],
    camera_names: Sequence[str],
    crops: Mapping[str, Crop] | None = None,
    stage_notes: Mapping[int, str] | None = None,
    width: float = 1130.0,
    jpeg_quality: int = 88,
) -> str:
    """A grid of pictures, a row a stage, a column a camera, targets and IDs drawn sharp.

    Green: a code was read; blue: a number from matching; orange: no number.

    Parameters
    ----------
    pictures : (stage, camera) -> (height, width), uint8 or uint16. A cell
        without a picture stays empty.
    targets : all targets of a measurement (``camera`` is an index into
        ``camera_names``), or those of each picture.
    stages, camera_names : rows and columns.
    crops : camera -> left, top, right, bottom in pixels, right and bottom
        exclusive, the same at all stages; None = around the numbered targets.
    stage_notes : stage -> a few words beside its row.
    width : of the drawing, at most; a cell is never higher than a limit.
    jpeg_quality : of the embedded pictures.
    """
    found = {
        (stage, camera): _found(targets, stage, camera, camera_names)
        for stage in stages
        for camera in camera_names
    }
    cell_w = (width - _SIDE - _GAP * len(camera_names)) / max(1, len(camera_names))
    if not crops:
        crops = _crops(pictures, found, stages, camera_names, cell_w / _HIGHEST)
    ratios = [(c[3] - c[1]) / max(1, c[2] - c[0]) for c in crops.values()]
    cell_h = min(cell_w * max(ratios, default=1.0), _HIGHEST)
    cell_w = min(cell_w, cell_h / min(ratios, default=1.0))
    width = _SIDE + max(1, len(camera_names)) * (cell_w + _GAP)
    parts = []
    for column, camera in enumerate(camera_names):
        x = _SIDE + column * (cell_w + _GAP)
        parts.append(
            f'<text x="{x:.1f}" y="15" style="fill:{INK};font-size:13px;font-weight:600">'
            f"{escape(camera)}</text>"
        )
    for row, stage in enumerate(stages):
        y = _HEAD + row * (cell_h + _GAP)
        parts += _row_head(stage, (stage_notes or {}).get(stage, ""), y)
        for column, camera in enumerate(camera_names):
            x = _SIDE + column * (cell_w + _GAP)
            picture, crop = pictures.get((stage, camera)), crops.get(camera)
            cell = _cell(picture, crop, found[stage, camera], cell_w, cell_h, jpeg_quality)
            parts.append(f'<g transform="translate({x:.1f} {y:.1f})">{cell}</g>')
    height = _HEAD + len(stages) * (cell_h + _GAP) + 22
    parts += _key(_SIDE, height - 8)
    return drawing(
        width, height, parts, f"Recognised targets at stages {', '.join(map(str, stages))}", False
    )


def _row_head(stage: int, note: str, y: float) -> list[str]:
    lines = [
        f'<text x="0" y="{y + 14:.1f}" style="fill:{INK};font-size:13px;font-weight:600">'
        f"stage {stage}</text>"
    ]
    words = [piece for line in note.splitlines() for piece in textwrap.wrap(line, 12)]
    lines += [
        f'<text x="0" y="{y + 30 + 14 * k:.1f}" style="fill:{SOFT}">{escape(line)}</text>'
        for k, line in enumerate(words)
    ]
    return lines


def _found(
    targets: TargetRecords | Mapping[tuple[int, str], Targets],
    stage: int,
    camera: str,
    camera_names: Sequence[str],
) -> _Found:
    if isinstance(targets, TargetRecords):
        mine = (targets.stage == stage) & (targets.camera == list(camera_names).index(camera))
        code = targets.code_id[mine]
        return _Found(
            targets.centre_px[mine],
            targets.semi_axes_px[mine],
            targets.angle_rad[mine],
            np.where(code >= 0, code, targets.point_id[mine]).astype(np.int32),
            code >= 0,
        )
    seen = targets.get((stage, camera))
    if seen is None:
        none = np.zeros((0, 2))
        return _Found(none, none, none[:, 0], np.zeros(0, np.int32), np.zeros(0, bool))
    return _Found(seen.centre_px, seen.semi_axes_px, seen.angle_rad, seen.id, seen.id >= 0)


def _crops(
    pictures: Mapping[tuple[int, str], npt.NDArray[Any]],
    found: Mapping[tuple[int, str], _Found],
    stages: Sequence[int],
    camera_names: Sequence[str],
    narrowest: float,
) -> dict[str, Crop]:
    """Around the numbered targets of all stages, equally large for all cameras.

    ``narrowest``: least width over height, so that tall crops use their cell's width.
    """
    spans: dict[str, tuple[FloatArray, FloatArray]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for camera in camera_names:
        shapes = [pictures[s, camera].shape for s in stages if (s, camera) in pictures]
        if not shapes:
            continue
        sizes[camera] = (shapes[0][1], shapes[0][0])
        seen = [found[s, camera] for s in stages]
        centre = np.concatenate([f.centre_px[f.number >= 0] for f in seen])
        axis = np.concatenate([f.semi_axes_px[f.number >= 0, :1] for f in seen])
        if len(centre):
            margin = 2 * _RING * axis + 12
            spans[camera] = (centre - margin).min(axis=0), (centre + margin).max(axis=0)
        else:
            spans[camera] = np.zeros(2), np.array(sizes[camera], dtype=float)
    if not spans:
        return {}
    size = np.max([high - low for low, high in spans.values()], axis=0)
    size[0] = max(size[0], size[1] * narrowest)
    crops: dict[str, Crop] = {}
    for camera, (low, high) in spans.items():
        limit = np.array(sizes[camera])
        wide = np.minimum(np.ceil(size), limit).astype(int)
        left, top = np.clip(np.rint((low + high - wide) / 2).astype(int), 0, limit - wide).tolist()
        crops[camera] = (left, top, left + int(wide[0]), top + int(wide[1]))
    return crops


def _cell(
    picture: npt.NDArray[Any] | None,
    crop: Crop | None,
    found: _Found,
    width: float,
    height: float,
    jpeg_quality: int,
) -> str:
    """One picture with its targets, in a rectangle from (0, 0)."""
    ground = f'<rect width="{width:.1f}" height="{height:.1f}" rx="4" fill="{NIGHT}"/>'
    if picture is None or crop is None:
        return ground + (
            f'<text x="{width / 2:.1f}" y="{height / 2:.1f}" text-anchor="middle">no picture</text>'
        )
    left, top, right, bottom = crop
    scale = min(width / (right - left), height / (bottom - top))
    wide, high = (right - left) * scale, (bottom - top) * scale
    part = np.ascontiguousarray(picture[top:bottom, left:right])
    image = (
        f'<image width="{wide:.2f}" height="{high:.2f}" preserveAspectRatio="none" '
        f'href="{_jpeg(part, jpeg_quality)}"/>'
    )
    # Pixel (left, top) spans 0 to 1 of the crop: its centre is at one half.
    xy = (found.centre_px - (left, top) + 0.5) * scale
    inside = (xy > 0).all(axis=1) & (xy[:, 0] < wide) & (xy[:, 1] < high)
    return ground + image + _marks(found, xy, np.flatnonzero(inside), scale, (wide, high))


def _marks(
    found: _Found,
    xy: FloatArray,
    shown: npt.NDArray[np.intp],
    scale: float,
    size: tuple[float, float],
) -> str:
    labels = Labels((0, 0, *size), 12.0)
    radii = np.maximum(found.semi_axes_px * scale, 1.5)
    keep = [r[0] * (_RING if c else 1.0) for r, c in zip(radii, found.coded, strict=True)]
    for i in shown:
        labels.take(xy[i, 0], xy[i, 1], float(keep[i]))
    marks, names = [], []
    for i in shown:
        x, y = xy[i]
        colour = _CODED if found.coded[i] else _NAMED if found.number[i] >= 0 else _NAMELESS
        arm = min(4.0, 0.6 * radii[i, 1])
        tip = f"{found.number[i]}: " if found.number[i] >= 0 else ""
        marks.append(
            f'<g stroke="{colour}" stroke-width="1.2" fill="none"><ellipse cx="{x:.2f}" '
            f'cy="{y:.2f}" rx="{radii[i, 0]:.2f}" ry="{radii[i, 1]:.2f}" transform="rotate('
            f'{np.degrees(found.angle_rad[i]):.2f} {x:.2f} {y:.2f})"><title>{tip}'
            f"x {found.centre_px[i, 0]:.3f}, y {found.centre_px[i, 1]:.3f} px</title></ellipse>"
            f'<path d="M{x - arm:.2f} {y:.2f}h{2 * arm:.2f}M{x:.2f} {y - arm:.2f}'
            f'v{2 * arm:.2f}" stroke-width="0.9"/></g>'
        )
        if found.number[i] >= 0:
            halo = f"fill:{colour};paint-order:stroke;stroke:#000;stroke-width:2.6px"
            names.append(labels.place(str(found.number[i]), x, y, float(keep[i]), halo))
    return "".join(marks + names)


def _jpeg(part: npt.NDArray[Any], quality: int) -> str:
    with io.BytesIO() as buffer:
        Image.fromarray(stretched(part)).save(buffer, "JPEG", quality=quality)
        return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _key(x: float, y: float) -> list[str]:
    parts = []
    for colour, text in (
        (_CODED, "code read"),
        (_NAMED, "number from matching"),
        (_NAMELESS, "no number"),
    ):
        parts.append(
            f'<circle cx="{x + 5:.1f}" cy="{y - 4:.1f}" r="4.5" fill="{NIGHT}" stroke="{colour}" '
            f'stroke-width="1.8"/><text x="{x + 15:.1f}" y="{y:.1f}">{text}</text>'
        )
        x += 40 + 6.2 * len(text)
    return parts
