"""measurement.h5 comes back as it was, opens elsewhere, and says what is wrong with it."""

from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest
import xarray
from measurement_fakes import fake_measurement

from videogrammetry.errors import ProjectFileError
from videogrammetry.project import read_measurement, write_measurement
from videogrammetry.types import CameraSeries


@pytest.fixture
def measurement():
    return fake_measurement()


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


def test_the_cameras_series_come_back(measurement, tmp_path):
    rng = np.random.default_rng(3)
    series = CameraSeries(
        stage=np.array([1, 3], np.int32),
        **{
            name: rng.normal(size=(2, 3, 3))
            for name in ("turn_rad", "shift_mm", "sigma_turn_rad", "sigma_shift_mm")
        },
        chi2=rng.uniform(size=(2, 3)),
        critical_chi2=45.0,
    )
    measurement = dataclasses.replace(measurement, stability=series)
    write_measurement(tmp_path / "m.h5", measurement)
    assert_same(measurement, read_measurement(tmp_path / "m.h5"))
    with xarray.open_dataset(tmp_path / "m.h5") as data:
        assert data["camera_turn_rad"].dims == ("look", "camera", "axis")
        assert data["camera_moved_chi2"].attrs["critical"] == 45.0
