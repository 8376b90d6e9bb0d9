"""``videogrammetry adjust``: network.toml -> points, cameras, pictures, residuals, a report."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

from videogrammetry.calibration.network_result import NetworkAdjustment, NetworkOptions
from videogrammetry.cli.common import SubParsers, UsageError, add_force, add_verb, text_table
from videogrammetry.cli.progress import Progress
from videogrammetry.project import atomic_folder, refuse_overwrite
from videogrammetry.project.atomic import nearest_folder
from videogrammetry.project.network_file import read_network_file


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "adjust",
        run,
        help="adjust observations, cameras, known points and scale bars together",
        description="Adjusts a photogrammetric network (bundle adjustment) and writes into a "
        "folder: points.csv with standard deviations and points.npz with the full\n"
        "covariance, cameras.json, images.csv, residuals.csv, summary.json and report.html.",
        example="videogrammetry adjust network.toml --out adjusted",
    )
    parser.add_argument("network", type=Path, metavar="NETWORK", help="network.toml or its folder")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the results (default: adjusted, beside the network file)",
    )
    parser.add_argument(
        "--threads", type=int, default=0, metavar="N", help="0 = one a core (default)"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Adjusts and writes the tables."""
    if args.threads < 0:
        raise UsageError(f"--threads: expected 0 or more, got {args.threads}")
    file = read_network_file(args.network)
    from videogrammetry.pipeline.adjust import adjust_file
    from videogrammetry.pipeline.adjust_output import OUTPUTS, write_adjustment
    from videogrammetry.report.network_report import network_report

    folder: Path = args.out or file.path.parent / "adjusted"
    new = not folder.exists()
    if new:
        nearest_folder(folder)
    else:
        for name in OUTPUTS:
            refuse_overwrite(folder / name, args.force)
    options = NetworkOptions(num_threads=args.threads)
    progress = Progress("adjust")
    try:
        done = adjust_file(file, options, progress=progress)
    finally:
        progress.close()
    page = network_report(done.result, file.path.parent.name or "network")
    if new:
        with atomic_folder(folder) as beside:
            write_adjustment(beside, done, options, page)
    else:
        write_adjustment(folder, done, options, page)
    for warning in done.result.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(summary(done.result), end="", file=sys.stderr)
    print(f"wrote {folder}", file=sys.stderr)
    return 0


def summary(result: NetworkAdjustment) -> str:
    """Table of the cameras and lines of totals."""
    rows = []
    for camera in result.cameras:
        sigma = camera.sigma["f"]
        rows.append(
            [
                camera.name,
                str(camera.num_images),
                str(camera.num_points),
                f"{camera.rms_px:.4f}",
                f"{camera.values['f']:.2f}",
                f"{sigma:.2f}" if "f" in camera.free else "held",
                " ".join(camera.free) or "none",
            ]
        )
    header = ["camera", "pictures", "points", "RMS px", "f px", "sigma f", "estimated"]
    s = result.summary
    kinds = Counter(r.kind for r in result.rejected)
    out = ", ".join(f"{n} {kind}{'s' * (n > 1)}" for kind, n in kinds.items()) or "nothing"
    total = (
        f"sigma0 {s.sigma0:.4f} ({s.sigma0_px:.5f} px), {s.observations} observations, "
        f"{s.unknowns} unknowns, redundancy {s.redundancy}, {s.points} points, datum {s.datum}\n"
        f"rejected: {out}\n"
    )
    return text_table(header, rows) + total
