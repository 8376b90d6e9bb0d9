"""The start of a network that has known points or given poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from videogrammetry.adjustment import principal_extents, search_focal
from videogrammetry.calibration.network_block import Block
from videogrammetry.calibration.network_growth import MIN_KNOWN_POINTS, complete
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_rays import RowArray
from videogrammetry.calibration.network_seed import with_f
from videogrammetry.calibration.network_start_focal import start_cameras
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import camera_model
from videogrammetry.types import RigCamera

#: Given poses hold if they lead to this share of image points within that share of the gate.
_POSES_SHARE, _POSES_GATE = 0.6, 0.2
#: A start that leaves more than this share of the gate is checked for mirrored points.
_SUSPICIOUS = 0.1


def from_known(network: NetworkInput, start: Block, doubts: list[str]) -> Block | None:
    """The block that resection on known points (or given poses) starts; None without.

    Raises
    ------
    CalibrationError : the known points' mirror image fits, they do not.
    """
    block = _from_poses(network, start, doubts)
    if block is not None:
        return block
    block = start.copy()
    usable = [i for i in range(len(network.images)) if _sees_known(block, i)]
    if not usable:
        return None
    cameras = _known_focal(network, block, usable)
    if cameras is None:
        return None
    block.set_cameras(cameras)
    complete(block)
    cost = _cost_px(block, usable)
    if cost > _SUSPICIOUS * block.start_gate_px:
        _check_handedness(network, block, usable, cost)
    # Known points that most pictures contradict: leave them to the Helmert transformation.
    if cost > 0.5 * block.start_gate_px or block.placed.sum() < 0.3 * len(network.images):
        return None
    return block


def _from_poses(network: NetworkInput, start: Block, doubts: list[str]) -> Block | None:
    """The block of the given poses; None without, or where they do not fit the pictures."""
    block = start.copy()
    for k, image in enumerate(network.images):
        if image.rotation is not None and image.translation_mm is not None:
            block.place(k, np.asarray(image.rotation), np.asarray(image.translation_mm))
    given = block.placed
    if not given.any():
        return None
    rows = np.flatnonzero(given[block.image])
    seen = np.bincount(block.point[rows], minlength=len(block.position))
    rows = rows[(seen[block.point[rows]] > 1) | block.known[block.point[rows]]]
    block.triangulate()
    if block.has_point.any() and len(rows):
        # Poses from a map or another program are rough, f may be: what they lead to counts.
        block.bundle()
        distance = np.nan_to_num(block.distance_px(rows), nan=np.inf)
        if np.mean(distance < _POSES_GATE * block.start_gate_px) > _POSES_SHARE:
            block.settle_gate()
            block.triangulate(again=True)
            complete(block)
            return block
    if len(rows):
        doubts.append(
            f"the {int(given.sum())} given poses do not fit the pictures and were found anew: are "
            "they cam_from_world (the object's point times the rotation, plus the translation, is "
            "the camera's), in mm, and of these pictures?"
        )
    return None


def _sees_known(block: Block, image: int) -> bool:
    points = np.unique(block.point[block.rows_of[image]])
    points = points[block.known[points]]
    if len(points) < MIN_KNOWN_POINTS:
        return False
    return bool(principal_extents(block.position[points])[1] > 0.02)


def _known_focal(
    network: NetworkInput, block: Block, usable: Sequence[int]
) -> list[RigCamera] | None:
    """Interiors with f such that the known points fit; None where they fit at no f."""
    cameras = list(block.cameras)
    for c, camera in enumerate(network.cameras):
        mine = [i for i in usable if block.camera_of[i] == c]
        if not mine:
            continue
        given = np.isfinite(camera.interior[0]) and camera.interior[0] > 0
        free = camera.free is None or "f" in camera.free
        cost = _resection_cost(block, mine) if given else np.inf
        if cost < block.start_gate_px / 3 or (given and not free):
            continue
        mine.sort(key=lambda i: -int(block.known[block.point[block.rows_of[i]]].sum()))
        rows = [_known_rows(block, i) for i in mine[:4]]
        try:
            f_px, rms_px, _ = search_focal(
                camera_model(cameras[c]),
                [block.position[block.point[r]] for r in rows],
                [block.xy_px[r] for r in rows],
                threshold_px=block.start_gate_px,
            )
        except CalibrationError:
            continue
        if rms_px < 0.9 * cost:
            cameras[c] = with_f(cameras[c], f_px / float(cameras[c].interior[0]))
    return cameras


def _known_rows(block: Block, image: int) -> RowArray:
    rows = block.rows_of[image]
    return rows[block.known[block.point[rows]]]


def _resection_cost(block: Block, images: Sequence[int]) -> float:
    """Robust RMS of the known points over the resected pictures."""
    squares = []
    for image in images:
        found = block.resect(image)
        squares.append(found[0].cost_px2 if found else block.start_gate_px**2)
    return float(np.sqrt(np.mean(squares)))


def _cost_px(block: Block, images: Sequence[int]) -> float:
    gate = block.start_gate_px
    distance = np.concatenate([block.distance_px(_known_rows(block, i)) for i in images])
    distance = np.minimum(np.nan_to_num(distance, nan=gate), gate)
    return float(np.sqrt(np.mean(distance**2)))


def _check_handedness(
    network: NetworkInput, block: Block, usable: Sequence[int], cost_px: float
) -> None:
    """CalibrationError if the mirror image of the known points fits and they do not."""
    points = network.points
    mirrored = replace(points, position_mm=points.position_mm * [1.0, 1.0, -1.0])
    other = Block(replace(network, points=mirrored), start_cameras(network))
    cameras = _known_focal(other.network, other, usable)
    if cameras is None:
        return
    other.set_cameras(cameras)
    complete(other)
    other_px = _cost_px(other, usable)
    if other_px < cost_px / 3.0:
        raise CalibrationError(
            f"the mirror image of the known points fits the pictures ({other_px:.2f} px), the "
            f"points themselves do not ({cost_px:.2f} px): their coordinates are left-handed, or "
            "the pictures are mirrored; change the sign of one coordinate of all known points, or "
            "mirror the pictures back"
        )
