"""Entry of the command: finds the verb, runs it, turns errors into one paragraph.

Exit status: 0 done; 1 the work failed, standard error says why, where and what
to do; 2 wrong usage (argparse, or UsageError); 130 interrupted.
"""

from __future__ import annotations

import argparse
import functools
import io
import logging
import os
import sys
import warnings
from collections.abc import Sequence

from videogrammetry.cli import (
    adjust,
    calibrate,
    demo,
    doctor,
    export,
    info,
    measure,
    measure_target,
    motion,
    plan,
    recognize,
    simulate,
    undistort,
    verify,
)
from videogrammetry.cli.common import UsageError
from videogrammetry.errors import MeasurementWarning, SequenceWarning, VideogrammetryError
from videogrammetry.version import __version__

VERBS = (
    demo,
    simulate,
    recognize,
    adjust,
    measure_target,
    calibrate,
    measure,
    motion,
    verify,
    plan,
    export,
    undistort,
    info,
    doctor,
)


#: Warnings that are shown as one paragraph.
_OURS = (SequenceWarning, MeasurementWarning)


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="videogrammetry",
        description="3-D motion from the pictures of synchronised cameras.",
        epilog="videogrammetry VERB --help explains a verb and has an example.",
    )
    parser.add_argument("--version", action="version", version=f"videogrammetry {__version__}")
    parser.add_argument(
        "--traceback", action="store_true", help="let errors show where in the program they arose"
    )
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for verb in VERBS:
        verb.add_parser(verbs)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line ``argv`` (None: the process's own); returns the exit status."""
    args = build_parser().parse_args(argv)
    # Names of files need not be text in the terminal's encoding: their bytes go through.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="surrogateescape")
    # tifffile reports damage to the log as well as by what it returns; ours is the message.
    logging.getLogger("tifffile").setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            for category in _OURS:
                warnings.simplefilter("always", category)
            warnings.showwarning = functools.partial(_show_warning, args.verb)
            status = int(args.run(args))
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        print("videogrammetry: interrupted; nothing was left half-written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever read our output has left (| head); Python must not complain at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (VideogrammetryError, OSError, ValueError) as error:
        if args.traceback:
            raise
        print(f"videogrammetry {args.verb}: {paragraph(error)}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1


def _show_warning(
    verb: str,
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    *rest: object,
) -> None:
    """What the library warns of as one paragraph; other warnings as Python shows them."""
    if issubclass(category, _OURS):
        print(f"videogrammetry {verb}: warning: {' '.join(str(message).split())}", file=sys.stderr)
    else:
        sys.stderr.write(warnings.formatwarning(message, category, filename, lineno))


def paragraph(error: Exception) -> str:
    """The error's message on one line.

    Examples
    --------
    >>> paragraph(FileNotFoundError(2, "No such file or directory", "a.csv"))
    'a.csv: No such file or directory'
    """
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{os.fspath(error.filename)}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
