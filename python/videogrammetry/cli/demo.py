"""``videogrammetry demo``: the paper's experiments, rendered and measured end to end."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

from videogrammetry.cli.common import SubParsers, UsageError, add_verb
from videogrammetry.project import plain, write_text


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "demo",
        run,
        help="render the paper's experiments and measure them end to end",
        description="Renders what the paper's four cameras would have recorded, calibrates, "
        "measures the falling tyre and the scale bars, and sets paper, result and truth side by "
        "side: a table here, and DIR/index.html with the pictures.",
        example="videogrammetry demo demo --full",
    )
    parser.add_argument(
        "dir", type=Path, nargs="?", default=Path("demo"), metavar="DIR",
        help="folder to make (default: demo); must not exist",
    )  # fmt: skip
    add = parser.add_argument
    add(
        "--full",
        action="store_true",
        help="the paper's size: 24 orientations, 200 stages (2 GB) instead of 12 and 40 (0.5 GB)",
    )
    add(
        "--contrast-noise",
        type=float,
        default=75.0,
        metavar="R",
        help="grey-value step of a dot over the noise at white (default: 75)",
    )
    add(
        "--occluded",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="targets hidden at random in the moving scenes (default: 0)",
    )
    add(
        "--missing",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="stages of them at which one camera's picture is empty (default: 0)",
    )
    add(
        "--blur-px",
        type=float,
        metavar="PX",
        help="motion blur of the fastest target (default: that of 200 microseconds)",
    )
    add("--seed", type=int, default=1, help="of everything random (default: 1)")  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Runs the experiments, prints the table, writes the page."""
    from videogrammetry.cli.demo_page import demo_page
    from videogrammetry.cli.demo_run import FULL, SMALL, DemoOptions, run_demo
    from videogrammetry.cli.demo_table import comparison_rows, losses, terminal_table
    from videogrammetry.rendering.disturbances import Conditions
    from videogrammetry.sequence import check_free_space

    folder: Path = args.dir
    if os.path.lexists(folder):
        raise FileExistsError(
            f"{folder} is there already, and nothing is overwritten: name another folder, or "
            "remove it"
        )
    try:
        options = DemoOptions(
            size=FULL if args.full else SMALL,
            conditions=Conditions(
                contrast_noise=args.contrast_noise, occluded=args.occluded, missing=args.missing,
                seed=args.seed,
            ),
            blur_px=args.blur_px,
        )  # fmt: skip
    except ValueError as error:
        raise UsageError(str(error)) from error
    check_free_space(folder, options.size.recorded_bytes)
    start = time.perf_counter()
    try:
        results = run_demo(folder, options, lambda text: print(text, file=sys.stderr))
    except BaseException:
        if folder.is_dir():
            print(
                f"demo: {folder} holds what was done so far, without index.html; remove it before "
                "the next try",
                file=sys.stderr,
            )
        raise
    print("4. draw the page", file=sys.stderr)
    rows = comparison_rows(results)
    document = {"rows": rows, "seconds": results.seconds, "options": options}
    write_text(folder / "results.json", json.dumps(plain(document), indent=1) + "\n")
    # The page comes last: where it stands, all that it shows is there.
    write_text(folder / "index.html", demo_page(results, rows))
    print(terminal_table(rows), end="")
    for line in losses(results):
        print(line)
    print(f"all of it in {time.perf_counter() - start:.0f} s; open {folder / 'index.html'}")
    return 0
