"""Coded targets are flat: cameras that look at opposite sides do not see the same one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import rays_through_pixels
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.types import FloatArray, IntArray, Matches, RigData, Targets

#: By how much two rays may part beyond what the ellipses' axes allow: a ratio of
#: axes that noise takes from 1 to 0.97 looks like a tilt of 14 degrees.
_TOLERANCE_RAD = np.radians(30.0)
_NO_PARTNER = TARGET_STATUS.index("no partner")


def check_facing(
    rig: RigData, targets: Sequence[Targets], unique_id: Sequence[IntArray], matches: Matches
) -> Matches:
    """The matches without sightings of a coded target that its tilt rules out.

    A ray meets a circle's plane at the angle t off its normal, cos t = b / a of
    the ellipse (to second order in the size of the picture's part). Two rays to
    one face part by t1 + t2 at most; rays from opposite sides by pi - t1 - t2 at
    least. Matches without a code are left alone: they may be balls. ``unique_id``: the
    codes of ``targets``, -1 where a picture has one twice.
    """
    rows = np.flatnonzero((matches.id >= 0) & ((matches.target >= 0).sum(axis=1) >= 2))
    if not len(rows):
        return matches
    rays = [
        rays_through_pixels(camera, t.centre_px) @ camera.rotation
        for camera, t in zip(rig.cameras.values(), targets, strict=True)
    ]
    rays = [ray / np.sqrt(np.einsum("nk,nk->n", ray, ray))[:, None] for ray in rays]
    tilt = [np.arccos(np.clip(t.semi_axes_px[:, 1] / t.semi_axes_px[:, 0], 0, 1)) for t in targets]
    rows = rows[_may_part(rays, tilt, matches.target[rows])]
    if not len(rows):
        return matches
    target = matches.target.copy()
    numbers = matches.id.copy()
    status = [s.copy() for s in matches.status]
    changed = False
    for row in rows:
        cameras = np.flatnonzero(target[row] >= 0)
        index = target[row, cameras]
        kept = _one_face(
            np.array([rays[c][i] for c, i in zip(cameras, index, strict=True)]),
            np.array([tilt[c][i] for c, i in zip(cameras, index, strict=True)]),
        )
        if kept.all():
            continue
        changed = True
        for c, i in zip(cameras[~kept].tolist(), index[~kept].tolist(), strict=True):
            target[row, c] = -1
            status[c][i] = _NO_PARTNER
        left = zip(cameras[kept].tolist(), index[kept].tolist(), strict=True)
        if not any(unique_id[c][i] == numbers[row] for c, i in left):
            numbers[row] = -1  # the code was read on the face that is gone
    if not changed:
        return matches
    return matches.with_targets(target, numbers, tuple(status))


def _may_part(
    rays: Sequence[FloatArray], tilt_rad: Sequence[FloatArray], target: IntArray
) -> npt.NDArray[np.bool_]:
    """(P,) whether any two sightings of rows (P, C) part by more than their tilts allow."""
    # By coordinate, the missing ones NaN, with which every comparison is false.
    seen = target >= 0
    along, tilt = [], []
    for c, (ray, own) in enumerate(zip(rays, tilt_rad, strict=True)):
        if not len(ray):
            along.append(np.full((3, len(target)), np.nan))
            tilt.append(np.zeros(len(target)))
            continue
        index = target[:, c]
        along.append(np.ascontiguousarray(ray.take(index, axis=0, mode="clip").T))
        along[-1][:, ~seen[:, c]] = np.nan
        tilt.append(own.take(index, mode="clip"))
    found = np.zeros(len(target), dtype=bool)
    for a in range(target.shape[1]):
        for b in range(a):
            cosine = along[a][0] * along[b][0]
            cosine += along[a][1] * along[b][1]
            cosine += along[a][2] * along[b][2]
            # No limit is below the tolerance: few pairs need their angle.
            far = np.flatnonzero(cosine < np.cos(_TOLERANCE_RAD))
            limit = tilt[a][far] + tilt[b][far] + _TOLERANCE_RAD
            found[far] |= np.arccos(np.clip(cosine[far], -1, 1)) > limit
    return found


def _one_face(rays: FloatArray, tilt_rad: FloatArray) -> npt.NDArray[np.bool_]:
    """Which sightings stay: the worst goes until all pairs can see one face; fewer than two: none.

    Examples
    --------
    >>> rays = np.array([[0.0, 0, 1], [0.3, 0, 0.95], [0, 0, -1]])
    >>> _one_face(rays, np.array([0.2, 0.3, 0.1])).tolist()
    [True, True, False]
    >>> _one_face(rays[[0, 2]], np.array([0.2, 0.1])).tolist()
    [False, False]
    """
    angle = np.arccos(np.clip(rays @ rays.T, -1, 1))
    apart = angle > tilt_rad[:, None] + tilt_rad[None] + _TOLERANCE_RAD
    kept = np.ones(len(rays), dtype=bool)
    while (apart & kept & kept[:, None]).any():
        kept[np.argmax((apart & kept).sum(axis=1) * kept)] = False
    return kept if kept.sum() >= 2 else np.zeros(len(rays), dtype=bool)
