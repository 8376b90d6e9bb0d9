"""The page of the experiments: one file that works offline, drawings and pictures inside."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from videogrammetry.report.accuracy_figures import deformation_figure, scale_bar_figure
from videogrammetry.report.chart import Marker
from videogrammetry.report.displacement_view import displacement_figure
from videogrammetry.report.experiment_figures import free_fall_figure, trajectory_figures
from videogrammetry.report.experiments_content import ExperimentsPage
from videogrammetry.report.html import Cell, Figure, escape, facts, figure, page, table
from videogrammetry.report.recognised_pictures import recognised_pictures
from videogrammetry.report.space import row_of_stage
from videogrammetry.report.space_view import (
    SPACE_VIEW_STYLE,
    interactive_view,
    space_view_script,
)

_STYLE = (
    SPACE_VIEW_STYLE
    + """
.two{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:8px 22px;align-items:start}
.two>figure>.two{gap:0}
.broad{overflow-x:auto}
.broad>svg{min-width:760px}
td.why{min-width:190px}
@media (max-width:820px){.two{grid-template-columns:1fr}
.two>figure>.two{grid-template-columns:1fr 1fr}}
.card>figure:last-child{margin-bottom:0}
.lead{font-size:17px;color:var(--ink);max-width:78ch}
td.name{font-weight:600;white-space:normal;text-align:left}
td.run{font-weight:600}
pre.commands{background:#11151c;color:#e6ebf2;border-radius:8px;padding:12px 16px;font-size:13px}
a{color:var(--blue)}
@media print{main{max-width:none;padding:0}h2{break-after:avoid}figure{break-inside:avoid}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""
)


def experiments_page(content: ExperimentsPage) -> str:
    """The page as text, complete in itself: no request leaves it.

    Parameters
    ----------
    content : what is shown; see :class:`ExperimentsPage`. Empty parts are left out.

    Raises
    ------
    ValueError
        If a stage to be shown was not measured.
    """
    lead = f'<p class="lead">{escape(content.summary)}</p>' if content.summary else ""
    body = (
        f"<header><h1>{escape(content.title)}</h1>{lead}</header>\n"
        + (facts(content.facts) if content.facts else "")
        + _comparison(content)
        + _calibration(content)
        + _scale_bar(content)
        + _recognition(content)
        + _space(content)
        + _trajectory(content)
        + _free_fall(content)
        + _deformation(content)
        + _remarks(content)
        + _files(content)
        + _repeat(content)
    )
    return page(content.title, body, _STYLE)


def _section(heading: str, body: str, text: str = "") -> str:
    words = f"<p>{escape(text)}</p>" if text else ""
    return f'<h2>{escape(heading)}</h2><div class="card">{words}{body}</div>\n'


def _figures(figures: Sequence[Figure], style: str = "") -> str:
    return "".join(figure(f.title, f.svg, f.note, style) for f in figures)


def _comparison(content: ExperimentsPage) -> str:
    if not content.comparison:
        return ""
    # A column that says nothing is left out.
    names = [n for n in ("paper", "run", "truth") if any(getattr(r, n) for r in content.comparison)]
    noted = any(row.note for row in content.comparison)
    heads = {"paper": "paper", "run": "this run", "truth": "truth"}
    header: list[str | Cell] = [Cell("quantity", "l"), *(heads[n] for n in names)]
    rows = []
    for row in content.comparison:
        cells: list[str | Cell] = [Cell(row.quantity, "name")]
        cells += [Cell(getattr(row, n), "run" if n == "run" else "") for n in names]
        rows.append([*cells, Cell(row.note, "why")] if noted else cells)
    if noted:
        header.append(Cell("", "l"))
    return _section("The paper and this run", table(header, rows), content.comparison_text)


def _calibration(content: ExperimentsPage) -> str:
    part = content.calibration
    if part is None:
        return ""
    body = facts(part.facts) if part.facts else ""
    if part.rows:
        body += table(list(part.columns), part.rows)
    if part.report:
        body += f"<p>{_link(part.report, 'Full report of the calibration')}</p>"
    return _section("Calibration", body, part.text)


def _scale_bar(content: ExperimentsPage) -> str:
    part = content.scale_bar
    if part is None:
        return ""
    figures = scale_bar_figure(
        part.error_mm,
        part.sigma_mm,
        sigma_calibration_mm=part.sigma_calibration_mm,
        speed_mm_s=part.speed_mm_s,
        limit_mm=part.limit_mm,
    )
    return _section("Scale bar", f'<div class="two">{_figures(figures)}</div>', part.text)


def _recognition(content: ExperimentsPage) -> str:
    part = content.recognition
    if part is None:
        return ""
    measured = content.measurement
    targets = part.targets
    if targets is None:
        targets = measured.targets if measured is not None else {}
    if measured is not None:
        names: Sequence[str] = measured.trajectories.camera_names
    else:
        names = list(dict.fromkeys(camera for _, camera in part.pictures))
    stages = part.stages or content.stages or sorted({stage for stage, _ in part.pictures})
    svg = recognised_pictures(
        part.pictures,
        targets,
        stages=stages,
        camera_names=names,
        crops=part.crops,
        stage_notes=_notes(content, stages),
    )
    note = (
        "Ellipse and cross: what was fitted, at its sub-pixel place; the number beside it is the "
        "code that was read in the ring. Contrast stretched; a camera's crop is the same at all "
        "stages."
    )
    return _section("Recognised targets", figure("Pictures of some stages", svg, note, "broad"))


def _notes(content: ExperimentsPage, stages: Sequence[int]) -> dict[int, str]:
    """Time and word of each stage."""
    notes = {}
    for stage in stages:
        words = []
        if content.measurement is not None:
            table_ = content.measurement.trajectories
            time = table_.time_s[row_of_stage(table_.stage, stage)]
            words += [f"{1e3 * time:.0f} ms"] if np.isfinite(time) else []
        if content.stage_notes.get(stage):
            words.append(content.stage_notes[stage])
        notes[stage] = "\n".join(words)
    return notes


def _space(content: ExperimentsPage) -> str:
    measured = content.measurement
    if measured is None:
        return ""
    body = ""
    if content.stages:
        svg = displacement_figure(measured, content.stages, scene=content.scene)
        outlined = " Dashed: the nominal outline, moved with the centroid; not measured."
        body = figure(
            "Displacement at some stages, from the front and from the right",
            svg,
            "A ray leads from where a point was at stage "
            f"{measured.motion.reference_stage} to where it is; its colour is the length. "
            "All panels have one scale." + (outlined if content.scene.outline_mm else ""),
            "broad",
        )
    first = content.stages[-1] if content.stages else None
    view = interactive_view(measured, stage=first, scene=content.scene, rig=content.rig)
    body += figure(
        "All stages, to be turned and played",
        view,
        "Drag to turn, with Shift to move; wheel to zoom; arrow keys step. Rest on a point for "
        "its number and displacement.",
    )
    return _section("Displacement in space", body + space_view_script())


def _trajectory(content: ExperimentsPage) -> str:
    if content.measurement is None:
        return ""
    figures = trajectory_figures(
        content.measurement, scene=content.scene, truth=content.truth, markers=content.markers
    )
    path, rest = figures[0], figures[1:]
    histories = _figures(rest[:2])
    body = f'<div class="two">{_figures([path])}<div>{histories}</div>{_figures(rest[2:])}</div>'
    count = len(content.measurement.motion.centroid_points)
    return _section(
        "Trajectory, displacement and velocity of the centroid",
        body,
        f"The centroid is the mean of {count} points, the same at every stage.",
    )


def _free_fall(content: ExperimentsPage) -> str:
    part = content.free_fall
    if part is None:
        return ""
    figures = free_fall_figure(
        part.measured_mm,
        part.theoretical_mm,
        part.slope,
        part.offset_mm,
        sigma_mm=part.sigma_mm,
        slope_sigma=part.slope_sigma,
        offset_sigma_mm=part.offset_sigma_mm,
    )
    return _section("Free fall", f'<div class="two">{_figures(figures)}</div>', part.text)


def _deformation(content: ExperimentsPage) -> str:
    part = content.deformation
    if part is None:
        return ""
    time, stage, markers = None, None, []
    if content.measurement is not None:
        seen = content.measurement.trajectories
        timed = bool(np.isfinite(seen.time_s).all())
        time = seen.time_s * 1e3 if timed else None
        stage = seen.stage.tolist()
        for number, word in content.markers:
            row = row_of_stage(seen.stage, number)
            markers.append(Marker(float(seen.time_s[row] * 1e3) if timed else number, word))
    figures = deformation_figure(
        part.radial_change_mm, part.point_id, time_ms=time, stage=stage, markers=markers
    )
    return _section("Deformation", _figures(figures, "broad"), part.text)


def _remarks(content: ExperimentsPage) -> str:
    if not content.remarks:
        return ""
    items = "".join(f"<li>{escape(remark)}</li>" for remark in content.remarks)
    return _section("What to keep in mind", f"<ul>{items}</ul>")


def _link(path: str, text: str = "") -> str:
    """A link to a file beside the page; anything that leads elsewhere stays text."""
    name = escape(text or path)
    if ":" in path.split("/")[0] or path.startswith(("/", "\\")):
        return name
    return f'<a href="{escape(path)}">{name}</a>'


def _files(content: ExperimentsPage) -> str:
    if not content.files:
        return ""
    rows = "".join(
        f'<tr><td>{_link(f.path)}</td><td class="why">{escape(f.what)}</td></tr>'
        for f in content.files
    )
    return _section("Files", f'<div class="scroll"><table><tbody>{rows}</tbody></table></div>')


def _repeat(content: ExperimentsPage) -> str:
    body = ""
    if content.commands:
        lines = escape("\n".join(content.commands))
        body += f'<pre class="commands">{lines}</pre>'
    if content.provenance:
        text = json.dumps(dict(content.provenance), indent=1, ensure_ascii=False, default=str)
        body += f"<details><summary>Provenance</summary><pre>{escape(text)}</pre></details>"
    return _section("How to repeat it", body) if body else ""
