"""Matching by ID and by epipolar geometry over any number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from videogrammetry._core import matching as _matching
from videogrammetry.geometry import rig_model
from videogrammetry.types import Matches

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, RigData, Targets

#: What became of a target, by ``Matches.status``.
TARGET_STATUS = (
    "matched",  # 0
    "no partner",  # 1: no target of another camera within the gate of its epipolar line
    "ambiguous",  # 2: two or more partners that nothing decides between
    "inconsistent ID",  # 3: the same ID elsewhere, but the rays do not meet
    "outvoted",  # 4: its candidates belong, more surely, to other targets
    "another size",  # 5: no circle of the diameter that was stated (the pipeline's verdict)
)


@dataclass(frozen=True, kw_only=True)
class MatchingOptions:
    """Options of matching; fields and defaults equal those of the C++ struct.

    Attributes
    ----------
    critical_value : gate of the rays' distance in standard deviations, (0, 20].
    max_size_ratio : a dot's size times its depth agrees between the cameras
        within this ratio, > 1; 0 = do not look at sizes.
    min_log_odds : least log odds against the best alternative, >= 0.
    neighbours : neighbours that predict a target's depth on its surface; 0 = none.
    min_distance_mm, max_distance_mm : range from every camera; 0 = no limit.
    """

    critical_value: float = 3.89
    max_size_ratio: float = 1.35
    min_log_odds: float = 4.6
    neighbours: int = 8
    min_distance_mm: float = 0.0
    max_distance_mm: float = 0.0


def image_covariance(targets: Targets, sigma_floor_px: float) -> FloatArray:
    """(N, 3) covariance xx, xy, yy of the centres: edges' part plus the floor's."""
    cov = np.stack([targets.cov[:, 0, 0], targets.cov[:, 0, 1], targets.cov[:, 1, 1]], axis=1)
    cov[:, [0, 2]] += sigma_floor_px**2
    return np.ascontiguousarray(cov)


def match_stage(
    rig: RigData,
    targets: Sequence[Targets],
    options: MatchingOptions | None = None,
    extra_cov_px2: Sequence[FloatArray] | None = None,
) -> Matches:
    """Match the targets of one stage, one ``Targets`` a camera in the rig's order.

    Coded targets go by their ID, all others by the distance of their rays
    weighed with its covariance; the globally best compatible set is taken (see
    ``cpp/videogrammetry/matching/match.h`` for the model).

    Parameters
    ----------
    rig, targets : the cameras and what each of them saw.
    options : None: the defaults.
    extra_cov_px2 : (N, 3) a camera, added to the centres' covariance: what the
        calibration leaves uncertain at their places.

    Raises
    ------
    ValueError
        If the number of pictures differs from the rig's cameras.
    """
    options = options or MatchingOptions()
    core_options = _matching.MatchingOptions()
    for field in fields(options):
        setattr(core_options, field.name, getattr(options, field.name))
    extra = extra_cov_px2 if extra_cov_px2 is not None else [np.zeros(3)] * len(targets)
    cameras = [
        _matching.CameraTargets(
            np.ascontiguousarray(t.centre_px),
            image_covariance(t, rig.sigma_floor_px.get(name, 0.0)) + more,
            np.ascontiguousarray(t.unique_id, dtype=np.int32),
            np.ascontiguousarray(t.semi_axes_px[:, 0]),
        )
        for name, t, more in zip(rig.cameras, targets, extra, strict=True)
    ]
    result = _matching.match_stage(rig_model(rig), cameras, core_options)
    return Matches(
        target=result["target"],
        id=result["id"],
        chi2=result["chi2"],
        log_odds=result["log_odds"],
        status=tuple(result["status"]),
        false_probability=result["false_probability"],
    )
