"""``videogrammetry info``: what a project, rig, measurement, table or sequence holds."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from videogrammetry.cli.common import SubParsers, add_verb, text_table
from videogrammetry.errors import TableError
from videogrammetry.motion import flag_mask
from videogrammetry.project import (
    read_measurement,
    read_motion,
    read_observations,
    read_points,
    read_project,
    read_rig,
    read_scale_bars,
    read_targets,
    read_trajectories,
)
from videogrammetry.sequence import JoinedSource, irregular_times, open_sequence


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "info",
        run,
        help="show what a file holds",
        description="Tells what a project, rig, measurement, CSV table, picture, folder of "
        "pictures or sequence holds; reads it as strictly as the other verbs do.",
        example="videogrammetry info rig.json",
    )
    parser.add_argument("file", metavar="FILE", help="file, folder or quoted pattern")


def run(args: argparse.Namespace) -> int:
    """Prints the description."""
    path = Path(args.file)
    readers: dict[str, Callable[[Path], str]] = {
        ".toml": project_info,
        ".json": rig_info,
        ".h5": measurement_info,
        ".csv": table_info,
    }
    reader = readers.get(path.suffix.lower())
    is_project = path.is_dir() and (path / "project.toml").is_file()
    if is_project:
        print(project_info(path), end="")
    elif reader is not None:
        print(reader(path), end="")
    else:
        print(sequence_info(args.file), end="")
    return 0


def project_info(path: Path) -> str:
    """Cameras, their files and which results are there."""
    project = read_project(path)
    rows = []
    for camera in project.cameras.values():
        rows.append(
            [camera.name, " ".join(camera.calibration or ("-",)), " ".join(camera.sequence or "-")]
        )
    target = project.calibration.target
    lines = [
        f"project {project.name}: {len(project.cameras)} cameras",
        f"target: {target.name if target else 'none named'}; codes: {project.targets.codes}",
        f"rig.json: {'there' if project.rig_path.exists() else 'not yet'}; measurement.h5: "
        f"{'there' if project.measurement_path.exists() else 'not yet'}",
    ]
    return "\n".join(lines) + "\n" + text_table(["camera", "calibration", "sequence"], rows)


def rig_info(path: Path) -> str:
    """The cameras with their main parameters, and how the rig came to be."""
    rig = read_rig(path)
    rows = []
    for name, camera in rig.cameras.items():
        rows.append(
            [
                name,
                f"{camera.image_size_px[0]}x{camera.image_size_px[1]}",
                *(f"{value:.2f}" for value in camera.interior[:3]),
                *(f"{value:.2f}" for value in camera.centre_mm),
            ]
        )
    header = ["camera", "size px", "f px", "x0 px", "y0 px", "X mm", "Y mm", "Z mm"]
    measured = next(iter(rig.cameras.values())).measured
    how = rig.how.get("provenance", rig.how)
    lines = [
        f"rig of {len(rig.cameras)} cameras; frame: {rig.reference or 'not stated'}; "
        f"distortion of the {'measured' if measured else 'ideal'} point",
        f"covariance: {'none' if rig.cov is None else f'{len(rig.cov_names)} parameters'}; "
        f"made by: {how.get('program', 'unknown')} {how.get('version', '')} "
        f"{how.get('time_utc', '')}".rstrip(),
    ]
    return "\n".join(lines) + "\n" + text_table(header, rows)


def measurement_info(path: Path) -> str:
    """Stages, points and what is known of them."""
    measurement = read_measurement(path)
    table = measurement.trajectories
    there = np.isfinite(table.position_mm[..., 0])
    filled = int((there & (table.flags & flag_mask(["filled"]) != 0)).sum())
    times = ""
    if measurement.frame_rate_hz is not None:
        times = f", {table.time_s[0]:g} to {table.time_s[-1]:g} s"
    origin = measurement.provenance
    return (
        f"measurement: {len(table.stage)} stages ({table.stage[0]} to {table.stage[-1]}{times}), "
        f"cameras {', '.join(table.camera_names)}\n"
        f"{there.shape[1]} points, {int(there.all(axis=0).sum())} of them in every stage; "
        f"{int(there.sum())} positions of {there.size} possible"
        f"{f', {filled} of them filled' if filled else ''}; {len(measurement.targets)} "
        f"targets seen\n"
        f"made by: {origin.get('program', 'unknown')} {origin.get('version', '')} "
        f"{origin.get('time_utc', '')}\n"
    )


def table_info(path: Path) -> str:
    """Kind and size of a CSV table, by its columns."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = {cell.strip() for cell in next(csv.reader(file), [])}
    except UnicodeDecodeError as error:
        raise TableError(f"{path}: not a text file in UTF-8; save it as CSV in UTF-8") from error
    if "semi_major_px" in header:
        targets = read_targets(path)
        coded = int((targets.id >= 0).sum())
        return (
            f"targets: {len(targets)} in {len(set(targets.image))} pictures, {coded} with an ID\n"
        )
    if "length_mm" in header:
        return f"scale bars: {len(read_scale_bars(path))}\n"
    if "dx_mm" in header:
        motion = read_motion(path)
        return f"motion: {len(set(motion.point))} points, {len(set(motion.stage))} stages\n"
    if "stage" in header:
        rows = read_trajectories(path)
        return f"trajectories: {len(set(rows.point))} points, {len(set(rows.stage))} stages\n"
    if "point" in header:
        seen = read_observations(path)
        return f"observations: {len(seen)} in {len(seen.image)} pictures\n"
    points = read_points(path)
    size = np.ptp(points.position_mm, axis=0)
    sigma = "with" if points.cov_mm2 is not None else "without"
    return (
        f"points: {len(points)} {sigma} standard deviations, numbers {points.id.min()} to "
        f"{points.id.max()}, extent {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} mm\n"
    )


def _timing(source: JoinedSource) -> str:
    """Trigger frame and time stamps, a line each, where the files have them."""
    lines = []
    first = source.first_frame
    if first is not None and source.save_step == 1 and first <= 0 < first + len(source):
        lines.append(f"trigger: at frame {1 - first} of the file")
    elif first is not None:
        lines.append(f"trigger: the first frame is the camera's frame {first} (0: the trigger)")
    times = source.times_s()
    if times is not None and len(times):
        usual = f", {np.median(np.diff(times)) * 1e6:.3f} us apart" if len(times) > 1 else ""
        odd = irregular_times(times)
        but = "" if odd is None else f", but irregular at frame {odd + 1} ({times[odd]:.9f} s)"
        lines.append(f"time stamps: {times[0]:.9f} to {times[-1]:.9f} s{usual}{but}")
    return "".join(f"{line}\n" for line in lines)


def sequence_info(spec: str) -> str:
    """Frames of a picture, folder or sequence; the first one is read."""
    source = open_sequence(spec)
    frame = source.read(0)
    rate = source.frame_rate_hz
    count = len(source)
    names = source.name(0) if count == 1 else f"{source.name(0)} to {source.name(count - 1)}"
    bits = source.bit_depth or ("8" if frame.dtype == np.uint8 else "9 to 16")
    exposure = "" if source.exposure_s is None else f", exposure {source.exposure_s * 1e6:g} us"
    origin = f"{source.origin}\n" if source.origin else ""
    origin += _timing(source)
    return (
        f"sequence: {count} frame{'s' if count > 1 else ''}, "
        f"{source.image_size_px[0]}x{source.image_size_px[1]} px, "
        f"{bits} bit, {'no frame rate' if rate is None else f'{rate:g} Hz'}{exposure}\n"
        f"{origin}{names}\n"
        f"grey values of the first: {frame.min()} to {frame.max()}, mean {frame.mean():.1f}\n"
    )
