"""The project file and tables beside a simulated recording."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.project import ScaleBar, read_project, write_scale_bars, write_text
from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.scenes import PhotoScene, Scene
from videogrammetry.rendering.scenes.photos import BAR_SIGMA_MM

# Room about the smallest minor and the largest major axis of the scenes' dots.
_SMALLEST, _LARGEST = 0.75, 1.5
#: Recognition takes no smaller dots.
_LEAST_PX = 3


@dataclass(frozen=True, kw_only=True)
class BorrowedCalibration:
    """Another project's calibration: camera -> pictures, and the target; paths from here."""

    pictures: Mapping[str, list[str]]
    target: str
    sigma_mm: float | None


def write_project(
    scene: Scene,
    folder: Path,
    sequences: Mapping[str, str],
    family: CodeFamily,
    *,
    other: BorrowedCalibration | None = None,
    target_sigma_mm: float = 0.1,
    pictures: bool = False,
) -> None:
    """Writes project.toml, and bars.csv where the scene has a bar, into ``folder``.

    Parameters
    ----------
    sequences : camera -> name of its sequence within the folder.
    other : of a calibration project whose pictures a sequence uses.
    target_sigma_mm : of the coordinates in a calibration's cross.csv; 0 = exact.
    pictures : the sequence is of single pictures, which state no frame rate.
    """
    lines = ["schema = 1", f'name = "simulated {scene.name}"', ""]
    is_calibration = scene.name == "calibration"
    for name, spec in sequences.items():
        lines.append(f"[cameras.{_key(name)}]")
        if is_calibration:
            lines.append(f"calibration = {_text(spec)}")
        else:
            if other is not None:
                lines.append(f"calibration = {_listed(other.pictures[name])}")
            lines.append(f"sequence = {_text(spec)}")
        lines.append("")
    if is_calibration:
        lines += _calibration_table("cross.csv", target_sigma_mm)
    elif other is not None:
        lines += _calibration_table(other.target, other.sigma_mm)
    lines += _targets_table(scene, family)
    if pictures and not is_calibration:
        lines += ["[sequence]", f"frame_rate_hz = {scene.frame_rate_hz!r}", ""]
    if not is_calibration:
        lines += _verify_table(scene, folder)
    write_text(folder / "project.toml", "\n".join(lines).rstrip() + "\n")


def write_photo_project(photos: PhotoScene, folder: Path, spec: str, family: CodeFamily) -> None:
    """Writes project.toml and scale-bars.csv for the photographs of the target."""
    bars = [
        ScaleBar(point_a=a, point_b=b, length_mm=length, sigma_mm=BAR_SIGMA_MM)
        for a, b, length in photos.bars
    ]
    write_scale_bars(folder / "scale-bars.csv", bars)
    lines = [
        *("schema = 1", 'name = "simulated target photographs"', ""),
        *("[cameras.handheld]", f"calibration = {_text(spec)}", ""),
        *("[calibration]", 'scale_bars = "scale-bars.csv"', ""),
        *_targets_table(photos.as_scene(), family),
    ]
    write_text(folder / "project.toml", "\n".join(lines).rstrip() + "\n")


def _calibration_table(target: str, sigma_mm: float | None) -> list[str]:
    lines = ["[calibration]", f"target = {_text(target)}"]
    if sigma_mm:
        lines.append(f"sigma_mm = {sigma_mm:g}")
    return [*lines, ""]


def borrowed_calibration(
    calibration: Path, out: Path, cameras: Iterable[str]
) -> BorrowedCalibration:
    """What a calibration project names, relative to the folder ``out`` (which need not exist).

    Raises
    ------
    ProjectFileError
        There is no project, or it does not calibrate all of ``cameras``.
    """
    project = read_project(calibration)
    if project.calibration.target is None:
        raise ProjectFileError(
            f"{project.path}: names no calibration target, so a sequence cannot use it; give the "
            "folder of a calibration project"
        )
    without = [n for n in cameras if n not in project.cameras or not project.cameras[n].calibration]
    if without:
        raise ProjectFileError(
            f"{project.path}: names no calibration pictures of {', '.join(without)}, so a sequence "
            f"cannot use it; it has the cameras {', '.join(project.cameras)}"
        )
    start = out.resolve()

    def relative(name: str | Path) -> str:
        return Path(os.path.relpath(project.folder.resolve() / name, start)).as_posix()

    return BorrowedCalibration(
        pictures={
            name: [relative(spec) for spec in project.cameras[name].calibration or ()]
            for name in cameras
        },
        target=relative(project.calibration.target),
        sigma_mm=project.calibration.sigma_mm,
    )


def _text(text: str) -> str:
    """A TOML text: its basic strings take JSON's escapes."""
    return json.dumps(text, ensure_ascii=False)


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else _text(name)


def _listed(names: list[str]) -> str:
    quoted = [_text(name) for name in names]
    return quoted[0] if len(quoted) == 1 else f"[{', '.join(quoted)}]"


def _targets_table(scene: Scene, family: CodeFamily) -> list[str]:
    rows = scene.marks.is_target
    diameter_mm = 2 * float(scene.marks.radius_mm[rows].max())
    smallest, largest = _diameters_px(scene, rows)
    return [
        "[targets]",
        f"codes = {_text(family.name)}",
        f"diameter_px = [{max(_LEAST_PX, int(smallest))}, {int(largest) + 1}]",
        f"diameter_mm = {diameter_mm:g}",
        "",
    ]


def _diameters_px(scene: Scene, rows: Any) -> tuple[float, float]:
    """A generous range of the dots' axes in the pictures of those that see their front."""
    smallest, largest = float("inf"), 0.0
    for stage in {1, (scene.num_stages + 1) // 2, scene.num_stages}:
        place = scene.place(scene.time_s(stage))
        centre, normal = place.centre_mm[rows], place.normal[rows]
        for camera in scene.rig.cameras.values():
            sight = camera.centre_mm - centre
            facing = (sight * normal).sum(axis=1) / np.linalg.norm(sight, axis=1)
            depth = (centre @ camera.rotation.T + camera.translation_mm)[:, 2]
            seen = (facing > 0.3) & (depth > 0)
            major = 2 * scene.marks.radius_mm[rows][seen] * camera.interior[0] / depth[seen]
            if len(major):
                smallest = min(smallest, float((major * facing[seen]).min()))
                largest = max(largest, float(major.max()))
    return _SMALLEST * smallest, _LARGEST * largest


def _verify_table(scene: Scene, folder: Path) -> list[str]:
    lines = ["[verify]", 'truth = "truth"']
    facts = scene.facts
    if "bars" in facts:
        bars = [
            ScaleBar(point_a=a, point_b=b, length_mm=facts["length_mm"], sigma_mm=facts["sigma_mm"])
            for a, b in facts["bars"]
        ]
        write_scale_bars(folder / "bars.csv", bars)
        lines.append('scale_bars = "bars.csv"')
    if "free_fall_stages" in facts:
        first, last = facts["free_fall_stages"]
        if last - first >= 3:  # an acceleration needs more stages than unknowns
            lines.append(f"free_fall = [{first}, {last}]")
        lines.append(f"gravity_m_s2 = {facts['gravity_m_s2']!r}")
        if facts["drag_per_m"]:
            lines.append(f"drag_per_m = {facts['drag_per_m']!r}")
    return [*lines, ""]
