"""Principal distances at the start of a network: the given ones, and which to try."""

from __future__ import annotations

import numpy as np

from videogrammetry.calibration.network_block import Block, with_interior
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_seed import F_FACTORS, F_GRID
from videogrammetry.types import FloatArray, RigCamera


def start_cameras(network: NetworkInput) -> list[RigCamera]:
    """The given interiors; an unknown f is the larger side, other unknowns 0."""
    cameras = []
    for camera in network.cameras:
        interior = np.nan_to_num(np.asarray(camera.interior, float), nan=0.0)
        if not interior[0] > 0:
            if camera.free is not None and "f" not in camera.free:
                raise ValueError(
                    f"camera {camera.name}: f is held (it is not in free) but has no value; give "
                    "f_px, or free f"
                )
            interior[0] = max(camera.image_size_px)
        plain = RigCamera(
            image_size_px=camera.image_size_px, interior=interior, r0_px=camera.r0_px,
            rotation=np.eye(3), translation_mm=np.zeros(3), measured=camera.measured,
        )  # fmt: skip
        cameras.append(with_interior(plain, interior))
    return cameras


def focal_factors(network: NetworkInput) -> list[FloatArray]:
    """Factors on the cameras' f to try, in turn: the given ones, near them, then all."""
    unknown = np.array([not camera.interior[0] > 0 for camera in network.cameras])
    held = np.array([c.free is not None and "f" not in c.free for c in network.cameras])
    if held.all():
        return [np.ones(len(held))]
    grid = [np.where(held, 1.0, factor) for factor in F_GRID]
    if unknown.any():
        # (a camera whose f is given beside one without keeps it)
        return [np.where(unknown, factor, 1.0) for factor in F_GRID]
    sides = np.array([max(camera.image_size_px) for camera in network.cameras])
    given = np.array([camera.interior[0] for camera in network.cameras])
    near = [np.where(held, 1.0, factor) for factor in F_FACTORS]
    return near + [np.where(held, 1.0, factor * sides / given) for factor in np.array(grid)]


def focal_doubts(network: NetworkInput, block: Block, *, searched: bool) -> list[str]:
    """Sentences about principal distances that were found without or against a start value."""
    doubts = []
    for c, camera in enumerate(network.cameras):
        found, given = float(block.cameras[c].interior[0]), float(camera.interior[0])
        if not given > 0:
            if not searched:
                continue
            doubts.append(
                f"camera {camera.name}: f was not given; {found:.0f} px fits best and is only as "
                "sure as the pictures' convergence and depth make it"
            )
        elif abs(found / given - 1.0) > 0.1:
            doubts.append(
                f"camera {camera.name}: f = {found:.0f} px fits, {given:.0f} px was given: check "
                "the start value (its unit, the pixel size, a picture that was cropped or scaled)"
            )
    return doubts
