"""Numbers for the target's un-coded points, from where the adjusted cameras expect them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import Adjustment, Dispersion
from videogrammetry.calibration.bundle import Bundle
from videogrammetry.calibration.pictures import Picture
from videogrammetry.types import FloatArray, IntArray, PointSet

#: The gate is at least this wide: the model's own error is not in the covariance.
MIN_GATE_PX = 1.0
#: A prediction less certain than this says nothing about a target.
MAX_GATE_PX = 20.0
#: A rival within this many gates makes an assignment ambiguous.
RIVAL_GATES = 3.0
#: Largest angle between a point's normal and the line of sight, as a cosine.
MIN_COSINE = 0.1


def assign_uncoded(
    bundle: Bundle,
    base: Sequence[Picture],
    adjustment: Adjustment,
    dispersion: Dispersion,
    target: PointSet,
    critical_value: float,
) -> list[Picture]:
    """The pictures ``base`` with targets without a number assigned to points not seen there.

    A target and a predicted point belong together if each is the other's
    nearest, closer than the gate (``critical_value`` times the larger standard
    deviation of prediction and measurement together, at least 1 px), and
    neither has a rival within three gates. Only pictures that have open
    targets change.
    """
    pictures = []
    for image, picture in enumerate(base):
        used = adjustment.used[bundle.image_of == image]
        if len(picture.open_xy_px) == 0 or used.sum() < 4:
            pictures.append(picture)
            continue
        unseen = np.setdiff1d(np.arange(len(target)), picture.point).astype(np.int32)
        xy, cov = dispersion.predict(np.full(len(unseen), image), unseen)
        visible = np.isfinite(xy).all(axis=1) & faces(bundle, image, unseen, target)
        floor = bundle.network.floor_px(bundle.network_camera(image))
        targets, points = match_nearest(
            picture.open_xy_px,
            picture.open_cov_px2 + np.array([1.0, 0.0, 1.0]) * floor**2,
            xy[visible],
            cov[visible] * max(adjustment.sigma0, 1.0) ** 2,
            critical_value or 4.0,
        )
        pictures.append(
            replace(
                picture,
                point=np.concatenate([picture.point, unseen[visible][points]]),
                xy_px=np.concatenate([picture.xy_px, picture.open_xy_px[targets]]),
                cov_px2=np.concatenate([picture.cov_px2, picture.open_cov_px2[targets]]),
                ellipse=np.concatenate([picture.ellipse, picture.open_ellipse[targets]]),
                ellipse_cov=np.concatenate(
                    [picture.ellipse_cov, picture.open_ellipse_cov[targets]]
                ),
            )
        )
    return pictures


def match_nearest(
    target_px: FloatArray,
    target_cov: FloatArray,
    predicted_px: FloatArray,
    predicted_cov: FloatArray,
    critical_value: float,
) -> tuple[IntArray, IntArray]:
    """Indices (targets, predictions) of the unambiguous mutual nearest pairs.

    Examples
    --------
    >>> cov = np.tile([0.01, 0.0, 0.01], (2, 1))
    >>> match_nearest(np.array([[0.0, 0], [50, 0]]), cov, np.array([[50.2, 0], [90, 0]]), cov, 3.3)
    (array([1], dtype=int32), array([0], dtype=int32))
    """
    empty = np.zeros(0, np.int32)
    if len(target_px) == 0 or len(predicted_px) == 0:
        return empty, empty
    distance = np.linalg.norm(target_px[:, None] - predicted_px[None], axis=2)
    nearest_target = distance.argmin(axis=0)
    predictions = np.flatnonzero(
        distance[nearest_target].argmin(axis=1) == np.arange(len(predicted_px))
    )
    targets = nearest_target[predictions]
    variance = _largest_variance(target_cov[targets] + predicted_cov[predictions])
    gate = np.maximum(critical_value * np.sqrt(variance), MIN_GATE_PX)
    good = (distance[targets, predictions] < gate) & (gate < MAX_GATE_PX)
    near_target = (distance[targets] < RIVAL_GATES * gate[:, None]).sum(axis=1)
    near_prediction = (distance[:, predictions] < RIVAL_GATES * gate[None]).sum(axis=0)
    good &= (near_target <= 1) & (near_prediction <= 1)
    return targets[good].astype(np.int32), predictions[good].astype(np.int32)


def _largest_variance(cov: FloatArray) -> FloatArray:
    mean, half = 0.5 * (cov[:, 0] + cov[:, 2]), 0.5 * (cov[:, 0] - cov[:, 2])
    result: FloatArray = mean + np.hypot(half, cov[:, 1])
    return result


def faces(bundle: Bundle, image: int, points: IntArray, target: PointSet) -> npt.NDArray[np.bool_]:
    """Whether points with a known normal turn towards the camera (True without normals)."""
    if target.normal is None:
        return np.ones(len(points), bool)
    rotation, translation = bundle.cam_from_target(image)
    in_cam = target.position_mm[points] @ rotation.T + translation
    normal = target.normal[points] @ rotation.T
    cosine = -np.sum(in_cam * normal, axis=1) / np.linalg.norm(in_cam, axis=1)
    known = np.isfinite(normal).all(axis=1) & (np.linalg.norm(normal, axis=1) > 0)
    result: npt.NDArray[np.bool_] = ~known | (cosine > MIN_COSINE)
    return result
