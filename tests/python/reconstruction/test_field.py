"""The calibration's field in the pictures, against cameras drawn from their covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from videogrammetry._core import reconstruction as core
from videogrammetry.geometry import CAMERA_PARAMETERS, fit_rigid, project
from videogrammetry.reconstruction import CalibrationField, Rig, Triangulator
from videogrammetry.types import RigCamera

SIGMAS = {
    "f": 0.8,
    "x0": 1.4,
    "y0": 1.3,
    "rx": 3e-5,
    "ry": 3e-5,
    "rz": 3e-5,
    "tx": 0.2,
    "ty": 0.3,
    "tz": 0.3,
}


def make_rig(rng):
    cameras, volume = {}, rng.uniform([-1500, -1500, 11000], [1500, 1500, 13000], (40, 3))
    for name, angle in (("a", -0.25), ("b", 0.25)):
        rotation = Rotation.from_rotvec([0, angle, 0]).as_matrix()
        target = np.array([0, 0, 12000.0])
        cameras[name] = RigCamera(
            image_size_px=(1024, 1024),
            interior=np.r_[2650.0, 10, -20, np.zeros(7)],
            r0_px=400.0,
            rotation=rotation,
            translation_mm=target - rotation @ target,
        )
    names = tuple(f"{c}/{p}" for c in cameras for p in CAMERA_PARAMETERS)
    sigma = np.array([SIGMAS.get(n.split("/")[1], 0.0) for n in names])
    return Rig(
        cameras=cameras,
        cov=np.diag(sigma**2),
        cov_names=names,
        volume_mm=volume,
        volume_seen=np.ones((40, 2), dtype=bool),
    )


def perturbed(rig, rng):
    draw = rng.normal(size=len(rig.cov)) * np.sqrt(np.diag(rig.cov))
    cameras = {}
    for k, (name, c) in enumerate(rig.cameras.items()):
        d = draw[16 * k : 16 * (k + 1)]
        cameras[name] = RigCamera(
            image_size_px=c.image_size_px,
            interior=c.interior + d[:10],
            r0_px=c.r0_px,
            rotation=Rotation.from_rotvec(d[10:13]).as_matrix() @ c.rotation,
            translation_mm=c.translation_mm + d[13:],
        )
    return Rig(cameras=cameras)


# A point known in the frame of the volume is seen where the field says: the
# variance over m rigs scatters by sqrt(2/m) of itself.
@pytest.mark.parametrize("seed", [1, 2])
def test_field_is_the_scatter_of_pictures_in_the_volumes_frame(seed):
    rng = np.random.default_rng(seed)
    rig = make_rig(rng)
    pixels = rig.project(rig.volume_mm)
    field = CalibrationField(Triangulator(rig))
    probe_px = np.array([[511.5, 511.5], [255.75, 852.5]])  # nodes of the table
    camera = rig.cameras["a"]
    depth = (rig.volume_mm @ camera.rotation[2] + camera.translation_mm[2]).mean()
    rays = np.column_stack([(probe_px - [521.5, 491.5]) / 2650, np.ones(2)])
    points = (depth * rays - camera.translation_mm) @ camera.rotation
    trials, seen = 1500, []
    for _ in range(trials):
        other = perturbed(rig, rng)
        found, _ = other.triangulate(pixels)
        rotation, translation, _ = fit_rigid(found, rig.volume_mm)
        c = other.cameras["a"]
        in_cam = (points @ rotation.T + translation) @ c.rotation.T + c.translation_mm
        seen.append(project(c, in_cam))
    scatter = np.var(np.array(seen), axis=0)
    predicted = field.covariance(0, probe_px)[:, [0, 2]]
    np.testing.assert_allclose(scatter / predicted, 1.0, atol=4 * np.sqrt(2 / trials))
    raw = np.array([SIGMAS["x0"], SIGMAS["y0"]]) ** 2
    assert (predicted < raw).all()  # the shared motion is out


def test_a_rig_without_covariance_adds_nothing():
    rig = make_rig(np.random.default_rng(3))
    bare = Rig(cameras=rig.cameras)
    field = CalibrationField(Triangulator(bare))
    assert (field.covariance(1, np.array([[3.0, 4.0]])) == 0).all()


def test_between_the_nodes_it_is_linear() -> None:
    rng = np.random.default_rng(2)
    nodes = rng.normal(size=(7, 9, 3))
    xy = np.concatenate([rng.uniform(-50, 1100, (500, 2)), [[0, 0], [1023, 767], [np.nan, 4]]])
    found = core.bilinear(nodes, 1024.0, 768.0, xy)
    known = np.isfinite(xy[:, 0])
    at = np.clip(xy[known] / [1023, 767], 0, 1) * [8, 6]
    expected = np.stack(
        [map_coordinates(nodes[..., k], at.T[::-1], order=1) for k in range(3)], axis=1
    )
    # Weighted means of numbers of size 3: a few roundings.
    np.testing.assert_allclose(found[known], expected, rtol=0, atol=1e-14)
    assert np.isnan(found[~known]).all()
    with pytest.raises(ValueError, match="nodes"):
        core.bilinear(nodes[:1], 1024.0, 768.0, xy)
