"""The calibration's report: one HTML page that works offline, its drawings inline.

Shows what the calculation found; nothing is estimated here. Counts and means of
residuals are formed for display only.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from typing import Any

import numpy as np

from videogrammetry.calibration.advice import advise
from videogrammetry.calibration.quality import CameraQuality
from videogrammetry.calibration.quality_of import quality_of_run
from videogrammetry.calibration.run import CalibrationRun
from videogrammetry.geometry import vector_from_rotation
from videogrammetry.report.camera_part import CAMERA_STYLE, CameraPart, Parameter, camera_card
from videogrammetry.report.cutouts import CUTOUT_STYLE
from videogrammetry.report.html import Cell, count, escape, facts, page, table
from videogrammetry.report.quality_part import (
    QUALITY_STYLE,
    advice_card,
    angles_table,
    bars_table,
    components_table,
    reliability_table,
)
from videogrammetry.report.space_view import SPACE_VIEW_STYLE, space_view_script
from videogrammetry.report.station_view import STATION_STYLE
from videogrammetry.report.target_view import StagePictures, target_cutouts, target_positions
from videogrammetry.types import INTERIOR_NAMES, FloatArray

#: Residuals of a camera beyond this many times the median camera's: look closer.
LOOK_RMS_RATIO = 2.0

_MOST_REJECTIONS = 300
_MOST_PAIRS_OF = 6


def calibration_report(
    run: CalibrationRun, title: str = "", pictures: StagePictures | None = None
) -> str:
    """The page as text.

    Parameters
    ----------
    run : what ``calibrate`` gave.
    title : the project's name.
    pictures : camera and stage -> grey values (height, width), or None where there is no
        picture; for cut-outs around the worst observations.
    """
    quality = quality_of_run(run)
    name = title or "Camera calibration"
    body = (
        f"<header><h1>{escape(name)}</h1>"
        f'<p class="sub">Calibration of {len(run.camera_names)} cameras, method '
        f"{escape(run.method)}; frame of {escape(run.rig.reference or 'the first camera')}</p>"
        "</header>\n"
        + _verdict(run)
        + _summary(run)
        + advice_card(advise(quality))
        + "<h2>Cameras</h2>\n"
        + "".join(_camera(run, camera, i) for i, camera in enumerate(quality.cameras))
        + f'<h2>Where the target was</h2><div class="card">{target_positions(run)}'
        + f"{angles_table(quality)}</div>\n"
        + _poses(run)
        + f'<h2>Reliability and weights</h2><div class="card">{reliability_table(quality)}'
        + f"{components_table(quality.components)}</div>\n"
        + bars_table(run.bars, [str(number) for number in run.target.id])
        + _pictures(run)
        + _rejected(run, pictures)
        + _provenance(run)
        + space_view_script()
    )
    style = SPACE_VIEW_STYLE + STATION_STYLE + CAMERA_STYLE + QUALITY_STYLE + CUTOUT_STYLE
    return page(f"{name}: calibration", body, style)


def _camera(run: CalibrationRun, quality: CameraQuality, index: int) -> str:
    """A camera's card."""
    name, seen = run.camera_names[index], run.observations
    camera = run.rig.cameras[name]
    mine = np.flatnonzero(seen.camera == index)
    labels = [
        f"{run.image_names.get((name, int(s)), f'stage {s}')}, point {p}"
        for s, p in zip(seen.stage[mine], seen.point_id[mine], strict=True)
    ]
    floor = run.rig.sigma_floor_px.get(name)
    kept = run.parameters_kept[name]
    parameters = []
    for value, parameter in zip(camera.interior.tolist(), INTERIOR_NAMES, strict=True):
        estimated = parameter in kept
        sigma = camera.sigma.get(parameter) if estimated else None
        parameters.append(
            Parameter(
                name=parameter, value=value, sigma=sigma,
                significance=abs(value) / sigma if sigma else None,
                why="estimated" if estimated else _why_not(run, name, parameter),
            )
        )  # fmt: skip
    offset = run.rig.how.get("time_offset_stages", {}).get(name)
    if offset is not None:
        late = run.rig.how["sigma_time_offset_stages"][name]
        parameters.append(
            Parameter(
                name="time_offset", value=offset, sigma=late or None,
                significance=abs(offset) / late if late else None,
                why="estimated: how late the camera is" if late else "the clock",
            )
        )  # fmt: skip
    return camera_card(
        CameraPart(
            quality=quality, rms_px=run.camera_rms_px[name], xy_px=seen.xy_px[mine],
            residual_px=seen.residual_px[mine], used=seen.used[mine], labels=labels,
            interior=(float(camera.interior[1]), float(camera.interior[2])), r0_px=camera.r0_px,
            parameters=parameters, cameras=len(run.camera_names),
            remark="" if floor is None else f", lens and flatness add {floor:.3f} px",
        )
    )  # fmt: skip


def _why_not(run: CalibrationRun, camera: str, parameter: str) -> str:
    for item in run.rejected:
        mine = item.kind == "parameter" and item.camera in (camera, "")
        if mine and (item.image == parameter or re.search(rf"\b{parameter}\b", item.reason)):
            return f"left out: {item.reason}"
    return "held at its start value"


def _verdict(run: CalibrationRun) -> str:
    """One sentence on the whole, and what to look at."""
    points = len(run.observations)
    rejected = int((~run.observations.used).sum())
    reasons = list(run.warnings)
    middle = float(np.median(list(run.camera_rms_px.values())))
    reasons += [
        f"camera {name}: residuals {rms / middle:.1f} times the median's"
        for name, rms in run.camera_rms_px.items()
        if rms > LOOK_RMS_RATIO * middle
    ]
    head = (
        f"Re-projection {run.rms_px:.4f} px RMS a coordinate; "
        f"{100 * rejected / max(1, points):.1f} % of {count(points)} points rejected."
    )
    if not reasons:
        return (
            f'<div class="card verdict"><b>Nothing stands out.</b><p>{head} All cameras fit '
            "alike.</p></div>\n"
        )
    items = "".join(f"<li>{escape(reason)}</li>" for reason in reasons)
    return (
        f'<div class="card verdict look"><b>Look closer.</b><p>{head}</p><ul>{items}</ul></div>\n'
    )


def _summary(run: CalibrationRun) -> str:
    pictures = {
        (c, s)
        for c, s, u in zip(
            run.observations.camera, run.observations.stage, run.observations.used, strict=True
        )
        if u
    }
    more = run.additional
    beside = {} if more is None else {f"points beside the target ({more.mode})": count(len(more))}
    return facts(
        {
            "RMS residual, px": f"{run.rms_px:.4f}",
            "sigma0 a posteriori": f"{run.sigma0:.3f}",
            "pictures": count(len(pictures)),
            "target positions": count(len(run.rig_from_target)),
            "observations": count(run.num_observations),
            "unknowns": count(run.num_unknowns),
            "redundancy": count(run.redundancy),
            "points rejected": count(int((~run.observations.used).sum())),
            **beside,
        }
    )


def _poses(run: CalibrationRun) -> str:
    """Where the cameras stand, and how far from one another."""
    rows = []
    for name in run.camera_names:
        camera = run.rig.cameras[name]
        angles = np.degrees(vector_from_rotation(camera.rotation))
        rows.append(
            [
                name,
                *(f"{v:.3f}" for v in camera.centre_mm),
                *(f"{v:.4f}" for v in angles),
                _sigmas(camera.sigma, ("tx", "ty", "tz"), 1.0, ".3f"),
                _sigmas(camera.sigma, ("rx", "ry", "rz"), 180 / math.pi, ".4f"),
            ]
        )
    header = ["camera", "X mm", "Y mm", "Z mm", "rot. x °", "rot. y °", "rot. z °"]
    header += ["s.d. translation mm", "s.d. rotation °"]
    note = (
        '<p class="note">Projection centres in the rig\'s frame; rotation vector of '
        "cam_from_world, and the standard deviations of that transform.</p>"
    )
    return (
        f'<h2>Where the cameras stand</h2><div class="card">{table(header, rows)}{note}'
        f"{_baselines(run)}</div>\n"
    )


def _baselines(run: CalibrationRun) -> str:
    """Distances and angles of the axes: all pairs of a few cameras, else from the first."""
    names = run.camera_names
    firsts = names if len(names) <= _MOST_PAIRS_OF else names[:1]
    rows = []
    for k, first in enumerate(firsts):
        for second in names[k + 1 :]:
            a, b = run.rig.cameras[first], run.rig.cameras[second]
            baseline = math.dist(a.centre_mm, b.centre_mm)
            axes = a.rotation[2], b.rotation[2]
            rows.append([f"{first}, {second}", f"{baseline:.3f}", f"{_angle_deg(*axes):.2f}"])
    if not rows:
        return ""
    header = ["cameras", "baseline mm", "angle of their axes °"]
    return f'<div style="max-width:460px;margin-top:14px">{table(header, rows)}</div>'


def _sigmas(sigma: Any, names: tuple[str, ...], factor: float, form: str) -> str:
    if not any(sigma.get(name) for name in names):
        return "fixed"
    return " ".join(format(sigma.get(name, 0.0) * factor, form) for name in names)


def _angle_deg(a: FloatArray, b: FloatArray) -> float:
    return math.degrees(math.atan2(math.hypot(*np.cross(a, b)), float(a @ b)))


def _pictures(run: CalibrationRun) -> str:
    """RMS and number of points of each picture, one row a stage."""
    seen = run.observations
    stages = np.unique(seen.stage)
    length2 = (seen.residual_px**2).sum(axis=1) / 2
    typical = max(run.rms_px, 1e-12)
    rows = []
    for stage in stages:
        row: list[str | Cell] = [str(stage)]
        for camera in range(len(run.camera_names)):
            mine = (seen.camera == camera) & (seen.stage == stage)
            good = mine & seen.used
            if not good.any():
                row.append(Cell("-" if not mine.any() else "rejected", "bad" if mine.any() else ""))
                continue
            rms = math.sqrt(float(length2[good].mean()))
            warm = min(1.0, max(0.0, (rms / typical - 1) / 1.5))
            off = int((mine & ~seen.used).sum())
            text = f"{rms:.4f} ({int(good.sum())}{f', {off} off' if off else ''})"
            row.append(Cell(text, background=f"rgba(227,159,31,{0.55 * warm:.2f})" if warm else ""))
        rows.append(row)
    body = table(["stage", *run.camera_names], rows)
    note = '<p class="note">RMS px a coordinate (points used, points rejected).</p>'
    return (
        f'<h2>Pictures</h2><div class="card"><details{" open" if len(stages) <= 30 else ""}>'
        f"<summary>{len(stages)} target positions</summary>{body}{note}</details></div>\n"
    )


def _rejected(run: CalibrationRun, pictures: StagePictures | None) -> str:
    """What was measured and not used, and why."""
    items = [item for item in run.rejected if item.kind != "parameter"]
    if not items:
        return '<h2>Rejected</h2><div class="card">Nothing was rejected.</div>\n'
    kinds = Counter(item.kind for item in items)
    # Whole pictures first, then points, the worst at the top.
    items.sort(key=lambda item: (item.kind == "observation", item.kind, -abs(item.value)))
    rows: list[list[str | Cell]] = [
        [
            item.kind.replace("-", " "),
            Cell(item.camera, "l"),
            Cell(item.image, "l"),
            "" if item.point_id is None else str(item.point_id),
            f"{item.value:.3g}" if math.isfinite(item.value) else "",
            Cell("w" if item.kind == "observation" else "", "l"),
            Cell(item.reason, "why"),
        ]
        for item in items[:_MOST_REJECTIONS]
    ]
    heads: list[str | Cell] = [
        "what",
        Cell("camera", "l"),
        Cell("picture", "l"),
        "point",
        "value",
        Cell("test", "l"),
        Cell("why", "l"),
    ]
    total = ", ".join(
        f"{n} {kind.replace('-', ' ')}{'s' if n > 1 else ''}" for kind, n in kinds.items()
    )
    rest = len(items) - len(rows)
    note = f'<p class="note">and {count(rest)} more</p>' if rest else ""
    return (
        f'<h2>Rejected</h2><div class="card">{target_cutouts(run, pictures)}'
        f"<details{' open' if len(items) <= 40 else ''}>"
        f"<summary>{escape(total)}</summary>{table(heads, rows)}{note}</details></div>\n"
    )


def _provenance(run: CalibrationRun) -> str:
    how = run.rig.how
    origin = how.get("provenance", how)
    main = [("program", f"{origin.get('program', '')} {origin.get('version', '')}".strip())]
    main += [("time", str(origin.get("time_utc", ""))), ("calculation", f"{run.seconds:.2f} s")]
    rows: list[list[str | Cell]] = [[name, Cell(value, "l")] for name, value in main if value]
    details = json.dumps(dict(how), indent=1, ensure_ascii=False, default=str)
    return (
        f'<h2>How it was made</h2><div class="card">{table(["", ""], rows)}<details><summary>'
        f"Options and inputs</summary><pre>{escape(details)}</pre></details></div>\n"
    )
