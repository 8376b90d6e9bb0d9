"""Cameras that are late: how image points move from stage to stage, and what a delay does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.pictures import Picture
from videogrammetry.types import FloatArray


@dataclass(frozen=True, kw_only=True)
class ImageMotion:
    """How image points move, (M, ...) in the order of the pictures' points.

    ``velocity_px`` (M, 2) per stage and ``bend_px`` (M, 2) per stage^2, by central
    differences; ``known`` (M,): the same camera saw the point a stage before and after.
    """

    velocity_px: FloatArray
    bend_px: FloatArray
    known: npt.NDArray[np.bool_]


def image_motion(pictures: Sequence[Picture]) -> ImageMotion:
    """Motion of the pictures' points; 0 where a neighbour is missing."""
    at = {
        (p.camera, p.stage, int(row)): xy
        for p in pictures
        for row, xy in zip(p.point, p.xy_px, strict=True)
    }
    velocity, bend, known = [], [], []
    nothing = np.zeros(2)
    for p in pictures:
        for row, xy in zip(p.point.tolist(), p.xy_px, strict=True):
            before = at.get((p.camera, p.stage - 1, row))
            after = at.get((p.camera, p.stage + 1, row))
            if before is None or after is None:
                velocity.append(nothing)
                bend.append(nothing)
                known.append(False)
                continue
            velocity.append(0.5 * (after - before))
            bend.append(after - 2.0 * xy + before)
            known.append(True)
    return ImageMotion(
        velocity_px=np.reshape(velocity, (-1, 2)),
        bend_px=np.reshape(bend, (-1, 2)),
        known=np.array(known, dtype=bool),
    )


def less_bend(xy_px: FloatArray, motion: ImageMotion, delay: FloatArray) -> FloatArray:
    """Image points less the bend of their ways within the delay (M,) of their cameras.

    What a camera late by tau stages sees is x + tau v + tau^2 a / 2 of the picture x at the
    stage itself; the adjustment knows the linear part, this takes the other away. v and a
    are those at the moment of the picture, later by tau: v there is v + tau a, which makes
    the sign of the bend negative.
    """
    bent: FloatArray = xy_px + 0.5 * delay[:, None] ** 2 * motion.bend_px
    return bent
