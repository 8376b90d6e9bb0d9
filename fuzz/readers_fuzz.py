"""Damaged files for all readers: nothing but SequenceError may come out, quickly and in little.

``readers_fuzz.py [--seconds 60] [--seed 1] [--guided]``: the same seed gives the same files.
With ``--guided`` (and atheris installed) what of our code is reached guides the damage. A file
that fails is kept in build/fuzz and named.
"""

from __future__ import annotations

import argparse
import faulthandler
import inspect
import os
import random
import shutil
import struct
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from reader_seeds import Seed, all_seeds

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import check_synchronous, open_sequence

#: A machine with other work on it takes a hundred times the usual 3 ms; a minute is a loop.
MOST_SECONDS, HANGS_SECONDS = 10.0, 60
MOST_BYTES = 3 << 30
#: Numbers at which sizes and places overflow.
NUMBERS = (0, 1, 2, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0xFFFFFFFF, 10**9)
WORDS = (
    b"0",
    b"-1",
    b"1e9",
    b"nan",
    b"inf",
    b"999999999",
    b"1000000000000000000",
    b"\xff\xfe",
    b"",
)
KEPT = Path("build/fuzz")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A few changes, most of them where headers stand: at the beginning and the end."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        if not out:
            break
        where = rng.random()
        at = rng.randrange(len(out))
        if where < 0.5:
            at = rng.randrange(min(len(out), rng.choice((64, 256, 2048))))
        elif where < 0.7:
            at = len(out) - 1 - rng.randrange(min(len(out), 256))
        _change(out, at, rng)
    return bytes(out)


def _change(out: bytearray, at: int, rng: random.Random) -> None:
    kind = rng.randrange(8)
    if kind == 0:
        out[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        out[at] = rng.randrange(256)
    elif kind == 2:
        order, code = rng.choice("<>"), rng.choice("HIQ")
        number = rng.choice(NUMBERS) & (2 ** (8 * struct.calcsize("<" + code)) - 1)
        number = rng.choice((number, 2 ** (8 * struct.calcsize("<" + code)) - 1))
        packed = struct.pack(order + code, number)
        out[at : at + len(packed)] = packed[: len(out) - at]
    elif kind == 3:
        del out[rng.randrange(len(out)) :]
    elif kind == 4:
        del out[at : at + rng.choice((1, 2, 4, 16, 100))]
    elif kind == 5:
        begin = rng.randrange(len(out))
        out[at:at] = out[begin : begin + rng.choice((1, 4, 12, 100))]
    elif kind == 6:
        end = min(len(out), at + rng.choice((2, 8, 64)))
        out[at:end] = bytes([rng.choice((0, 255))]) * (end - at)
    else:  # a number or a word in a text
        end = at
        while end < len(out) and chr(out[end]).isalnum():
            end += 1
        out[at:end] = rng.choice(WORDS)


def case_of(seed: Seed, rng: random.Random) -> Seed:
    """A damaged file; of a recording either of the two."""
    suffix, header, samples = seed
    if samples and rng.random() < 0.2:
        return suffix, header, damaged(samples, rng)
    header = damaged(header, rng)
    if suffix == ".png" and rng.random() < 0.7:
        header = _with_right_sums(header)
    return suffix, header, samples


def _with_right_sums(data: bytes) -> bytes:
    """A PNG file whose chunks have the check sums of what is in them, to come past that check."""
    out, at = bytearray(data), 8
    while at + 12 <= len(out):
        end = at + 8 + int.from_bytes(out[at : at + 4], "big")
        if end + 4 > len(out):
            break
        out[end : end + 4] = zlib.crc32(out[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return bytes(out)


def run_case(folder: Path, case: Seed) -> bool:
    """Opens and reads; whether it could be. What is no SequenceError goes through."""
    suffix, header, samples = case
    path = folder / f"case{suffix}"
    path.write_bytes(header)
    if suffix in (".cihx", ".cih"):
        path.with_suffix(".mraw").write_bytes(samples)
    try:
        source = open_sequence(path)
        count = len(source)
        for index in {0, 1, count // 2, count - 1}:
            if index < count:
                frame = source.read(index)
                assert frame.shape == source.image_size_px_of(index)[::-1], "shape"
                assert frame.dtype in ("uint8", "uint16"), "type"
                assert frame.flags.c_contiguous, "order"
                source.name(index)
                source.packed(index)
        times = source.times_s()
        assert times is None or len(times) == count, "time stamps"
        check_synchronous({"a": source, "b": source})
    except SequenceError as error:
        text = str(error)
    else:
        return True
    assert os.fspath(path.with_suffix("")) in text, f"names no file: {text}"
    assert "\n" not in text, f"more than a paragraph: {text}"
    return False


def run(seconds: float, seed: int) -> int:
    """Own damage until the time is over; the number of failures."""
    rng = random.Random(seed)
    seeds = all_seeds()
    counts: dict[str, list[int]] = {s[0]: [0, 0] for s in seeds}
    failures, slowest, number = 0, 0.0, 0
    folder = Path(tempfile.mkdtemp(prefix="readers-fuzz-"))
    for whole in seeds:
        if not run_case(folder, whole):
            raise AssertionError(f"a valid {whole[0]} file is refused")
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        case = case_of(seeds[number % len(seeds)], rng)
        number += 1
        began = time.monotonic()
        faulthandler.dump_traceback_later(HANGS_SECONDS, exit=True, file=sys.stderr)
        try:
            good = run_case(folder, case)
            counts[case[0]][0] += 1
            counts[case[0]][1] += good
            took = time.monotonic() - began
            assert took < MOST_SECONDS, f"took {took:.1f} s"
        except Exception as error:
            failures += 1
            kept = _keep(case, number)
            print(f"case {number}: {type(error).__name__}: {error}; kept as {kept}")
            if failures <= 3:
                sys.excepthook(*sys.exc_info())
        slowest = max(slowest, time.monotonic() - began)
        faulthandler.cancel_dump_traceback_later()
    shutil.rmtree(folder)
    print(f"readers, seed {seed}: {number} files, slowest {slowest:.2f} s, {failures} failures")
    print("  " + ", ".join(f"{s} {n} ({good} read)" for s, (n, good) in counts.items()))
    return failures


def _keep(case: Seed, number: int) -> Path:
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"reader-{number}{case[0]}"
    path.write_bytes(case[1])
    if case[2]:
        path.with_suffix(".mraw").write_bytes(case[2])
    return path


def run_guided(seconds: float, seed: int) -> None:
    """Damage that atheris guides: a byte for the format, the header's length, the two files."""
    import atheris

    _instrument(atheris.instrument_func)
    seeds = all_seeds()
    folder = Path(tempfile.mkdtemp(prefix="readers-fuzz-"))
    corpus = KEPT / "readers-corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for k, (_, header, samples) in enumerate(seeds):
        (corpus / f"seed{k}").write_bytes(_joined(k, header, samples))

    def one(data: bytes) -> None:
        if len(data) >= 5:
            run_case(folder, _split(data, seeds))

    def mutate(data: bytes, most: int, number: int) -> bytes:
        rng = random.Random(number)
        if len(data) < 5:
            return _joined(*_numbered(rng.randrange(len(seeds)), seeds))[:most]
        _, header, samples = case_of(_split(data, seeds), rng)
        return _joined(data[0], header, samples)[:most]

    atheris.Setup(
        [sys.argv[0], f"-max_total_time={int(seconds)}", f"-seed={seed}", "-max_len=16384",
         f"-timeout={HANGS_SECONDS}", f"-rss_limit_mb={MOST_BYTES >> 20}",
         f"-artifact_prefix={KEPT}/", str(corpus)],
        one, custom_mutator=mutate,
    )  # fmt: skip
    atheris.Fuzz()


def _instrument(instrument: Callable[[Any], Any]) -> None:
    """Counts the branches of all functions of the readers, in place.

    The import hook of atheris does not see packages that are installed in place.
    """
    for name, module in sorted(sys.modules.items()):
        if name.startswith("videogrammetry.sequence."):
            for thing in vars(module).values():
                members = vars(thing).values() if inspect.isclass(thing) else [thing]
                for member in members:
                    function = member.fget if isinstance(member, property) else member
                    if inspect.isfunction(function) and function.__module__ == name:
                        instrument(function)


def _numbered(k: int, seeds: list[Seed]) -> tuple[int, bytes, bytes]:
    return k, seeds[k][1], seeds[k][2]


def _joined(k: int, header: bytes, samples: bytes) -> bytes:
    return struct.pack("<BI", k, len(header)) + header + samples


def _split(data: bytes, seeds: list[Seed]) -> Seed:
    k, length = struct.unpack_from("<BI", data)
    return seeds[k % len(seeds)][0], data[5 : 5 + length], data[5 + length :]


def limit_memory() -> None:
    """Memory that a damaged size asks for is refused by the system, where it has that."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))


def silence_libraries() -> None:
    """libtiff writes to the process's own standard error; ours stays where it was."""
    ours = os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 2)
    os.close(silent)
    sys.stderr = os.fdopen(ours, "w", buffering=1)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--guided", action="store_true")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    import logging

    logging.getLogger("tifffile").setLevel(logging.CRITICAL + 1)
    if args.guided:
        run_guided(args.seconds, args.seed)
        return 0
    limit_memory()
    silence_libraries()
    return 1 if run(args.seconds, args.seed) else 0


if __name__ == "__main__":
    sys.exit(main())
