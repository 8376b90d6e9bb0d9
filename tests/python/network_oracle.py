"""A photogrammetric network with known truth: convergent pictures all around an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import Network
from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.types import RigCamera

CAMERA = RigCamera(
    image_size_px=(4000, 3000),
    interior=np.r_[3600.0, 12, -9, -8e-9, 6e-16, 0, 2e-7, -1e-7, 1e-4, 5e-5],
    r0_px=1650.0,
    rotation=np.eye(3),
    translation_mm=np.zeros(3),
)
FREE = ("f", "x0", "y0", "A1", "A2", "B1", "B2", "E1", "E2")


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Positions (N, 3), poses cam_from_object, exact pictures and a measurement of them."""

    points_mm: npt.NDArray[np.float64]
    poses: list[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]
    image: npt.NDArray[np.int32]
    point: npt.NDArray[np.int32]
    exact_px: npt.NDArray[np.float64]
    sigma_px: float
    camera: RigCamera = field(default=CAMERA)

    def measured(self, rng: np.random.Generator) -> npt.NDArray[np.float64]:
        return self.exact_px + rng.normal(0, self.sigma_px, self.exact_px.shape)


def looking_at(centre_mm, aim_mm, roll_rad):
    """cam_from_object of a camera at a centre that looks at a point."""
    forward = (aim_mm - centre_mm) / np.linalg.norm(aim_mm - centre_mm)
    right = np.cross([0.0, 0.0, 1.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    rotation = rotation_from_vector([0, 0, roll_rad]) @ rotation
    return rotation, -rotation @ centre_mm


def simulate(
    seed: int,
    *,
    num_images: int,
    num_points: int,
    per_image: int | None = None,
    sigma_px: float = 0.05,
    camera: RigCamera = CAMERA,
) -> Truth:
    """Pictures from 1.5 to 3 m on a sphere's cap with rolls of 90 degrees, points in 1.2 m."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (num_points, 3)) * [600, 600, 150]
    poses, image, point, exact = [], [], [], []
    width, height = camera.image_size_px
    for i in range(num_images):
        turn, height_rad = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.3)
        direction = [
            np.cos(turn) * np.cos(height_rad),
            np.sin(turn) * np.cos(height_rad),
            np.sin(height_rad),
        ]
        centre = rng.uniform(1500, 3000) * np.array(direction)
        pose = looking_at(
            centre, rng.uniform(-150, 150, 3), (i % 4) * np.pi / 2 + rng.uniform(-0.2, 0.2)
        )
        pixels = project(camera, points @ pose[0].T + pose[1])
        inside = (pixels > 0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
        seen = np.flatnonzero(inside)
        if per_image is not None and len(seen) > per_image:
            seen = np.sort(rng.choice(seen, per_image, replace=False))
        poses.append(pose)
        image.append(np.full(len(seen), i))
        point.append(seen)
        exact.append(pixels[seen])
    return Truth(
        points_mm=points,
        poses=poses,
        image=np.concatenate(image).astype(np.int32),
        point=np.concatenate(point).astype(np.int32),
        exact_px=np.concatenate(exact),
        sigma_px=sigma_px,
        camera=camera,
    )


def network_of(
    truth: Truth,
    xy_px: npt.ArrayLike,
    *,
    kind: str | Sequence[str] = "free",
    datum: str = "free",
    cov_mm2: npt.NDArray[np.float64] | None = None,
    positions_mm: npt.ArrayLike | None = None,
    free: Sequence[str] = FREE,
) -> Network:
    """One camera, a pose a picture, starting at the truth."""
    network = Network()
    network.add_camera("cam", truth.camera, free=free)
    for i, (rotation, translation) in enumerate(truth.poses):
        pose = network.add_pose(f"picture {i + 1}", rotation, translation)
        network.add_image(f"picture {i + 1}", 0, inner=pose)
    network.set_points(
        np.arange(len(truth.points_mm)),
        truth.points_mm if positions_mm is None else positions_mm,
        cov_mm2,
        kind=kind,
    )
    cov = np.tile([truth.sigma_px**2, 0, truth.sigma_px**2], (len(truth.image), 1))
    network.set_observations(truth.image, truth.point, xy_px, cov)
    network.set_datum(datum)
    return network
