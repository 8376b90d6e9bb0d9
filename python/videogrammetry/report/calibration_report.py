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

from videogrammetry.calibration.run import CalibrationRun
from videogrammetry.geometry import vector_from_rotation
from videogrammetry.report.html import (
    Cell,
    count,
    deviation,
    escape,
    facts,
    figure,
    number,
    page,
    table,
)
from videogrammetry.report.svg import coverage, histogram, residual_vectors
from videogrammetry.types import INTERIOR_NAMES, FloatArray

UNITS = ("px", "px", "px", "px⁻²", "px⁻⁴", "px⁻⁶", "px⁻¹", "px⁻¹", "", "")
#: Beyond these a reader should look closer; they decide nothing.
LOOK_REJECTED_PART = 0.05
LOOK_COVERAGE_PART = 0.5
LOOK_PICTURES = 8
LOOK_RMS_RATIO = 2.0

_MOST_REJECTIONS = 300
_MOST_PAIRS_OF = 6


def calibration_report(run: CalibrationRun, title: str = "") -> str:
    """The page as text.

    Parameters
    ----------
    run : what ``calibrate`` gave.
    title : the project's name.
    """
    sections = [_Camera(run, index) for index in range(len(run.camera_names))]
    name = title or "Camera calibration"
    body = (
        f"<header><h1>{escape(name)}</h1>"
        f'<p class="sub">Calibration of {len(run.camera_names)} cameras, method '
        f"{escape(run.method)}; frame of {escape(run.rig.reference or 'the first camera')}</p>"
        "</header>\n"
        + _verdict(run, sections)
        + _summary(run)
        + "<h2>Cameras</h2>\n"
        + "".join(section.html() for section in sections)
        + _poses(run)
        + _pictures(run)
        + _rejected(run)
        + _provenance(run)
    )
    return page(f"{name}: calibration", body)


class _Camera:
    """What the page says of one camera."""

    def __init__(self, run: CalibrationRun, index: int) -> None:
        table_of_all = run.observations
        mine = np.flatnonzero(table_of_all.camera == index)
        self.name = run.camera_names[index]
        self._run = run
        self._camera = run.rig.cameras[self.name]
        self._xy = table_of_all.xy_px[mine]
        self._residual = table_of_all.residual_px[mine]
        self._used = table_of_all.used[mine]
        self._stage = table_of_all.stage[mine]
        self._point = table_of_all.point_id[mine]
        self.pictures = len(np.unique(self._stage[self._used]))
        self.rms_px = run.camera_rms_px[self.name]
        width, height = self._camera.image_size_px
        cells = (8, max(1, round(8 * height / width)))
        self._coverage, self.covered = coverage(
            self._camera.image_size_px, self._xy, self._used, cells
        )

    def html(self) -> str:
        """The camera's card."""
        names = self._run.image_names
        labels = [
            f"{names.get((self.name, int(s)), f'stage {s}')}, point {p}"
            for s, p in zip(self._stage, self._point, strict=True)
        ]
        width, height = self._camera.image_size_px
        vectors = residual_vectors((width, height), self._xy, self._residual, self._used, labels)
        rejected = int((~self._used).sum())
        floor = self._run.rig.sigma_floor_px.get(self.name)
        more = "" if floor is None else f", lens and flatness add {floor:.3f} px"
        heading = (
            f'<h2 class="wide" style="margin:0">{escape(self.name)}</h2><p class="note wide">'
            f"{width} x {height} px, {self.pictures} pictures, {count(int(self._used.sum()))} "
            f"points used, {rejected} rejected, RMS {self.rms_px:.4f} px a coordinate{more}</p>"
        )
        return (
            f'<section class="card camera">{heading}'
            + figure("Residuals over the picture", vectors)
            + "<div>"
            + figure(
                "Residuals, both coordinates",
                histogram(self._residual, self._used),
                "Line: normal distribution of the same RMS.",
            )
            + figure(
                "Points used in each part of the picture",
                self._coverage,
                f"{100 * self.covered:.0f} % of the parts hold points; the lens is known there.",
                style="narrow",
            )
            + f'</div><div class="wide"><h3>Interior parameters</h3>{self._parameters()}</div>'
            + "</section>\n"
        )

    def _parameters(self) -> str:
        kept = self._run.parameters_kept[self.name]
        rows: list[list[str | Cell]] = []
        styles = []
        for index, (name, unit) in enumerate(zip(INTERIOR_NAMES, UNITS, strict=True)):
            value = float(self._camera.interior[index])
            sigma = self._camera.sigma.get(name)
            estimated = name in kept
            ratio = abs(value) / sigma if estimated and sigma else None
            rows.append(
                [
                    name,
                    number(value, sigma if estimated else None),
                    deviation(sigma) if estimated and sigma is not None else "",
                    unit,
                    _times(ratio),
                    Cell("estimated" if estimated else self._why_not(name), "why"),
                ]
            )
            styles.append("" if estimated else "off")
        header: list[str | Cell] = [
            "",
            "value",
            "std. dev.",
            "unit",
            "value / std. dev.",
            Cell("", "l"),
        ]
        note = f'<p class="note">r0 = {number(self._camera.r0_px)} px, held fixed.</p>'
        return table(header, rows, styles) + note

    def _why_not(self, name: str) -> str:
        for item in self._run.rejected:
            mine = item.kind == "parameter" and item.camera in (self.name, "")
            if mine and (item.image == name or re.search(rf"\b{name}\b", item.reason)):
                return f"left out: {item.reason}"
        return "held at its start value"


def _times(ratio: float | None) -> str:
    if ratio is None or not math.isfinite(ratio):
        return ""
    return f"{ratio:.1f}" if ratio < 100 else count(round(ratio))


def _verdict(run: CalibrationRun, sections: list[_Camera]) -> str:
    """One sentence on the whole, and what to look at."""
    points = len(run.observations)
    rejected = int((~run.observations.used).sum())
    reasons = list(run.warnings)
    if points and rejected > LOOK_REJECTED_PART * points:
        reasons.append(f"{100 * rejected / points:.0f} % of the points were rejected")
    middle = float(np.median([s.rms_px for s in sections]))
    for section in sections:
        if section.covered < LOOK_COVERAGE_PART:
            reasons.append(
                f"camera {section.name}: points in only {100 * section.covered:.0f} % of the "
                "picture; distortion is a guess elsewhere"
            )
        if section.pictures < LOOK_PICTURES:
            reasons.append(
                f"camera {section.name}: only {section.pictures} pictures, 8 to 24 are usual"
            )
        if section.rms_px > LOOK_RMS_RATIO * middle:
            reasons.append(
                f"camera {section.name}: residuals {section.rms_px / middle:.1f} times the median's"
            )
    head = (
        f"Re-projection {run.rms_px:.4f} px RMS a coordinate; "
        f"{100 * rejected / max(1, points):.1f} % of {count(points)} points rejected."
    )
    if not reasons:
        return (
            f'<div class="card verdict"><b>Nothing stands out.</b><p>{head} All cameras fit '
            "alike, their pictures are covered.</p></div>\n"
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


def _rejected(run: CalibrationRun) -> str:
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
        Cell("why", "l"),
    ]
    total = ", ".join(
        f"{n} {kind.replace('-', ' ')}{'s' if n > 1 else ''}" for kind, n in kinds.items()
    )
    rest = len(items) - len(rows)
    note = f'<p class="note">and {count(rest)} more</p>' if rest else ""
    return (
        f'<h2>Rejected</h2><div class="card"><details{" open" if len(items) <= 40 else ""}>'
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
