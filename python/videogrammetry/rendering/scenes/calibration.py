"""The calibration: the cross held at many places and orientations, seen by all cameras."""

from __future__ import annotations

import numpy as np

from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.scenes.base import Placement, Scene
from videogrammetry.rendering.scenes.cross import CrossTarget, cross_target
from videogrammetry.rendering.scenes.paper_rig import lab_frame, paper_rig
from videogrammetry.types import FloatArray, RigCamera, RigData

#: Half extents of the volume that the target's middle fills: x, y (depth), z (height), mm.
VOLUME_MM = (1500.0, 900.0, 1500.0)
#: lab_from_target of the upright target: x right, y down, z away from camera 1.
_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
# A camera must see this share of the points that face it, or the place is drawn inwards.
_MIN_SEEN = 0.75
_BORDER_PX = 16.0
_MAX_SHIFTS = 60  # a factor of 0.93 each time: to 1 % of the first place


def calibration_scene(
    family: CodeFamily,
    *,
    num_orientations: int = 24,
    rig: RigData | None = None,
    cross: CrossTarget | None = None,
    tilt_deg: float = 25.0,
    seed: int = 0,
) -> Scene:
    """The two-sided cross at ``num_orientations`` places that fill the volume.

    Places and turns follow a low-discrepancy sequence (R2-type additive
    recurrence), so that any number of orientations fills the volume evenly;
    a place where a camera would see less than three quarters of its side is
    drawn towards the middle.

    Raises
    ------
    ValueError
        An option is impossible, or the cross too large for the pictures.
    """
    if num_orientations < 1:
        raise ValueError(f"orientations: expected 1 or more, got {num_orientations}")
    if not 0 <= tilt_deg < 70:
        raise ValueError(f"tilt: expected 0 ... 70 degrees, got {tilt_deg:g}")
    rig = rig or paper_rig()
    cross = cross or cross_target(family)
    poses = [_pose(rig, cross, k, tilt_deg, seed) for k in range(num_orientations)]

    def place(time_s: float) -> Placement:
        stage = int(np.clip(round(time_s), 0, num_orientations - 1))
        return cross.place.moved(*poses[stage])

    return Scene(
        name="calibration",
        rig=rig,
        marks=cross.marks,
        place=place,
        num_stages=num_orientations,
        frame_rate_hz=1.0,
        still=True,
        facts={"tilt_deg": tilt_deg, "volume_mm": VOLUME_MM},
    )


def _pose(
    rig: RigData, cross: CrossTarget, k: int, tilt_deg: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """rig_from_target of the k-th orientation."""
    lab = lab_frame(rig, tuple(rig.cameras)[:2])
    u = _evenly(k, 6, seed)
    shift = (2 * u[:3] - 1) * VOLUME_MM
    tilt = np.radians(tilt_deg) * (2 * u[3:5] - 1)
    roll = 2 * np.pi * u[5]
    turn = rotation_from_vector(np.array([tilt[0], tilt[1], 0.0])) @ rotation_from_vector(
        np.array([0.0, 0.0, roll])
    )
    rotation = lab.rotation @ _UPRIGHT @ turn
    for _ in range(_MAX_SHIFTS):
        translation = lab.rotation @ shift + lab.origin_mm
        if all(_share_seen(c, cross, rotation, translation) >= _MIN_SEEN for c in _all(rig)):
            return rotation, translation
        shift = 0.93 * shift
    raise ValueError(
        f"span: even in the middle of the volume the cameras see less than {_MIN_SEEN:.0%} of the "
        "cross's side; choose a smaller cross or a smaller tilt"
    )


def _all(rig: RigData) -> list[RigCamera]:
    return list(rig.cameras.values())


def _share_seen(
    camera: RigCamera, cross: CrossTarget, rotation: FloatArray, translation: FloatArray
) -> float:
    place = cross.place.moved(rotation, translation)
    facing = ((camera.centre_mm - place.centre_mm) * place.normal).sum(axis=1) > 0
    in_cam = place.centre_mm[facing] @ camera.rotation.T + camera.translation_mm
    xy = project(camera, in_cam)
    limit = np.array(camera.image_size_px) - 1 - _BORDER_PX
    # Not finite, behind the camera: in no picture either.
    inside = ((xy > _BORDER_PX) & (xy < limit)).all(axis=1)
    return float(np.mean(inside)) if facing.any() else 0.0


def _evenly(k: int, dimensions: int, seed: int) -> FloatArray:
    """The k-th point of an additive recurrence in the unit cube (Roberts' R_d sequence)."""
    phi = 2.0
    for _ in range(60):
        phi = (1 + phi) ** (1 / (dimensions + 1))
    steps = phi ** -np.arange(1.0, dimensions + 1)
    start = np.random.default_rng([seed, dimensions]).uniform(size=dimensions)
    result: FloatArray = (start + (k + 1) * steps) % 1.0
    return result
