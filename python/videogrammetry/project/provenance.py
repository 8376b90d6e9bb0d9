"""What made a file: program, version, options, hashes of the inputs, time."""

from __future__ import annotations

import dataclasses
import datetime
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.project.atomic import atomic_path
from videogrammetry.version import __version__

#: Files beyond this are known by samples: a recording of 100 GB would take minutes to hash.
_WHOLE_BYTES = 1 << 28
_SAMPLES, _SAMPLE_BYTES = 64, 1 << 16


def sha256_of(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's bytes, in hex.

    Of a file over 256 MiB ``sampled:`` and that of its size in decimal digits followed by 64
    pieces of 64 KiB, which begin at ``i (size - 65536) // 63``, i = 0 to 63.
    """
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size <= _WHOLE_BYTES:
            return hashlib.file_digest(file, "sha256").hexdigest()
        digest = hashlib.sha256(str(size).encode())
        for i in range(_SAMPLES):
            file.seek(i * (size - _SAMPLE_BYTES) // (_SAMPLES - 1))
            digest.update(file.read(_SAMPLE_BYTES))
        return "sampled:" + digest.hexdigest()


def provenance(
    options: Any = None,
    inputs: Iterable[str | os.PathLike[str]] = (),
    base_dir: str | os.PathLike[str] | None = None,
) -> dict[str, Any]:
    """What every output carries, ready for JSON.

    Parameters
    ----------
    options : a dataclass, a mapping, or None.
    inputs : files whose SHA-256 is noted, under their names relative to
        ``base_dir`` where they lie in it.

    Examples
    --------
    >>> sorted(provenance({"method": "joint"}))
    ['inputs_sha256', 'options', 'program', 'time_utc', 'version']
    """
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return {
        "program": "videogrammetry",
        "version": __version__,
        "time_utc": now.replace("+00:00", "Z"),
        "options": plain(options if options is not None else {}),
        "inputs_sha256": {_name(path, base_dir): sha256_of(path) for path in inputs},
    }


def provenance_path(path: str | os.PathLike[str]) -> Path:
    """Where the provenance of a file lies that cannot hold it: beside the file.

    Examples
    --------
    >>> provenance_path("targets.csv").name
    'targets.csv.provenance.json'
    """
    return Path(path).with_name(f"{Path(path).name}.provenance.json")


def write_with_provenance(
    path: str | os.PathLike[str], text: str, origin: Mapping[str, Any]
) -> None:
    """Writes text and its provenance beside it; what cannot be written whole leaves neither."""
    # The text takes its place first: no provenance ever stands beside an older text.
    with atomic_path(provenance_path(path)) as origin_beside, atomic_path(path) as beside:
        beside.write_bytes(text.encode())
        origin_beside.write_bytes((json.dumps(plain(origin), indent=1) + "\n").encode())


def _name(path: str | os.PathLike[str], base_dir: str | os.PathLike[str] | None) -> str:
    if base_dir is not None:
        absolute, base = Path(path).resolve(), Path(base_dir).resolve()
        if absolute.is_relative_to(base):
            return absolute.relative_to(base).as_posix()
    return Path(path).as_posix()


def plain(value: Any) -> Any:
    """The same in dicts, lists, numbers and strings alone; NaN and infinity become None.

    Examples
    --------
    >>> plain({"size": np.array([1, 2]), "where": Path("a") / "b", "sigma": float("nan")})
    {'size': [1, 2], 'where': 'a/b', 'sigma': None}
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, os.PathLike):
        return Path(value).as_posix()
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, str | int | bool) or value is None:
        return value
    if isinstance(value, Iterable):
        return [plain(v) for v in value]
    return str(value)
