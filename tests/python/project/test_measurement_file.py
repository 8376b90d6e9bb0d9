"""measurement.h5 comes back as it was, opens elsewhere, and says what is wrong with it."""

from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest
import xarray

from videogrammetry.errors import ProjectFileError
from videogrammetry.motion import compute_motion
from videogrammetry.project import read_measurement, write_measurement
from videogrammetry.types import Measurement, TargetRecords, Trajectories

STAGES, POINTS, CAMERAS, TARGETS = 4, 5, 3, 17


@pytest.fixture
def measurement():
    rng = np.random.default_rng(1)
    position = rng.normal(size=(STAGES, POINTS, 3))
    position[2, 1] = np.nan
    cov = np.abs(rng.normal(size=(STAGES, POINTS, 6)))
    table = Trajectories(
        stage=np.arange(1, STAGES + 1, dtype=np.int32),
        time_s=np.arange(STAGES) / 50.0,
        point_id=np.array([3, 7, 9, 517, 518], dtype=np.int32),
        position_mm=position,
        cov_mm2=cov,
        cov_image_mm2=cov / 2,
        cameras_used=rng.uniform(size=(STAGES, POINTS, CAMERAS)) > 0.3,
        rms_px=rng.uniform(size=(STAGES, POINTS)),
        camera_names=("left", "right", "oben"),
    )
    targets = TargetRecords(
        stage=np.sort(rng.integers(1, STAGES + 1, TARGETS)).astype(np.int32),
        camera=rng.integers(0, CAMERAS, TARGETS).astype(np.int32),
        centre_px=rng.normal(size=(TARGETS, 2)),
        semi_axes_px=rng.normal(size=(TARGETS, 2)),
        angle_rad=rng.normal(size=TARGETS),
        sigma_px=rng.normal(size=(TARGETS, 2)),
        code_id=rng.integers(-1, 9, TARGETS).astype(np.int32),
        point_id=rng.integers(-1, 9, TARGETS).astype(np.int32),
        residual_px=rng.normal(size=(TARGETS, 2)),
        match_status=rng.integers(0, 5, TARGETS).astype(np.uint8),
        ring_status=rng.integers(0, 5, TARGETS).astype(np.uint8),
    )
    return Measurement(
        trajectories=table,
        motion=compute_motion(table),
        targets=targets,
        image_name=tuple(tuple(f"{c}{s}.tif" for s in range(STAGES)) for c in range(CAMERAS)),
        frame_rate_hz=50.0,
        provenance={"version": "0", "options": {"a": [1, None]}},
        warnings=("a warning",),
        flag_meanings={"ring_status": ("coded", "no ring", "ring cut")},
    )


def assert_same(a, b):
    for field in dataclasses.fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if dataclasses.is_dataclass(x):
            assert_same(x, y)
        elif isinstance(x, np.ndarray):
            assert x.dtype == y.dtype, field.name
            np.testing.assert_array_equal(x, y, err_msg=field.name)
        else:
            assert x == y, field.name


def test_round_trip(measurement, tmp_path):
    write_measurement(tmp_path / "m.h5", measurement)
    assert_same(measurement, read_measurement(tmp_path / "m.h5"))
    assert [p.name for p in tmp_path.iterdir()] == ["m.h5"]


def test_without_a_frame_rate(measurement, tmp_path):
    bare = dataclasses.replace(measurement, frame_rate_hz=None)
    write_measurement(tmp_path / "m.h5", bare)
    assert read_measurement(tmp_path / "m.h5").frame_rate_hz is None


@pytest.mark.peer
def test_xarray_opens_it(measurement, tmp_path):
    write_measurement(tmp_path / "m.h5", measurement)
    with xarray.open_dataset(tmp_path / "m.h5", engine="h5netcdf") as data:
        assert data["position_mm"].dims == ("stage", "point", "axis")
        assert data["cov_mm2"].dims == ("stage", "point", "cov")
        assert data["position_mm"].attrs["units"] == "mm"
        assert list(data["camera"].values) == ["left", "right", "oben"]
        picked = data["position_mm"].sel(stage=3, axis="y")
        np.testing.assert_array_equal(picked, measurement.trajectories.position_mm[2, :, 1])


def test_damage_is_named(measurement, tmp_path):
    path = tmp_path / "m.h5"
    with pytest.raises(ProjectFileError, match="no such measurement file"):
        read_measurement(path)
    write_measurement(path, measurement)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ProjectFileError, match=r"m\.h5: the file is damaged or truncated"):
        read_measurement(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(ProjectFileError, match="not written by videogrammetry"):
        read_measurement(path)
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = 99
    with pytest.raises(ProjectFileError, match="schema 99 is newer"):
        read_measurement(path)
