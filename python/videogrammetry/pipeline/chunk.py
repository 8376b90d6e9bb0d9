"""Some stages at once: from the targets of all cameras to points with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from videogrammetry.matching import MatchingOptions, image_covariance, match_stages
from videogrammetry.pipeline.circle_size import SizeCheck, check_size
from videogrammetry.pipeline.eccentricity import possible_eccentricity
from videogrammetry.pipeline.facing import check_facing
from videogrammetry.reconstruction import CalibrationField, Triangulator, reconstruct_stage
from videogrammetry.types import (
    FlatTargets,
    FloatArray,
    IntArray,
    Matches,
    RigData,
    StagePoints,
    Targets,
)

Offsets = npt.NDArray[np.int64]
#: Stages times codes that are counted one by one; sorting takes several times as long.
_MOST_COUNTED = 1_000_000


@dataclass(frozen=True)
class CameraTargets:
    """The targets of one camera over the stages of a chunk.

    ``offsets`` (S + 1,): those of the s-th stage stand at offsets[s] to offsets[s + 1].
    """

    targets: Targets
    offsets: Offsets

    @classmethod
    def of_stages(cls, stages: Sequence[Targets]) -> CameraTargets:
        """Of the targets of one or more stages."""
        joined = {
            name: np.concatenate([getattr(targets, name) for targets in stages])
            for name in Targets.__dataclass_fields__
        }
        offsets = np.concatenate([[0], np.cumsum([len(targets) for targets in stages])])
        return cls(Targets(**joined), offsets.astype(np.int64))

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, stage: int) -> Targets:
        """The targets of one stage, by its place in the chunk."""
        return self.targets.select(slice(self.offsets[stage], self.offsets[stage + 1]))

    def rows(self, stages: slice) -> CameraTargets:
        """The targets of consecutive stages."""
        first, last, _ = stages.indices(len(self))
        if (first, last) == (0, len(self)):
            return self
        offsets = self.offsets[first : last + 1]
        return CameraTargets(
            self.targets.select(slice(offsets[0], offsets[-1])), offsets - offsets[0]
        )

    @cached_property
    def stage(self) -> IntArray:
        """(N,) the stage's place in the chunk of every target."""
        return np.repeat(np.arange(len(self), dtype=np.int32), np.diff(self.offsets))

    @cached_property
    def unique_id(self) -> IntArray:
        """(N,) code numbers, -1 also where a picture has the same number at several places."""
        code = self.targets.id
        width = int(code.max(initial=-1)) + 2
        key = self.stage.astype(np.int64) * width + code + 1
        if len(self) * width <= _MOST_COUNTED:
            often = np.bincount(key)[key] > 1
        else:
            _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
            often = count[inverse] > 1
        return np.where(often, np.int32(-1), code).astype(np.int32)

    def stage_of(self, index: IntArray) -> IntArray:
        """The stage's place in the chunk of targets by their index."""
        return self.stage[index]


@dataclass(frozen=True)
class ChunkResult:
    """Some stages: what was seen, matched and reconstructed.

    ``matches`` and ``points`` count the targets of a camera over all stages.
    ``size`` where it was looked at; ``without_normal``: matches left out because a
    thickness was to be taken off and no ellipse said a normal.
    """

    cameras: tuple[CameraTargets, ...]
    matches: Matches
    points: StagePoints
    size: SizeCheck | None = None
    without_normal: int = 0

    @property
    def point_stage(self) -> IntArray:
        """(P,) the stage's place in the chunk of every point, ascending."""
        return stages_of(self.cameras, self.points.target)


def stages_of(cameras: Sequence[CameraTargets], target: IntArray) -> IntArray:
    """(P,) the stage's place of rows (P, C) of target indices, -1 = not seen."""
    stage = np.full(len(target), -1, dtype=np.int32)
    for c, camera in enumerate(cameras):
        seen = target[:, c] >= 0
        stage[seen] = camera.stage_of(target[seen, c])
    return stage


def measure_targets(
    triangulator: Triangulator,
    cameras: Sequence[CameraTargets],
    options: MatchingOptions | None = None,
    field: CalibrationField | None = None,
    diameter_mm: float | None = None,
    thickness_mm: float = 0.0,
) -> ChunkResult:
    """Match and reconstruct the targets of some stages, in order.

    With ``diameter_mm``, sightings of another size than circles of that
    diameter have at their place are left out: sectors of a ring whose dot is
    hidden, dots hidden in part; and points are the circles' centres, which are not
    where the ellipses' centres say. With ``thickness_mm`` they move by that much
    from the stickers' surface into the object.
    """
    rig = triangulator.rig
    field = field or CalibrationField(triangulator)
    targets = [camera.targets for camera in cameras]
    cov = [
        image_covariance(t, rig.sigma_floor_px.get(name, 0.0))
        for name, t in zip(rig.cameras, targets, strict=True)
    ]
    uncertain = [field.covariance(i, t.centre_px) for i, t in enumerate(targets)]
    if diameter_mm is not None:
        uncertain = [
            extra + possible_eccentricity(camera, t)
            for extra, camera, t in zip(uncertain, rig.cameras.values(), targets, strict=True)
        ]
    matches = _match(rig, cameras, options, uncertain)
    matches = check_facing(rig, targets, [c.unique_id for c in cameras], matches)
    centres = [t.centre_px for t in targets]
    size = None
    if diameter_mm is not None:
        points = reconstruct_stage(triangulator, matches, centres, cov)
        size = check_size(rig, targets, matches, points, diameter_mm)
        matches = size.matches
    points = reconstruct_stage(
        triangulator, matches, centres, cov, targets, diameter_mm, thickness_mm
    )
    lost = 0
    if thickness_mm != 0:
        plain = reconstruct_stage(triangulator, matches, centres, cov)
        lost = max(len(plain) - len(points), 0)
    return ChunkResult(tuple(cameras), matches, points, size, lost)


def _match(
    rig: RigData,
    cameras: Sequence[CameraTargets],
    options: MatchingOptions | None,
    extra_cov_px2: Sequence[FloatArray],
) -> Matches:
    """Matches of all stages, each in the light of the others, with targets counted over
    the chunk.
    """
    flat = [
        FlatTargets(
            offsets=camera.offsets,
            centre_px=camera.targets.centre_px,
            cov_px2=image_covariance(camera.targets, 0.0),
            id=camera.unique_id,
            semi_major_px=np.ascontiguousarray(camera.targets.semi_axes_px[:, 0]),
        )
        for camera in cameras
    ]
    found = match_stages(rig, flat, options, extra_cov_px2)
    stage = np.repeat(np.arange(len(found.offsets) - 1), np.diff(found.offsets))
    first = np.stack([camera.offsets[stage] for camera in cameras], axis=1)
    target = np.where(found.target >= 0, found.target + first, -1).astype(np.int32)
    return Matches(
        target=target,
        id=found.id,
        chi2=found.chi2,
        log_odds=found.log_odds,
        false_probability=found.false_probability,
        status=found.status,
    )
