"""Targets and sequences without distortion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from videogrammetry.errors import MeasurementError
from videogrammetry.geometry import ideal_camera, project, rays_through_pixels, undistort_points
from videogrammetry.pipeline.undistort import picture_names, undistort_targets
from videogrammetry.project import TargetTable
from videogrammetry.rendering.scenes.paper_rig import paper_rig

CAMERAS = {name: (c, ideal_camera(c)) for name, c in paper_rig().cameras.items()}


def table(seed=1, count=40, names=("cam1", "cam3")):
    rng = np.random.default_rng(seed)
    axes = np.sort(rng.uniform(4, 12, (count, 2)))[:, ::-1]
    sigma = rng.uniform(0.01, 0.05, (count, 2))
    sigma[3] = np.nan
    return TargetTable(
        image=tuple(f"img{i}.tif" for i in range(count)),
        camera=tuple(names[i % len(names)] for i in range(count)),
        stage=np.ones(count, dtype=np.int32),
        id=np.arange(count, dtype=np.int32),
        xy_px=rng.uniform(20, 1000, (count, 2)),
        semi_axes_px=axes,
        angle_rad=rng.uniform(0, np.pi, count),
        sigma_px=sigma,
    )


def test_centres_and_sigmas_are_the_cameras():
    before = table()
    after = undistort_targets(before, CAMERAS)
    for row, name in enumerate(before.camera):
        cov = np.diag(np.nan_to_num(before.sigma_px[row]) ** 2)[None]
        camera, ideal = CAMERAS[name]
        xy, turned = undistort_points(camera, before.xy_px[row][None], cov, ideal=ideal)
        # But for the lens' curve over the ellipse: test_ellipses_go_through_the_points.
        np.testing.assert_allclose(after.xy_px[row], xy[0], rtol=0, atol=0.06)
        if row != 3:
            np.testing.assert_allclose(after.sigma_px[row], np.sqrt(np.diag(turned[0])))
    assert np.isnan(after.sigma_px[3]).all()
    assert after.image == before.image
    np.testing.assert_array_equal(after.id, before.id)


def test_ellipses_go_through_the_points_on_them():
    before = table(seed=2)
    after = undistort_targets(before, CAMERAS)
    t = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    for row, name in enumerate(before.camera):
        camera, ideal = CAMERAS[name]
        a, b = before.semi_axes_px[row]
        c, s = np.cos(before.angle_rad[row]), np.sin(before.angle_rad[row])
        ring = np.stack([a * np.cos(t) * c - b * np.sin(t) * s,
                         a * np.cos(t) * s + b * np.sin(t) * c], axis=1)  # fmt: skip
        places = project(ideal, rays_through_pixels(camera, before.xy_px[row] + ring))
        off = places - after.xy_px[row]
        c, s = np.cos(after.angle_rad[row]), np.sin(after.angle_rad[row])
        along, across = off @ [c, s], off @ [-s, c]
        big, small = after.semi_axes_px[row]
        radius = np.hypot(along / big, across / small)
        # What is left of the curve after its shift of the centre is its third harmonic,
        # as large as that shift at most.
        plain = undistort_points(camera, before.xy_px[row][None], ideal=ideal)[0][0]
        shift = np.hypot(*(after.xy_px[row] - plain))
        assert np.abs(radius - 1).max() * small < shift + 2e-3
        # No first harmonic is left: the centre is the outline's.
        first = np.mean((radius - 1)[:, None] * np.stack([along, across], axis=1), axis=0)
        assert np.hypot(*first) < 1e-3
        assert big >= small


def test_rows_without_a_camera_take_the_one_that_is_named():
    before = dataclasses.replace(table(), camera=("",) * 40)
    with pytest.raises(MeasurementError, match=r"target 1 \(img0.tif\): no camera is named"):
        undistort_targets(before, CAMERAS)
    by_name = undistort_targets(before, CAMERAS, "cam2")
    only = undistort_targets(before, {"cam2": CAMERAS["cam2"]})
    np.testing.assert_array_equal(by_name.xy_px, only.xy_px)
    strange = dataclasses.replace(before, camera=("left",) * 40)
    with pytest.raises(MeasurementError, match="camera 'left' is not in the rig, which has cam1"):
        undistort_targets(strange, CAMERAS)


def test_an_empty_table_stays_empty():
    empty = table(count=0 + 4)
    none = TargetTable(
        **{
            f.name: (() if f.name in ("image", "camera") else getattr(empty, f.name)[:0])
            for f in dataclasses.fields(empty)
            if f.name != "id_confidence"
        }
    )
    assert len(undistort_targets(none, CAMERAS)) == 0


class Named:
    def __init__(self, *names):
        self._names = names

    def __len__(self):
        return len(self._names)

    def name(self, index):
        return self._names[index]


def test_pictures_keep_their_names():
    assert picture_names(Named("a.tif", "b.9.png")) == ["a", "b.9"]
    assert picture_names(Named("r.cihx#7", "r.cihx#12")) == ["r_000007", "r_000012"]
    assert picture_names(Named("a.tif", "a.png")) == ["a_000001", "a_000002"]
