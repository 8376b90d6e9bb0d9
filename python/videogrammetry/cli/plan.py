"""``videogrammetry plan``: what a rig will measure how well, before anything is measured."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from videogrammetry.cli.common import SubParsers, UsageError, add_force, add_verb, text_table
from videogrammetry.cli.progress import Progress
from videogrammetry.geometry import MeasuringVolume
from videogrammetry.project import (
    PlanFile,
    PlanTarget,
    format_csv,
    plain,
    provenance,
    read_plan,
    read_points,
    refuse_overwrite,
    write_text,
)
from videogrammetry.types import PointSet

if TYPE_CHECKING:
    from videogrammetry.pipeline import Plan, PlanOptions

_OUTPUTS = ("plan.html", "plan.json", "plan.csv")
_DOT_PART = 30.0 / 1400.0  # a dot's diameter over the cross' span: it plays no part here


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "plan",
        run,
        help="predict the uncertainty over a volume before anything is bought or measured",
        description="Reads a plan.toml (or the rig.json of a calibration), simulates the design of "
        "its calibration, and predicts what image noise and calibration leave uncertain over the "
        "measuring volume. Writes plan.html, plan.json and plan.csv; prints a summary. Options win "
        "over the file.",
        example="videogrammetry plan plan.toml --wanted 0.05 --out plan",
    )
    parser.add_argument(
        "rig", type=Path, metavar="RIG", help="plan.toml, rig.json, or a folder with one of them"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the results (default: beside RIG)"
    )
    parser.add_argument(
        "--positions",
        type=int,
        metavar="N",
        help="of the calibration target (default: the file's, a calibrated rig's own covariance, "
        "16)",
    )
    parser.add_argument(
        "--wanted",
        type=float,
        metavar="MM",
        help="standard deviation to be reached at 95 %% of the volume: how many positions?",
    )
    parser.add_argument(
        "--of",
        choices=("distance", "position"),
        default="distance",
        help="what --wanted is of (default: %(default)s)",
    )
    parser.add_argument(
        "--sigma-px", type=float, metavar="PX", help="of an image coordinate (default: 0.05)"
    )
    parser.add_argument(
        "--target", metavar="WHAT", help="cross, board, or a points CSV (default: cross)"
    )
    parser.add_argument(
        "--target-sigma-mm", type=float, metavar="MM", help="of its coordinates (default: 0.1)"
    )
    xyz = ("X", "Y", "Z")
    parser.add_argument(
        "--centre", nargs=3, type=float, metavar=xyz, help="middle of the volume, mm"
    )
    parser.add_argument("--size", nargs=3, type=float, metavar=xyz, help="of a box, mm")
    parser.add_argument("--radius", type=float, metavar="MM", help="of a ball")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Predicts, writes page, document and table, prints the summary."""
    _check(args)
    file = read_plan(args.rig)
    folder: Path = args.out or (args.rig if args.rig.is_dir() else args.rig.parent)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in _OUTPUTS]
    for path in paths:
        refuse_overwrite(path, args.force)

    from videogrammetry.pipeline.plan import plan_columns, plan_document, plan_rig
    from videogrammetry.report import plan_page

    options = _options(args, file)
    volume = _volume(args, file)
    target = plan_target(_target(args, file.target))
    progress = Progress("plan")
    try:
        plan = plan_rig(file.rig, target, volume=volume, options=options, progress=progress)
    finally:
        progress.close()
    document = {**plan_document(plan), "provenance": provenance(plan.options, file.inputs)}
    header, columns = plan_columns(plan)
    write_text(paths[0], plan_page(plan, file.name, document["provenance"]))
    write_text(paths[1], json.dumps(plain(document), indent=1) + "\n")
    write_text(paths[2], format_csv(header, columns))
    for warning in plan.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(plan_text(plan), end="")
    print(f"wrote {', '.join(map(str, paths))}", file=sys.stderr)
    return 0


def _check(args: argparse.Namespace) -> None:
    for name in ("wanted", "sigma_px", "target_sigma_mm", "radius"):
        value = getattr(args, name)
        if value is not None and not 0 < value < math.inf:
            raise UsageError(f"--{name.replace('_', '-')} {value:g}: expected a number above 0")
    if args.positions is not None and args.positions < 1:
        raise UsageError(f"--positions {args.positions}: expected 1 or more")
    if args.size is not None and min(args.size) <= 0:
        raise UsageError("--size: expected three lengths above 0 mm")
    if args.size is not None and args.radius is not None:
        raise UsageError("--size and --radius: the volume is a box or a ball, give one of them")
    if args.centre is not None and args.size is None and args.radius is None:
        raise UsageError("--centre: give --size or --radius with it")


def _volume(args: argparse.Namespace, file: PlanFile) -> MeasuringVolume | None:
    if args.size is None and args.radius is None:
        return file.volume
    if args.centre is not None:
        centre = np.array(args.centre)
    elif file.volume is not None:
        centre = file.volume.centre_mm
    else:
        raise UsageError("--centre X Y Z: say where the middle of the volume is")
    if args.radius is not None:
        return MeasuringVolume(
            centre_mm=centre, size_mm=np.full(3, 2 * args.radius), shape="sphere"
        )
    return MeasuringVolume(centre_mm=centre, size_mm=np.array(args.size))


def _options(args: argparse.Namespace, file: PlanFile) -> PlanOptions:
    from videogrammetry.pipeline.plan_types import PlanOptions

    return PlanOptions(
        positions=file.positions if args.positions is None else args.positions,
        sigma_px=file.sigma_px if args.sigma_px is None else args.sigma_px,
        target_sigma_mm=args.target_sigma_mm or file.target.sigma_mm,
        target_part=file.target.part,
        target_tilt_rad=math.radians(file.target.tilt_deg),
        target_whole=file.target.whole,
        free=file.free,
        frame=file.frame,
        groups=file.groups,
        length_mm=file.length_mm,
        wanted_mm=args.wanted,
        wanted_of=args.of,
    )


def _target(args: argparse.Namespace, target: PlanTarget) -> PlanTarget:
    if args.target is None:
        return target
    if args.target in ("cross", "board"):
        return PlanTarget(kind=args.target, span_mm=target.span_mm, size_mm=target.size_mm)
    return PlanTarget(points=Path(args.target))


def plan_target(target: PlanTarget) -> PointSet:
    """The points of the calibration target that a plan names."""
    if target.points is not None:
        return read_points(target.points)
    if target.kind == "board":
        from videogrammetry.calibration import flat_board

        return flat_board(target.size_mm, target.grid)
    from videogrammetry.recognition import code_family
    from videogrammetry.rendering.scenes.cross import cross_target

    scale = target.span_mm / 1400.0
    return cross_target(
        code_family("schneider-14"),
        span_mm=target.span_mm,
        dot_mm=_DOT_PART * target.span_mm,
        depth_mm=120.0 * scale,
        thickness_mm=60.0 * scale,
    ).points()


def plan_text(plan: Plan) -> str:
    """The tables for the terminal."""
    from videogrammetry.report.plan_page import advice, millimetres, verdict_text, volume_text

    names = {q: q for q in ("sigma_x", "sigma_y", "sigma_z", "position")}
    names["distance"] = f"distance {plan.options.length_mm:g} mm"
    rows = []
    for quantity, name in names.items():
        row = [name]
        for source in ("image", "calibration", "together"):
            s = plan.statistics[quantity][source]
            row += [millimetres(v) for v in (s.median_mm, s.most_mm, s.worst_mm)]
        rows.append(row)
    header = ["standard deviation, mm"]
    header += [f"{s} {w}" for s in ("image", "calib.", "both") for w in ("median", "95 %", "worst")]
    lines = [f"{volume_text(plan)}, {100 * plan.part_seen:.0f} % of it seen by two cameras"]
    lines += [verdict_text(plan), "", text_table(header, rows)]
    counts = [[str(row.count), *map(millimetres, row.columns_mm())] for row in plan.counts]
    lines.append(
        text_table(
            ["positions", "distance: calib.", "both", "near middle", "position: calib.", "both"],
            counts,
        )
    )
    lines.append(
        "(mm at 95 % of the volume; near middle: the distance, calibration alone, if the target "
        "stays near\nthe middle, whole in the pictures and hardly tilted)\n"
    )
    done = set(plan.warnings)  # they stand on standard error
    lines += [f"- {reason}" for reason in advice(plan) if reason not in done]
    return "\n".join(lines).rstrip() + "\n"
