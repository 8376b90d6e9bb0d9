"""The array API: what the C++ tests cannot see (conversion, names, errors)."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry._core import adjustment as native
from videogrammetry.adjustment import (
    AdjustOptions,
    Network,
    direct_linear_transform,
    resect,
    search_focal,
)
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import camera_model, project, rotation_from_vector
from videogrammetry.types import RigCamera

CAMERA = RigCamera(
    image_size_px=(1024, 1024), interior=np.r_[2000.0, 5, -3, 2e-8, np.zeros(6)], r0_px=400.0,
    rotation=np.eye(3), translation_mm=np.zeros(3),
)  # fmt: skip


def view(seed, relief_mm=100.0):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (25, 3)) * [300, 300, relief_mm]
    pose = rotation_from_vector(rng.uniform(-0.5, 0.5, 3)), np.array([10.0, 20, 2500])
    return points, project(CAMERA, points @ pose[0].T + pose[1]), pose


def test_options_equal_the_native_struct():
    options, struct = AdjustOptions(), native.AdjustOptions()
    for name in AdjustOptions.__dataclass_fields__:
        assert getattr(options, name) == getattr(struct, name), name


def test_resection_and_focal_search():
    points, pixels, pose = view(1)
    best = resect(camera_model(CAMERA), points, pixels)[0]
    assert np.allclose(best.rotation, pose[0], atol=1e-6)
    assert best.inliers == 25
    f_px, rms_px, contrast = search_focal(
        camera_model(CAMERA), [points], [pixels], threshold_px=14.0
    )
    assert abs(f_px / 2000 - 1) < 0.05
    assert rms_px < 0.5
    assert contrast > 1.5


def test_dlt_says_why_not():
    points, pixels, _ = view(2, relief_mm=0.0)
    with pytest.raises(CalibrationError, match="coplanar"):
        direct_linear_transform(points, pixels)
    with pytest.raises(ValueError, match="at least 6"):
        direct_linear_transform(points[:5], pixels[:5])
    with pytest.raises(ValueError, match=r"shape \(N, 3\)"):
        direct_linear_transform(pixels, pixels)


def test_rank_defect_names_the_unknowns():
    points, pixels, pose = view(3)
    network = Network()
    camera = network.add_camera("left", CAMERA, free=("f",))
    outer = network.add_pose("left", np.eye(3), np.zeros(3))  # free as well: no datum
    inner = network.add_pose("stage 1", *pose)
    image = network.add_image("left_1", camera, inner=inner, outer=outer)
    network.set_points(np.arange(25), points)
    network.set_observations(
        np.full(25, image), np.arange(25), pixels, np.tile([1e-4, 0, 1e-4], (25, 1))
    )
    with pytest.raises(CalibrationError, match="rank defect"):
        network.dispersion()


def test_priors_hold_a_parameter():
    points, pixels, pose = view(4)
    found = []
    for sigma in (1e-3, 1e3):
        network = Network()
        camera = network.add_camera(
            "left",
            CAMERA,
            free=("f",),
            prior_sigma={"f": sigma},
            start=np.r_[1990.0, CAMERA.interior[1:]],
        )
        inner = network.add_pose("stage 1", *pose)
        image = network.add_image("left_1", camera, inner=inner)
        network.set_points(np.arange(25), points)
        network.set_observations(
            np.full(25, image), np.arange(25), pixels, np.tile([1e-2, 0, 1e-2], (25, 1))
        )
        network.adjust(AdjustOptions(critical_value=0, estimate_floor=False))
        found.append(network.interior(camera)[0])
    # A prior of 1e-3 px beats any 25 points; one of 1e3 px says nothing.
    assert abs(found[0] - 1990) < 0.01
    assert abs(found[1] - 2000) < 0.01
