"""What an export needs of measurement.h5: a view of the file with its names in one place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.types import FloatArray

#: The version of the file's layout that this program reads.
SCHEMA = 1


@dataclass(frozen=True, kw_only=True)
class Series:
    """A quantity of all points (or of the centroid) over the stages.

    ``value`` (stage, point, 3); ``sigma`` alike, NaN where unknown.
    """

    value: FloatArray
    sigma: FloatArray


class MeasurementFile:
    """An open measurement file; datasets are read when asked for."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        self.path = path
        self._file = file

    def __contains__(self, name: str) -> bool:
        return name in self._file

    def names(self) -> list[str]:
        """Names of all datasets and groups at the top."""
        return sorted(self._file)

    def array(self, name: str) -> np.ndarray[Any, Any]:
        """A dataset by its name; ProjectFileError if it is not there."""
        if name not in self._file:
            raise ProjectFileError(
                f"{self.path}: it holds no {name}; measure again with this version"
            )
        return np.asarray(self._file[name][()])

    @property
    def stage(self) -> np.ndarray[Any, Any]:
        """(S,) numbers of the stages, from 1."""
        if "stage" in self._file:
            return self.array("stage").astype(np.int64)
        return np.arange(1, len(self.array("position_mm")) + 1)

    @property
    def time_s(self) -> FloatArray:
        """(S,) times, NaN where there is no frame rate."""
        if "time_s" in self._file:
            return self.array("time_s").astype(float)
        return np.full(len(self.stage), np.nan)

    @property
    def point(self) -> tuple[str, ...]:
        """Names of the points: what the user gave, else their numbers."""
        numbers = [str(int(i)) for i in self.array("point_id")]
        if "point_name" not in self._file:
            return tuple(numbers)
        given = [n.decode() if isinstance(n, bytes) else str(n) for n in self.array("point_name")]
        return tuple(name or number for name, number in zip(given, numbers, strict=True))

    def series(self, name: str, cov: str) -> Series:
        """A quantity (stage, point, 3) or (stage, 3) and its sigmas from ``cov`` (..., 6)."""
        value = self.array(name).astype(float)
        sigma = np.full(value.shape, np.nan)
        if cov in self._file:
            variances = self.array(cov).astype(float)[..., [0, 3, 5]]
            sigma = np.sqrt(np.where(variances >= 0, variances, np.nan))
        if value.ndim == 2:
            value, sigma = value[:, None], sigma[:, None]
        return Series(value=value, sigma=sigma)

    def cameras(self) -> list[list[tuple[str, ...]]]:
        """Names of the cameras that saw each point in each stage: [stage][point]."""
        count = len(self.point)
        if "cameras_used" not in self._file:
            return [[()] * count for _ in self.stage]
        used = self.array("cameras_used")
        names = [n.decode() if isinstance(n, bytes) else str(n) for n in self.array("camera")]
        if used.ndim == 2:  # bit k stands for camera k
            bits = used.astype(np.uint64)[..., None] >> np.arange(len(names), dtype=np.uint64)
            used = (bits & np.uint64(1)).astype(bool)
        return [
            [tuple(n for n, seen in zip(names, row, strict=True) if seen) for row in stage]
            for stage in used
        ]


@contextmanager
def open_measurement(path: str | os.PathLike[str]) -> Iterator[MeasurementFile]:
    """Opens a measurement file to read from.

    Raises
    ------
    ProjectFileError
        Not there, no HDF5, damaged, not a measurement, or of a newer schema.
    """
    target = Path(path)
    if not target.is_file():
        raise ProjectFileError(f"{target}: there is no such measurement; run measure first")
    try:
        file = h5py.File(target, "r")
    except OSError as error:
        raise ProjectFileError(
            f"{target}: not a whole HDF5 file ({error}); copy it again, or measure again"
        ) from error
    with file:
        if "position_mm" not in file:
            raise ProjectFileError(f"{target}: this HDF5 file is no measurement: no position_mm")
        schema = int(file.attrs.get("schema", SCHEMA))
        if schema > SCHEMA:
            raise ProjectFileError(
                f"{target}: schema {schema} is newer than this program, which reads up to "
                f"{SCHEMA}; update videogrammetry"
            )
        try:
            yield MeasurementFile(target, file)
        except OSError as error:
            raise ProjectFileError(
                f"{target}: damaged, a part cannot be read ({error}); measure again"
            ) from error
