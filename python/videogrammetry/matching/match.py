"""Matching by ID and by epipolar geometry over any number of cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from videogrammetry._core import matching as _matching
from videogrammetry.geometry import rig_model
from videogrammetry.types import Matches, StageMatches

if TYPE_CHECKING:
    from videogrammetry.types import FlatTargets, FloatArray, RigData, Targets

#: What became of a target, by ``Matches.status``.
TARGET_STATUS = (
    "matched",  # 0
    "no partner",  # 1: no target of another camera within the gate of its epipolar line
    "ambiguous",  # 2: two or more partners that nothing decides between
    "inconsistent ID",  # 3: the same ID elsewhere, but the rays do not meet
    "outvoted",  # 4: its candidates belong, more surely, to other targets
    "another size",  # 5: no circle of the diameter that was stated (the pipeline's verdict)
)


#: 10 to 1 and 100 to 1.
_LOG_ODDS_OF_MORE, _LOG_ODDS_OF_TWO = 2.3, 4.6


@dataclass(frozen=True, kw_only=True)
class MatchingOptions:
    """Options of matching; fields and defaults equal those of the C++ struct.

    Attributes
    ----------
    critical_value : gate of the rays' distance in standard deviations, (0, 20].
    max_size_ratio : a dot's size times its depth agrees between the cameras
        within this ratio, > 1; 0 = do not look at sizes.
    min_log_odds : least log odds that all targets of a match show one point, >= 0;
        None: 2.3 (10 to 1) with three cameras or more, 4.6 (100 to 1) with two, where no
        third picture can contradict.
    neighbours : neighbours that predict a target's depth on its surface; 0 = none.
    min_distance_mm, max_distance_mm : range from every camera; 0 = no limit.
    num_threads : of the search in one stage, 0 = one a core; the result is the same.
    """

    critical_value: float = 3.89
    max_size_ratio: float = 1.35
    min_log_odds: float | None = None
    neighbours: int = 8
    min_distance_mm: float = 0.0
    max_distance_mm: float = 0.0
    num_threads: int = 1


@dataclass(frozen=True, kw_only=True)
class MatchEdits:
    """What the user has decided about the targets of one stage.

    Attributes
    ----------
    together : sets of (camera, target), both counted from 0 in the rig's and the picture's
        order, at most one a camera: one point, whatever their rays say.
    apart : pairs of (camera, target) that do not show one point.
    """

    together: Sequence[Sequence[tuple[int, int]]] = ()
    apart: Sequence[tuple[tuple[int, int], tuple[int, int]]] = ()


def image_covariance(targets: Targets, sigma_floor_px: float) -> FloatArray:
    """(N, 3) covariance xx, xy, yy of the centres: edges' part plus the floor's."""
    cov = np.stack([targets.cov[:, 0, 0], targets.cov[:, 0, 1], targets.cov[:, 1, 1]], axis=1)
    cov[:, [0, 2]] += sigma_floor_px**2
    return np.ascontiguousarray(cov)


def _core_options(options: MatchingOptions | None, num_cameras: int) -> Any:
    options = options or MatchingOptions()
    if options.min_log_odds is None:
        least = _LOG_ODDS_OF_MORE if num_cameras > 2 else _LOG_ODDS_OF_TWO
        options = replace(options, min_log_odds=least)
    core_options = _matching.MatchingOptions()
    for field in fields(options):
        setattr(core_options, field.name, getattr(options, field.name))
    return core_options


def _core_edits(edits: MatchEdits | None) -> Any:
    core_edits = _matching.MatchEdits()
    if edits is not None:
        for targets in edits.together:
            core_edits.put_together(np.array(targets, dtype=np.int32).reshape(-1, 2))
        for pair in edits.apart:
            core_edits.keep_apart(np.array(pair, dtype=np.int32).reshape(-1, 2))
    return core_edits


def match_stage(
    rig: RigData,
    targets: Sequence[Targets],
    options: MatchingOptions | None = None,
    extra_cov_px2: Sequence[FloatArray] | None = None,
    edits: MatchEdits | None = None,
) -> Matches:
    """Match the targets of one stage, one ``Targets`` a camera in the rig's order.

    Coded targets go by their ID, all others by the most credible explanation of all
    pictures at once: points that each camera in view sees with some probability, lone
    targets, rays that meet as well as their covariance says (see
    ``cpp/videogrammetry/matching/match.h`` for the model). ``false_probability`` of
    the result is the probability that a match is none.

    Parameters
    ----------
    rig, targets : the cameras, 64 at most, and what each of them saw.
    options : None: the defaults.
    extra_cov_px2 : (N, 3) a camera, added to the centres' covariance: what the
        calibration leaves uncertain at their places.
    edits : what the user has decided; it comes first.

    Raises
    ------
    ValueError
        If the number of pictures differs from the rig's cameras, an option is out of
        range, or edits name targets that are not there or give no point.
    """
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
    result = _matching.match_stage(
        rig_model(rig), cameras, _core_options(options, len(rig.cameras)), _core_edits(edits)
    )
    return Matches(
        target=result["target"],
        id=result["id"],
        chi2=result["chi2"],
        log_odds=result["log_odds"],
        status=tuple(result["status"]),
        false_probability=result["false_probability"],
    )


def match_stages(
    rig: RigData,
    cameras: Sequence[FlatTargets],
    options: MatchingOptions | None = None,
    extra_cov_px2: Sequence[FloatArray] | None = None,
    edits: Mapping[int, MatchEdits] | None = None,
) -> StageMatches:
    """Match the targets of a chunk of stages, each stage in the light of the others.

    Points are predicted from stage to stage by constant velocity; what is found where
    it is expected is verified by its rays and grows surer, also in the stages before;
    what ceases to be consistent is dissolved; all that is left goes through the search
    of :func:`match_stage` (model: ``cpp/videogrammetry/matching/stages.h``).

    Parameters
    ----------
    rig : the cameras.
    cameras : the targets of each in the rig's order, over the same stages; ``cov_px2``
        is the centres' own, to which the rig's floor is added here.
    options : None: the defaults.
    extra_cov_px2 : (M, 3) a camera, added to the centres' covariance.
    edits : stage, from 0 -> what the user has decided about it.

    Raises
    ------
    ValueError
        As :func:`match_stage`, and for offsets that do not fit.

    Examples
    --------
    A point that flies past two cameras, beside it another that one of them sees:

    >>> import numpy as np
    >>> from videogrammetry.types import FlatTargets, RigCamera, RigData
    >>> camera = dict(image_size_px=(1280, 1024), interior=np.r_[2500.0, np.zeros(9)], r0_px=500.0)
    >>> left = RigCamera(**camera, rotation=np.eye(3), translation_mm=np.array([100.0, 0, 1000]))
    >>> right = RigCamera(**camera, rotation=np.eye(3), translation_mm=np.array([-100.0, 0, 1000]))
    >>> def flat(x, more=()):
    ...     xy = np.array([[x + 3 * s, 511.5 + s] for s in range(4)] + list(more))
    ...     n = len(xy)
    ...     return FlatTargets(
    ...         offsets=np.array([0, 1, 2, 3, n]), centre_px=xy, id=np.full(n, -1, np.int32),
    ...         cov_px2=np.tile([0.0004, 0, 0.0004], (n, 1)), semi_major_px=np.full(n, 4.0))
    >>> rig = RigData(cameras={"left": left, "right": right})
    >>> found = match_stages(rig, [flat(889.5), flat(389.5, [(700.0, 200.0)])])
    >>> found.offsets.tolist(), found.target.tolist()
    ([0, 1, 2, 3, 4], [[0, 0], [0, 0], [0, 0], [0, 0]])
    """
    extra = extra_cov_px2 if extra_cov_px2 is not None else [np.zeros(3)] * len(cameras)
    flat = []
    for name, t, more in zip(rig.cameras, cameras, extra, strict=True):
        cov = np.array(t.cov_px2, dtype=float).reshape(-1, 3) + more
        cov[:, [0, 2]] += rig.sigma_floor_px.get(name, 0.0) ** 2
        core_targets = _matching.CameraTargets(
            np.ascontiguousarray(t.centre_px),
            np.ascontiguousarray(cov),
            np.ascontiguousarray(t.id, dtype=np.int32),
            np.ascontiguousarray(t.semi_major_px),
        )
        offsets = np.ascontiguousarray(t.offsets, dtype=np.int64)
        flat.append(_matching.FlatTargets(offsets, core_targets))
    for stage in edits or {}:
        if stage < 0:
            raise ValueError(f"edits: stage {stage} is below 0; stages count from 0 here")
    result = _matching.match_stages(
        rig_model(rig),
        flat,
        _core_options(options, len(rig.cameras)),
        {stage: _core_edits(one) for stage, one in (edits or {}).items()},
    )
    return StageMatches(
        offsets=result["offsets"],
        target=result["target"],
        id=result["id"],
        chi2=result["chi2"],
        log_odds=result["log_odds"],
        false_probability=result["false_probability"],
        status=tuple(result["status"]),
    )
