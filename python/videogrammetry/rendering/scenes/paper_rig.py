"""The paper's four cameras: Table 1 and section 4.1, in this package's frames.

H. Hu et al., Optics and Lasers in Engineering 50 (2012) 800-811. Its camera
axes are y up, z backward; ours are y down, z forward: with S = diag(1, -1, -1)
R -> S R S, T -> S T, and y0, B2, E2 change sign. R2, T2 and R3, T3 lead from
camera 1's frame to those of cameras 2 and 3, R4, T4 from camera 3's to that of
camera 4. r0 is not printed; 400 px is taken (another r0 rescales the other
parameters exactly).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from videogrammetry.geometry import nearest_rotation, rays_through_pixels
from videogrammetry.types import FloatArray, RigCamera, RigData

IMAGE_SIZE_PX = (1024, 1024)
R0_PX = 400.0

# f, x0, y0, A1, A2, A3, B1, B2, E1, E2 as printed (Table 1).
_INTERIOR = {
    "cam1": (
        *(2646.306, -56.244, -46.280, -2.172e-8, 6.036e-15, -1.377e-20),
        *(5.986e-7, -7.449e-6, -2.293e-2, 5.225e-3),
    ),
    "cam2": (
        *(2627.512, -36.723, -27.958, 2.717e-8, -2.417e-15, 18.855e-20),
        *(-1.387e-7, -1.134e-6, -2.208e-2, 6.193e-3),
    ),
    "cam3": (
        *(2671.762, -53.854, -130.981, -1.755e-8, -4.335e-15, 8.545e-20),
        *(-1.647e-7, -3.344e-6, -2.396e-2, 7.291e-3),
    ),
    "cam4": (
        *(2659.414, -60.683, -115.461, -1.339e-8, 5.502e-15, -2.338e-20),
        *(-2.281e-7, -3.788e-6, -2.357e-2, 3.348e-3),
    ),
}
_R2 = ((0.89062, 0.02703, -0.45393), (-0.02712, 0.99961, 0.00630), (0.45393, 0.00669, 0.89101))
_T2 = (-5356.50, 86.47, -1236.87)
_R3 = ((-0.99893, -0.04508, 0.01031), (-0.04474, 0.99849, 0.03166), (-0.01172, 0.03116, -0.99945))
_T3 = (826.97, 756.99, -22867.50)
_R4 = ((0.88285, 0.08329, -0.46219), (-0.08496, 0.99623, 0.01725), (0.46188, 0.02405, 0.88661))
_T4 = (-5558.91, 157.14, -1284.78)

_TO_OURS = np.diag([1.0, -1.0, -1.0])
_SIGN = np.array([1, 1, -1, 1, 1, 1, 1, -1, 1, -1], dtype=float)


def paper_rig() -> RigData:
    """The four cameras, camera 1 as reference: two facing pairs, 1-2 and 3-4.

    Examples
    --------
    >>> rig = paper_rig()
    >>> for name, camera in rig.cameras.items():
    ...     print(name, camera.centre_mm.round().astype(int).tolist())
    cam1 [0, 0, 0]
    cam2 [5334, -67, 1330]
    cam3 [592, 6, 22887]
    cam4 [-4915, -38, 21388]
    """
    two = _ours(_R2, _T2)
    three = _ours(_R3, _T3)
    turn, shift = _ours(_R4, _T4)
    four = (turn @ three[0], turn @ three[1] + shift)
    poses = {"cam1": (np.eye(3), np.zeros(3)), "cam2": two, "cam3": three, "cam4": four}
    return RigData(
        cameras={
            name: RigCamera(
                image_size_px=IMAGE_SIZE_PX,
                interior=_SIGN * np.array(_INTERIOR[name]),
                r0_px=R0_PX,
                rotation=rotation,
                translation_mm=translation,
            )
            for name, (rotation, translation) in poses.items()
        },
        reference="camera cam1",
        how={"method": "the paper's Table 1 and section 4.1, y up turned to y down"},
    )


def _ours(
    rotation: tuple[tuple[float, ...], ...], translation: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    r = nearest_rotation(_TO_OURS @ np.array(rotation) @ _TO_OURS)
    return r, _TO_OURS @ np.array(translation)


@dataclass(frozen=True, kw_only=True)
class LabFrame:
    """The laboratory: origin in the middle of what the cameras see, z up, y away from camera 1.

    ``rotation``, ``origin_mm``: x_in_rig = rotation x_in_lab + origin_mm.
    """

    rotation: FloatArray
    origin_mm: FloatArray

    @property
    def up(self) -> FloatArray:
        """(3,) the vertical, upwards, in the rig's frame."""
        return np.array(self.rotation[:, 2])


def lab_frame(rig: RigData, front: tuple[str, ...] = ("cam1", "cam2")) -> LabFrame:
    """The laboratory of a rig whose cameras stand level, on the whole.

    The vertical is the mean of the cameras' own, so it is no axis of any of
    them; the origin is the point nearest to the rays through the middles of
    all pictures; y points from the cameras of ``front`` to the origin.

    Examples
    --------
    >>> frame = lab_frame(paper_rig())
    >>> frame.origin_mm.round(-2).tolist(), frame.up.round(2).tolist()
    ([400.0, -200.0, 11200.0], [-0.01, -1.0, -0.01])
    """
    cameras = list(rig.cameras.values())
    normal, right_hand = np.zeros((3, 3)), np.zeros(3)
    for camera in cameras:
        middle = 0.5 * (np.array(camera.image_size_px, dtype=float) - 1)
        ray = camera.rotation.T @ rays_through_pixels(camera, middle[None])[0]
        ray /= np.linalg.norm(ray)
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        right_hand += across @ camera.centre_mm
    origin = np.linalg.solve(normal, right_hand).astype(float)
    up = -np.sum([camera.rotation[1] for camera in cameras], axis=0)
    up /= np.linalg.norm(up)
    view = origin - np.mean([rig.cameras[name].centre_mm for name in front], axis=0)
    away = view - (view @ up) * up
    away /= np.linalg.norm(away)
    return LabFrame(rotation=np.stack([np.cross(away, up), away, up], axis=1), origin_mm=origin)
