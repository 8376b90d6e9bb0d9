"""The measurement file, measurement.h5: HDF5 by netCDF-4's conventions.

Every dataset has its dimensions attached as scales, so that the file opens
with ``xarray.open_dataset`` and with any HDF5 viewer; units stand in the
attribute ``units``. Points and their motion lie on (stage, point, axis), the
targets seen on one ragged axis (target), sorted by stage and camera.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.project.atomic import atomic_path
from videogrammetry.types import COV6_ORDER, Measurement, Motion, TargetRecords, Trajectories

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


def write_measurement(path: str | os.PathLike[str], measurement: Measurement) -> None:
    """Writes a measurement, whole or not at all."""
    with atomic_path(path) as beside, h5py.File(beside, "w", track_order=True) as file:
        file.attrs["kind"] = _KIND
        file.attrs["schema"] = SCHEMA
        file.attrs["Conventions"] = "CF-1.10"
        file.attrs["provenance"] = json.dumps(measurement.provenance)
        file.attrs["warnings"] = json.dumps(list(measurement.warnings))
        file.attrs["reference_stage"] = measurement.motion.reference_stage
        if measurement.frame_rate_hz is not None:
            file.attrs["frame_rate_hz"] = measurement.frame_rate_hz
        _write_scales(file, measurement)
        _write_group(file, "", measurement.trajectories, _TRAJECTORIES)
        _write_group(file, "", measurement.motion, _MOTION)
        _write_group(file, "target_", measurement.targets, _TARGETS)
        for name, meanings in measurement.flag_meanings.items():
            attributes = file["target_" + name].attrs  # CF conventions, section 3.5
            attributes["flag_values"] = np.arange(len(meanings), dtype=np.uint8)
            attributes["flag_meanings"] = " ".join(m.replace(" ", "_") for m in meanings)
        for name in (n for n in _MOTION if "_cov_" in n and n != "centroid_cov_mm2"):
            file[name].attrs["comment"] = "from the image noise; the calibration is common to both"
        _write(file, "centroid_point_id", measurement.motion.centroid_points, ("centroid",), "1")
        names = np.array(measurement.image_name, dtype=object)
        text = h5py.string_dtype()
        _attach(file, file.create_dataset("image_name", data=names, dtype=text), _FRAME)


_FRAME = ("camera", "stage")


def _write_scales(file: h5py.File, measurement: Measurement) -> None:
    table = measurement.trajectories
    text = h5py.string_dtype()
    scales: dict[str, Any] = {
        "stage": table.stage,
        "point": np.arange(len(table.point_id), dtype=np.int32),
        "axis": np.array(["x", "y", "z"], dtype=object),
        "cov": np.array(COV6_ORDER, dtype=object),
        "camera": np.array(table.camera_names, dtype=object),
        "xy": np.array(["x", "y"], dtype=object),
        "target": np.arange(len(measurement.targets), dtype=np.int32),
        "centroid": np.arange(len(measurement.motion.centroid_points), dtype=np.int32),
    }
    for name, values in scales.items():
        dtype = text if values.dtype == object else values.dtype
        file.create_dataset(name, data=values, dtype=dtype).make_scale(name)
    _write(file, "point_id", table.point_id, ("point",), "1")


def _attach(file: h5py.File, dataset: h5py.Dataset, dimensions: tuple[str, ...]) -> None:
    for axis, dimension in enumerate(dimensions):
        dataset.dims[axis].attach_scale(file[dimension])


def _write(
    file: h5py.File, name: str, values: Any, dimensions: tuple[str, ...], units: str
) -> None:
    array = np.asarray(values)
    if array.dtype == bool:
        array = array.astype(np.uint8)
    options = {"compression": "gzip", "shuffle": True} if array.size > 4096 else {}
    dataset = file.create_dataset(name, data=array, **options)
    dataset.attrs["units"] = units
    _attach(file, dataset, dimensions)


def _write_group(
    file: h5py.File, prefix: str, record: Any, layout: Mapping[str, tuple[tuple[str, ...], str]]
) -> None:
    for name, (dimensions, units) in layout.items():
        _write(file, prefix + name, getattr(record, name), dimensions, units)


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

    trajectories = {name: file[name][()] for name in _TRAJECTORIES}
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
        provenance=json.loads(file.attrs["provenance"]),
        warnings=tuple(json.loads(file.attrs["warnings"])),
        flag_meanings={
            name: tuple(m.replace("_", " ") for m in attributes["flag_meanings"].split())
            for name in _TARGETS
            if "flag_meanings" in (attributes := file["target_" + name].attrs)
        },
    )
