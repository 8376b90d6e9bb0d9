"""``videogrammetry recognize``: pictures -> targets CSV, and pictures with the targets drawn in."""

from __future__ import annotations

import argparse
import collections
import contextlib
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.cli.common import (
    SubParsers,
    UsageError,
    add_force,
    add_verb,
    refuse_overwrite_table,
)
from videogrammetry.cli.progress import Progress
from videogrammetry.pipeline.frames import map_bounded, read_and_recognize
from videogrammetry.project import format_targets, provenance, refuse_overwrite, target_table
from videogrammetry.project.atomic import nearest_folder
from videogrammetry.project.provenance import write_with_provenance
from videogrammetry.recognition import RING_STATUS, RecognitionOptions, code_family, recognize
from videogrammetry.report import write_overlay
from videogrammetry.sequence import JoinedSource, open_sequence
from videogrammetry.types import Targets

DIRECTIONS = ("clockwise", "counter-clockwise")
POLARITIES = ("white-on-black", "black-on-white")
ESTIMATORS = ("auto", "mean-gradient", "dual-conic", "model")


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "recognize",
        run,
        help="find coded and un-coded targets in pictures",
        description="Finds circular targets and their codes; writes a CSV with one row a target.",
        example="videogrammetry recognize 'left_*.tif' --out targets.csv --overlay overlays",
    )
    parser.add_argument(
        "inputs",
        nargs="+",
        metavar="INPUT",
        help="pictures, stacks, folders or quoted patterns (*, ?, [..], {a,b})",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="targets CSV, its provenance in FILE.provenance.json beside it (default: stdout)",
    )
    parser.add_argument(
        "--overlay", type=Path, metavar="DIR", help="write the pictures with the targets drawn in"
    )
    add_recognition_arguments(parser)
    add_force(parser)


def add_recognition_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of recognition, with the names of ``[targets]``."""
    default = RecognitionOptions()
    parser.add_argument(
        "--codes",
        default=default.codes,
        metavar="FAMILY",
        help="schneider-8 ... -20, metashape-12, -14, a table file, or none (default: %(default)s)",
    )
    parser.add_argument(
        "--direction",
        choices=DIRECTIONS,
        default=default.direction,
        help="how codes are read in the picture (default: %(default)s)",
    )
    parser.add_argument(
        "--polarity",
        choices=POLARITIES,
        default=default.polarity,
        help="of the dot on its ground (default: %(default)s)",
    )
    parser.add_argument(
        "--diameter-px",
        nargs=2,
        type=float,
        default=default.diameter_px,
        metavar=("MIN", "MAX"),
        help="smallest minor, largest major axis of a dot (default: 5 200)",
    )
    parser.add_argument(
        "--method", default=default.method, help="way of recognition (default: %(default)s)"
    )
    parser.add_argument(
        "--estimator",
        choices=ESTIMATORS,
        default=default.estimator,
        help="how dots are measured; model: slower, nearer to the noise (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Recognises all pictures, then writes; a bad one stops it before anything is written."""
    options = recognition_options_of(args)
    source = open_sequence(args.inputs, same_size=False)
    names = frame_names(source)
    overlays = [args.overlay / overlay_name(name) for name in names] if args.overlay else []
    _check_outputs(args.out, args.overlay, overlays, args.force)
    with _scratch_folder(args.overlay) as scratch:
        origin = _Origin(source, options) if args.out or args.overlay else None
        found = _recognize_all(source, names, options, scratch, origin)
        table = target_table((name, "", None, t) for name, t in zip(names, found, strict=True))
        if args.out is not None and origin is not None:
            # First: if it fails, no overlay is left behind.
            write_with_provenance(args.out, format_targets(table), origin.of_all)
        if scratch is not None:
            args.overlay.mkdir(parents=True, exist_ok=True)
            for path in overlays:
                os.replace(scratch / path.name, path)
    if args.out is None:
        sys.stdout.write(format_targets(table))
    coded = int((table.id >= 0).sum())
    print(
        f"{len(found)} pictures: {coded} coded, {len(table) - coded} un-coded targets"
        f"{_reasons(found)}",
        file=sys.stderr,
    )
    return 0


@contextlib.contextmanager
def _scratch_folder(overlay: Path | None) -> Iterator[Path | None]:
    """Where overlays wait until all are drawn; on the disk of their folder, to be moved at once."""
    if overlay is None:
        yield None
        return
    with tempfile.TemporaryDirectory(dir=nearest_folder(overlay), prefix=".overlay-") as scratch:
        yield Path(scratch)


def _reasons(found: list[Targets]) -> str:
    """Why targets have no ID, in the order of ``RING_STATUS``: `` (5 no ring, 2 ring cut)``."""
    status = np.concatenate([t.ring_status[t.id < 0] for t in found])
    counts = np.bincount(status, minlength=len(RING_STATUS)).tolist()
    parts = [f"{n} {name}" for n, name in zip(counts, RING_STATUS, strict=True) if n]
    return f" ({', '.join(parts)})" if parts else ""


class _Origin:
    """The provenance of the table, and of the overlay of each frame, which names its file alone."""

    def __init__(self, source: JoinedSource, options: RecognitionOptions) -> None:
        codes = [Path(options.codes)] if Path(options.codes).is_file() else []
        files = dict.fromkeys([*codes, *source.paths])
        self._source = source
        self._codes = codes
        self._made = provenance(options)
        self._hashes = {f: provenance(None, [f], Path.cwd())["inputs_sha256"] for f in files}
        self.of_all = self._of_files(files)

    def of_frame(self, index: int) -> dict[str, Any]:
        """As ``of_all``, of one frame."""
        return self._of_files([*self._codes, *self._source.files(index)])

    def _of_files(self, files: Iterable[Path]) -> dict[str, Any]:
        merged = {name: value for f in files for name, value in self._hashes[f].items()}
        return {**self._made, "inputs_sha256": merged}


def _check_outputs(
    out: Path | None, folder: Path | None, overlays: list[Path], force: bool
) -> None:
    """Raises for what cannot be written; overlays make their own folder."""
    if out is not None:
        refuse_overwrite_table(out, force)
    if folder is not None and nearest_folder(folder) == folder:
        for path in overlays:
            refuse_overwrite(path, force)


def recognition_options_of(args: argparse.Namespace) -> RecognitionOptions:
    """The options, tried on a blank picture: whatever is wrong with them shows there."""
    smallest, largest = args.diameter_px
    options = RecognitionOptions(
        codes=args.codes,
        direction=args.direction,
        polarity=args.polarity,
        diameter_px=(smallest, largest),
        method=args.method,
        estimator=args.estimator,
    )
    try:
        recognize(np.zeros((16, 16), np.uint8), options)
    except ValueError as error:
        if Path(options.codes).is_file():
            code_family(options.codes)  # a table that is wrong is named as it is
        # The message begins with the field's name; people know the option's.
        field, colon, rest = str(error).partition(": ")
        known = colon and field in RecognitionOptions.__dataclass_fields__
        option = f"--{field.replace('_', '-')}: {rest}" if known else f"--codes: {error}"
        raise UsageError(option) from error
    return options


def frame_names(source: JoinedSource) -> list[str]:
    """Names of all frames, with their folder where two files bear the same name."""
    names = [source.name(i) for i in range(len(source))]
    if len(set(names)) == len(names):
        return names
    files = [source.file(i) for i in range(len(source))]
    with_folder = [f"{f.parent.name}/{n}" for f, n in zip(files, names, strict=True)]
    if len(set(with_folder)) == len(names):
        return with_folder
    full = [f"{f.parent.as_posix()}/{n}" for f, n in zip(files, names, strict=True)]
    if len(set(full)) < len(full):
        twice = collections.Counter(full).most_common(1)[0][0]
        raise ValueError(f"{twice} is given twice: name every picture once")
    return full


def overlay_name(name: str) -> str:
    """File name of the overlay of a frame.

    Examples
    --------
    >>> overlay_name("left/img.tif"), overlay_name("stack.tif#3")
    ('left_img.tif.png', 'stack.tif_3.png')
    """
    safe = "".join("_" if c in '/\\:*?"<>|#' else c for c in name)
    return f"{safe}.png"


def _recognize_all(
    source: JoinedSource,
    names: list[str],
    options: RecognitionOptions,
    overlay: Path | None,
    origin: _Origin | None,
) -> list[Targets]:
    def one(index: int) -> Targets:
        targets = read_and_recognize(source, index, options)
        if overlay is not None and origin is not None:
            path = overlay / overlay_name(names[index])
            write_overlay(path, source.read(index), targets, names[index], origin.of_frame(index))
        return targets

    progress = Progress("recognize", "pictures")
    found: list[Targets] = []
    try:
        for targets in map_bounded(one, range(len(source))):
            found.append(targets)
            progress(len(found), len(source))
    finally:
        progress.close()
    return found
