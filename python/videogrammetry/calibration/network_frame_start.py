"""The frame of a free network: that of the start values which the user gave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.adjustment import principal_extents
from videogrammetry.calibration.network_bars import GROSS_PART, unit_hint
from videogrammetry.calibration.network_frame import robust_similarity
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import fit_similarity

#: A frame needs three points that are not on a line.
_MIN_POINTS = 3
#: Start values are compared from so many points on, of at most so many.
_MIN_TO_COMPARE, _MOST_POINTS = 6, 300
#: Extents below this part of the largest are a line's or a plane's.
_FLAT = 0.02


def on_start_values(started: NetworkInput, given: NetworkInput) -> NetworkInput:
    """Move a started network to where it fits the given coordinates of its free points best.

    A free network has no frame of its own but that of its start values (least squares
    over all points that have some). Its scale is that of the scale bars where there are
    any, else that of the start values. With fewer than three given points, or where
    fixed or weighted ones give the frame, the network stays as it is.
    """
    known = np.isfinite(given.points.position_mm).all(axis=1)
    found = np.isfinite(started.points.position_mm).all(axis=1)
    rows = known & found
    if started.datum != "free" or rows.sum() < _MIN_POINTS:
        return started
    target = given.points.position_mm[rows]
    if np.linalg.svd(target - target.mean(axis=0), compute_uv=False)[1] <= 0:
        return started
    scale, rotation, shift, _ = fit_similarity(target, started.points.position_mm[rows])
    if len(started.scale_bars):
        scale = 1.0
        shift = target.mean(axis=0) - rotation @ started.points.position_mm[rows].mean(axis=0)
    # X' = s R X + d, and R_i X + t_i in the same camera times s: R_i R' X' + s t_i - R_i R' d.
    images = tuple(
        image
        if image.rotation is None or image.translation_mm is None
        else replace(
            image,
            rotation=image.rotation @ rotation.T,
            translation_mm=scale * image.translation_mm - image.rotation @ rotation.T @ shift,
        )
        for image in started.images
    )
    position = scale * started.points.position_mm @ rotation.T + shift
    return replace(started, images=images, points=replace(started.points, position_mm=position))


def check_start_values(started: NetworkInput, given: NetworkInput) -> list[str]:
    """Warnings about coordinates of free points that the started network contradicts.

    They are start values only: a table in other units changes nothing but the frame,
    if bars give the scale. A mirrored one shows that pictures or table are mirrored.

    Raises
    ------
    CalibrationError : the mirror image of the start values fits, they do not.
    """
    free = given.points.kind == "free"
    rows = np.flatnonzero(
        free & np.isfinite(given.points.position_mm).all(axis=1)
        & np.isfinite(started.points.position_mm).all(axis=1)
    )[:_MOST_POINTS]  # fmt: skip
    if len(rows) < _MIN_TO_COMPARE:
        return []
    target, found = given.points.position_mm[rows], started.points.position_mm[rows]
    extents = principal_extents(target)
    if extents[1] < _FLAT:
        return []
    fit = robust_similarity(target, found)
    if extents[2] > _FLAT:
        mirrored = robust_similarity(target, found, mirrored=True)
        if mirrored.rms < fit.rms / 3.0 and mirrored.inlier.sum() > fit.inlier.sum():
            raise CalibrationError(
                "the mirror image of the points' start values fits the pictures "
                f"({mirrored.rms:.3g} mm), they themselves do not ({fit.rms:.3g} mm): "
                "do image coordinates count y upwards, or are the start values left-handed? Count "
                "y downwards from the top row, or leave the start values away"
            )
    if not len(given.scale_bars) or abs(np.log(fit.scale)) < GROSS_PART:
        return []
    hint = unit_hint(1.0 / fit.scale)
    if fit.scale > 1:
        hint = unit_hint(fit.scale).replace("these", "the bars' lengths in")
    return [
        f"the points' start values are {fit.scale:.4g} times as large as the scale bars say"
        f"{hint or '.'} The scale bars count"
    ]
