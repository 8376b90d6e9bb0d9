"""The measurement file, measurement.h5: HDF5 by netCDF-4's conventions.

Every dataset has its dimensions attached as scales, so that the file opens
with ``xarray.open_dataset`` and with any HDF5 viewer; units stand in the
attribute ``units``. Points and their motion lie on (stage, point, axis), the
targets seen on one ragged axis (target), sorted by stage and camera.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.project.atomic import atomic_path
from videogrammetry.project.hdf5_blocks import DEFLATE, ROWS, Flusher, RowBuffer, write_block
from videogrammetry.project.hdf5_output import Hdf5Output, open_hdf5
from videogrammetry.types import (
    COV6_ORDER,
    POINT_FLAGS,
    CameraSeries,
    IntArray,
    Measurement,
    Motion,
    TargetRecords,
    Trajectories,
)

#: The version of the file's layout that this program writes and reads.
SCHEMA = 1
_KIND = "videogrammetry measurement"

_PER_POINT = ("stage", "point", "axis")
_PER_POINT_COV = ("stage", "point", "cov")
_PER_STAGE = ("stage", "axis")
_PER_STAGE_COV = ("stage", "cov")

# dataset -> (dimensions, units); the arrays of Trajectories and Motion by their names.
_TRAJECTORIES: Mapping[str, tuple[tuple[str, ...], str]] = {
    "time_s": (("stage",), "s"),
    "position_mm": (_PER_POINT, "mm"),
    "cov_mm2": (_PER_POINT_COV, "mm^2"),
    "cov_image_mm2": (_PER_POINT_COV, "mm^2"),
    "cameras_used": (("stage", "point", "camera"), "1"),
    "rms_px": (("stage", "point"), "px"),
    "flags": (("stage", "point"), "1"),
}
_MOTION: Mapping[str, tuple[tuple[str, ...], str]] = {
    "step_mm": (_PER_POINT, "mm"),
    "step_cov_mm2": (_PER_POINT_COV, "mm^2"),
    "displacement_mm": (_PER_POINT, "mm"),
    "displacement_cov_mm2": (_PER_POINT_COV, "mm^2"),
    "velocity_mm_s": (_PER_POINT, "mm/s"),
    "velocity_cov_mm2_s2": (_PER_POINT_COV, "mm^2/s^2"),
    "centroid_mm": (_PER_STAGE, "mm"),
    "centroid_cov_mm2": (_PER_STAGE_COV, "mm^2"),
    "centroid_displacement_mm": (_PER_STAGE, "mm"),
    "centroid_displacement_cov_mm2": (_PER_STAGE_COV, "mm^2"),
    "centroid_velocity_mm_s": (_PER_STAGE, "mm/s"),
    "centroid_velocity_cov_mm2_s2": (_PER_STAGE_COV, "mm^2/s^2"),
}
_TARGETS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "stage": (("target",), "1"),
    "camera": (("target",), "1"),
    "centre_px": (("target", "xy"), "px"),
    "semi_axes_px": (("target", "xy"), "px"),
    "angle_rad": (("target",), "rad"),
    "sigma_px": (("target", "xy"), "px"),
    "code_id": (("target",), "1"),
    "point_id": (("target",), "1"),
    "residual_px": (("target", "xy"), "px"),
    "match_status": (("target",), "1"),
    "ring_status": (("target",), "1"),
}

_PER_CAMERA = ("look", "camera", "axis")
# Of CameraSeries: dataset -> (attribute, dimensions, units).
_STABILITY: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "look_stage": ("stage", ("look",), "1"),
    "camera_turn_rad": ("turn_rad", _PER_CAMERA, "rad"),
    "camera_turn_sigma_rad": ("sigma_turn_rad", _PER_CAMERA, "rad"),
    "camera_shift_mm": ("shift_mm", _PER_CAMERA, "mm"),
    "camera_shift_sigma_mm": ("sigma_shift_mm", _PER_CAMERA, "mm"),
    "camera_moved_chi2": ("chi2", ("look", "camera"), "1"),
}

#: Points of a block of the file, and stages: blocks without a measured point take no room.
_BLOCK = (100, 64)


@dataclass(frozen=True, kw_only=True)
class MeasurementLayout:
    """What is known of a measurement before its series are written.

    Attributes
    ----------
    stage : (S,). point_id : (P,). camera_names : (C,). num_targets : over all stages.
    reference_stage, centroid_points : of the motion.
    image_name, frame_rate_hz, provenance, warnings, flag_meanings, stability : as in
        ``Measurement``.
    """

    stage: IntArray
    point_id: IntArray
    camera_names: tuple[str, ...]
    num_targets: int
    reference_stage: int
    centroid_points: IntArray
    image_name: Sequence[Sequence[str]]
    frame_rate_hz: float | None
    provenance: Mapping[str, Any]
    warnings: Sequence[str]
    flag_meanings: Mapping[str, tuple[str, ...]]
    stability: CameraSeries | None = None


class MeasurementWriter:
    """Writes a measurement part by part, so that it need not fit into memory."""

    def __init__(
        self, file: h5py.File, layout: MeasurementLayout, output: Hdf5Output, flusher: Flusher
    ) -> None:
        self._file, self._layout, self._output = file, layout, output
        self._open: dict[str, h5py.Dataset] = {}
        file.attrs["kind"] = _KIND
        file.attrs["schema"] = SCHEMA
        file.attrs["Conventions"] = "CF-1.10"
        file.attrs["provenance"] = json.dumps(layout.provenance)
        file.attrs["warnings"] = json.dumps(list(layout.warnings))
        file.attrs["reference_stage"] = layout.reference_stage
        if layout.frame_rate_hz is not None:
            file.attrs["frame_rate_hz"] = layout.frame_rate_hz
        self._write_scales()
        for prefix, names in (("", _TRAJECTORIES), ("", _MOTION), ("target_", _TARGETS)):
            for name, (dimensions, units) in names.items():
                self._create(prefix + name, _DTYPES.get(name, np.float64), dimensions, units)
        self._write_stability()
        self._explain()
        self._series = RowBuffer(self._open, len(layout.stage))
        self._targets = RowBuffer(self._open, layout.num_targets)
        self._flusher = flusher
        output.check()

    def points(self, row: int, columns: IntArray, part: Trajectories, motion: Motion) -> None:
        """Stages from ``row`` on, of the points at ``columns``; the others were not measured.

        In the order of the stages, every stage once.
        """
        rows = slice(row, row + len(part.stage))
        series = {}
        for name, (dimensions, _) in (*_TRAJECTORIES.items(), *_MOTION.items()):
            values = getattr(part if name in _TRAJECTORIES else motion, name)
            if dimensions[:2] == ("stage", "point"):
                self._write_columns(name, rows, columns, values)
            else:
                series[name] = values
        self._series.add(series)
        self._output.check()
        self._flusher.written(rows.stop)

    def targets(self, row: int, part: TargetRecords) -> None:
        """Targets from ``row`` on, in their order, every target once."""
        self._targets.add({"target_" + name: getattr(part, name) for name in _TARGETS})
        self._output.check()

    def _write_columns(self, name: str, rows: slice, columns: IntArray, values: Any) -> None:
        """Stages of a dataset, block of points by block; other points of a block are not there."""
        dataset, block = self._open[name], columns // _BLOCK[1]
        fill = np.nan if dataset.dtype.kind == "f" else 0
        height, width = dataset.chunks[:2] if dataset.chunks else (0, 0)
        whole = len(values) == height and rows.start % height == 0
        ends = np.flatnonzero(np.diff(block)) + 1
        for first, last in pairwise([0, *ends.tolist(), len(columns)]):
            if first == last:
                continue
            begin = int(block[first]) * _BLOCK[1]
            end = begin + width if whole else min(begin + _BLOCK[1], dataset.shape[1])
            part = values[:, first:last]
            if last - first < end - begin:
                part = np.full((len(values), end - begin, *values.shape[2:]), fill, dataset.dtype)
                part[:, columns[first:last] - begin] = values[:, first:last]
            if whole:
                write_block(dataset, (rows.start, begin), part)
            else:
                dataset[rows, begin:end] = part

    def _create(self, name: str, dtype: Any, dimensions: tuple[str, ...], units: str) -> None:
        shape = tuple(len(self._file[d]) for d in dimensions)
        options: dict[str, Any] = {}
        if dimensions[:2] == ("stage", "point") and 0 not in shape:
            sizes = (min(_BLOCK[0], shape[0]), min(_BLOCK[1], shape[1]))
            options["chunks"] = (*sizes, *shape[2:])
        elif shape[0] > _BLOCK[0]:
            options["chunks"] = (min(ROWS, shape[0]), *shape[1:])
        if np.dtype(dtype).kind != "f" and "chunks" in options:
            # Small numbers that repeat; noise of floating-point numbers is not worth the time.
            options |= {"compression": "gzip", "compression_opts": DEFLATE, "shuffle": True}
        fill = np.nan if np.dtype(dtype).kind == "f" else 0
        dataset = self._file.create_dataset(name, shape, dtype, fillvalue=fill, **options)
        dataset.attrs["units"] = units
        _attach(self._file, dataset, dimensions)
        self._open[name] = dataset

    def _write_scales(self) -> None:
        file, layout = self._file, self._layout
        text = h5py.string_dtype()
        scales: dict[str, Any] = {
            "stage": layout.stage,
            "point": np.arange(len(layout.point_id), dtype=np.int32),
            "axis": np.array(["x", "y", "z"], dtype=object),
            "cov": np.array(COV6_ORDER, dtype=object),
            "camera": np.array(layout.camera_names, dtype=object),
            "xy": np.array(["x", "y"], dtype=object),
            "target": np.arange(layout.num_targets, dtype=np.int32),
            "centroid": np.arange(len(layout.centroid_points), dtype=np.int32),
        }
        for name, values in scales.items():
            dtype = text if values.dtype == object else values.dtype
            file.create_dataset(name, data=values, dtype=dtype).make_scale(name)
        _write(file, "point_id", layout.point_id, ("point",), "1")
        _write(file, "centroid_point_id", layout.centroid_points, ("centroid",), "1")
        names = np.array(layout.image_name, dtype=object)
        _attach(file, file.create_dataset("image_name", data=names, dtype=text), _FRAME)

    def _write_stability(self) -> None:
        series = self._layout.stability
        if series is None:
            return
        look = np.arange(len(series.stage), dtype=np.int32)
        self._file.create_dataset("look", data=look).make_scale("look")
        for name, (attribute, dimensions, units) in _STABILITY.items():
            _write(self._file, name, getattr(series, attribute), dimensions, units)
        self._file["camera_moved_chi2"].attrs["critical"] = series.critical_chi2

    def _explain(self) -> None:
        for name, meanings in self._layout.flag_meanings.items():
            attributes = self._file["target_" + name].attrs  # CF conventions, section 3.5
            attributes["flag_values"] = np.arange(len(meanings), dtype=np.uint8)
            attributes["flag_meanings"] = " ".join(m.replace(" ", "_") for m in meanings)
        attributes = self._file["flags"].attrs
        attributes["flag_masks"] = 1 << np.arange(len(POINT_FLAGS), dtype=np.uint8)
        attributes["flag_meanings"] = " ".join(POINT_FLAGS)
        for name in (n for n in _MOTION if "_cov_" in n and n != "centroid_cov_mm2"):
            attributes = self._file[name].attrs
            attributes["comment"] = "from the image noise; the calibration is common to both"


_FRAME = ("camera", "stage")
_DTYPES = {
    "stage": np.int32,
    "camera": np.int32,
    "code_id": np.int32,
    "point_id": np.int32,
    "cameras_used": np.uint8,
    "flags": np.uint8,
    "match_status": np.uint8,
    "ring_status": np.uint8,
}


@contextlib.contextmanager
def open_measurement_writer(
    path: str | os.PathLike[str], layout: MeasurementLayout
) -> Iterator[MeasurementWriter]:
    """A writer of a file that is whole when the block ends well, else not there.

    Raises
    ------
    OSError
        The disk is full: from the writer's methods, or when the block ends.
    """
    with (
        atomic_path(path) as beside,
        contextlib.closing(Flusher(beside)) as flusher,
        open_hdf5(beside) as (file, output),
    ):
        yield MeasurementWriter(file, layout, output, flusher)


def write_measurement(path: str | os.PathLike[str], measurement: Measurement) -> None:
    """Writes a measurement, whole or not at all."""
    table, motion = measurement.trajectories, measurement.motion
    layout = MeasurementLayout(
        stage=table.stage,
        point_id=table.point_id,
        camera_names=table.camera_names,
        num_targets=len(measurement.targets),
        reference_stage=motion.reference_stage,
        centroid_points=motion.centroid_points,
        image_name=measurement.image_name,
        frame_rate_hz=measurement.frame_rate_hz,
        provenance=measurement.provenance,
        warnings=measurement.warnings,
        flag_meanings=measurement.flag_meanings,
        stability=measurement.stability,
    )
    with open_measurement_writer(path, layout) as writer:
        writer.points(0, np.arange(len(table.point_id), dtype=np.int32), table, motion)
        writer.targets(0, measurement.targets)


def _attach(file: h5py.File, dataset: h5py.Dataset, dimensions: tuple[str, ...]) -> None:
    for axis, dimension in enumerate(dimensions):
        dataset.dims[axis].attach_scale(file[dimension])


def _write(
    file: h5py.File, name: str, values: Any, dimensions: tuple[str, ...], units: str
) -> None:
    dataset = file.create_dataset(name, data=np.asarray(values))
    dataset.attrs["units"] = units
    _attach(file, dataset, dimensions)


def read_measurement(path: str | os.PathLike[str]) -> Measurement:
    """Reads a measurement file.

    Raises
    ------
    ProjectFileError
        Not there, damaged or truncated, not a measurement, or of a newer schema.
    """
    file_path = Path(path)
    if not file_path.is_file():
        raise ProjectFileError(
            f"{file_path}: there is no such measurement file; `videogrammetry measure PROJECT` "
            "makes it"
        )
    try:
        with h5py.File(file_path, "r") as file:
            _check(file, file_path)
            return _read(file)
    except (OSError, KeyError, RuntimeError) as error:
        if isinstance(error, ProjectFileError):
            raise
        raise ProjectFileError(
            f"{file_path}: the file is damaged or truncated ({error}); measure again or restore "
            "it from a copy"
        ) from error


def _stability(file: h5py.File) -> CameraSeries | None:
    if "camera_moved_chi2" not in file:
        return None
    return CameraSeries(
        critical_chi2=float(file["camera_moved_chi2"].attrs["critical"]),
        **{attribute: file[name][()] for name, (attribute, _, _) in _STABILITY.items()},
    )


def _check(file: h5py.File, path: Path) -> None:
    if file.attrs.get("kind") != _KIND:
        raise ProjectFileError(
            f"{path}: this HDF5 file was not written by videogrammetry measure; give the "
            "measurement.h5 of a project"
        )
    schema = int(file.attrs["schema"])
    if schema > SCHEMA:
        raise ProjectFileError(
            f"{path}: schema {schema} is newer than this program, which reads up to {SCHEMA}: "
            "update videogrammetry"
        )


def _read(file: h5py.File) -> Measurement:
    def strings(name: str) -> Any:
        return file[name].asstr()[()]

    # Files of before there were flags have none.
    trajectories = {name: file[name][()] for name in _TRAJECTORIES if name in file}
    trajectories["cameras_used"] = trajectories["cameras_used"].astype(bool)
    rate = file.attrs.get("frame_rate_hz")
    return Measurement(
        trajectories=Trajectories(
            stage=file["stage"][()],
            point_id=file["point_id"][()],
            camera_names=tuple(strings("camera")),
            **trajectories,
        ),
        motion=Motion(
            reference_stage=int(file.attrs["reference_stage"]),
            centroid_points=file["centroid_point_id"][()],
            **{name: file[name][()] for name in _MOTION},
        ),
        targets=TargetRecords(**{name: file["target_" + name][()] for name in _TARGETS}),
        image_name=tuple(tuple(row) for row in strings("image_name")),
        frame_rate_hz=None if rate is None else float(rate),
        stability=_stability(file),
        provenance=json.loads(file.attrs["provenance"]),
        warnings=tuple(json.loads(file.attrs["warnings"])),
        flag_meanings={
            name: tuple(m.replace("_", " ") for m in attributes["flag_meanings"].split())
            for name in _TARGETS
            if "flag_meanings" in (attributes := file["target_" + name].attrs)
        },
    )
