"""``videogrammetry measure-target``: hand-held photographs -> the coordinates of a target."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from videogrammetry.cli.adjust import summary
from videogrammetry.cli.common import SubParsers, UsageError, add_force, add_verb
from videogrammetry.cli.progress import Progress
from videogrammetry.cli.recognize import (
    add_recognition_arguments,
    frame_names,
    recognition_options_of,
)
from videogrammetry.project import plain, provenance, refuse_overwrite, write_text
from videogrammetry.project.network_tables import (
    read_network_points,
    read_network_scale_bars,
    write_point_covariance,
)
from videogrammetry.sequence import open_sequence
from videogrammetry.types import INTERIOR_NAMES

if TYPE_CHECKING:
    from videogrammetry.pipeline.measure_target import MeasuredTarget

#: The layout of the summary.
SCHEMA = 1


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "measure-target",
        run,
        help="measure a calibration target, or any still object, from hand-held photographs",
        description="Recognises the targets of the photographs, finds where they were taken from, "
        "matches un-coded dots\nand adjusts all as a free network with the camera. Writes FILE "
        "with standard deviations, the full covariance\nin .npz beside it (calibrate uses both), "
        "a summary and a report.",
        example="videogrammetry measure-target 'photos/*.jpg' --scale-bars bars.csv "
        "--out cross.csv",
    )
    parser.add_argument("inputs", nargs="+", metavar="PHOTO", help="pictures, folders or patterns")
    parser.add_argument(
        "--scale-bars",
        type=Path,
        metavar="FILE",
        help="CSV point_a,point_b,length_mm,sigma_mm[,alpha_per_K,temperature_C,reference_C,"
        "certificate]",
    )
    parser.add_argument(
        "--nominal",
        type=Path,
        metavar="FILE",
        help="points CSV as drawn: places the object's frame (default: its own axes)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("points.csv"), metavar="FILE", help="default: %(default)s"
    )
    add_recognition_arguments(parser)
    parser.add_argument(
        "--diameter-mm",
        type=float,
        metavar="D",
        help="of the dots, for their eccentricity (default: what the ellipses tell)",
    )
    parser.add_argument(
        "--cameras",
        nargs="+",
        default=(),
        metavar="PATTERN",
        help="one a camera, like 'left_*' 'right_*' (default: by EXIF and size)",
    )
    parser.add_argument(
        "--f-px", type=float, metavar="F", help="start value (default: EXIF, else searched)"
    )
    parser.add_argument(
        "--free",
        metavar="NAMES",
        help="interior parameters to estimate, like f,x0,y0,A1,B1,B2 (default: all ten, each "
        "kept if significant)",
    )
    parser.add_argument(
        "--coded-only", action="store_true", help="do not match and measure un-coded dots"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Measures and writes points, covariance, summary and report."""
    from videogrammetry.pipeline.measure_target import (
        TargetOptions,
        measure_target,
        picture_by_name,
        read_photographs,
    )
    from videogrammetry.report.network_report import network_report

    options = TargetOptions(
        recognition=recognition_options_of(args),
        cameras=tuple(args.cameras),
        f_px=_positive(args.f_px, "--f-px"),
        diameter_mm=_positive(args.diameter_mm, "--diameter-mm"),
        free=_free(args.free),
        uncoded=not args.coded_only,
    )
    paths = output_paths(args.out)
    for path in paths.values():
        refuse_overwrite(path, args.force)
    bars = () if args.scale_bars is None else read_network_scale_bars(args.scale_bars)
    nominal = None if args.nominal is None else read_network_points(args.nominal)
    source = open_sequence(args.inputs, same_size=False)
    if len(source) < 2:
        raise UsageError(f"PHOTO: expected two photographs or more, got {len(source)}")
    names = frame_names(source)
    progress = Progress("measure-target")
    try:
        photographs = read_photographs(source, names, options, progress)
        measured = measure_target(photographs, bars, nominal, options, progress)
    finally:
        progress.close()
    tables = [path for path in (args.scale_bars, args.nominal) if path is not None]
    origin = provenance(options, [*source.paths, *tables], Path.cwd())
    page = network_report(measured.result, args.out.stem, picture_by_name(source, names))
    _write(paths, measured, origin, page)
    for warning in measured.result.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(summary(measured.result), end="", file=sys.stderr)
    print(_sides(measured), end="", file=sys.stderr)
    print(f"wrote {args.out} and {paths['report']}", file=sys.stderr)
    return 0


def output_paths(out: Path) -> dict[str, Path]:
    """All that the verb writes.

    Examples
    --------
    >>> [path.name for path in output_paths(Path("cross.csv")).values()]
    ['cross.csv', 'cross.npz', 'cross-summary.json', 'cross-report.html']
    """
    if out.suffix != ".csv":
        raise UsageError(f"--out: expected a name ending in .csv, got {out}")
    return {
        "points": out,
        "covariance": out.with_suffix(".npz"),
        "summary": out.with_name(f"{out.stem}-summary.json"),
        "report": out.with_name(f"{out.stem}-report.html"),
    }


def _positive(value: float | None, name: str) -> float | None:
    if value is not None and not value > 0:
        raise UsageError(f"{name}: expected a number over 0, got {value:g}")
    return value


def _free(text: str | None) -> tuple[str, ...] | None:
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    for name in names:
        if name not in INTERIOR_NAMES:
            raise UsageError(f"--free: {name!r} is none of {', '.join(INTERIOR_NAMES)}")
    return names


def _write(
    paths: Mapping[str, Path], measured: MeasuredTarget, origin: Mapping[str, Any], page: str
) -> None:
    """The points last: they are there only if all is."""
    from videogrammetry.pipeline.adjust_output import cameras_document, points_csv

    points, result = measured.result.points, measured.result
    document: dict[str, Any] = {
        "schema": SCHEMA,
        **{
            name: getattr(result.summary, name)
            for name in type(result.summary).__dataclass_fields__
        },
        "cameras": cameras_document(result, {})["cameras"],
        "rejected": result.rejected,
        "warnings": result.warnings,
    }
    if (sides := measured.sides) is not None:
        document["sides"] = {
            "front": [points.name[i] for i in sides.front],
            "back": [points.name[i] for i in sides.back],
            "ties": [points.name[i] for i in sides.ties],
            "front_from_back": sides.front_from_back,
            "order": ["rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm"],
            "sigma": sides.sigma,
            "covariance": sides.cov,
        }
    document["how"] = origin
    write_text(paths["summary"], json.dumps(plain(document), indent=1, ensure_ascii=False) + "\n")
    write_text(paths["report"], page)
    if points.full_cov_mm2 is not None:
        write_point_covariance(paths["covariance"], points.name, points.full_cov_mm2)
    else:
        paths["covariance"].unlink(missing_ok=True)
    write_text(paths["points"], points_csv(points))


def _sides(measured: MeasuredTarget) -> str:
    """One line about the two sides; nothing for an object with one."""
    sides = measured.sides
    if sides is None:
        return ""
    angle = 1e6 * float(np.linalg.norm(sides.sigma[:3]))
    shift = float(np.linalg.norm(sides.sigma[3:]))
    return (
        f"two sides of {len(sides.front)} and {len(sides.back)} points, tied by "
        f"{len(sides.ties)}: their relative place is known to {shift:.3f} mm and {angle:.0f} urad\n"
    )
