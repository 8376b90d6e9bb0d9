"""The pictures of a calibration: targets sorted by what the target's point list knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.calibration.run import CalibrationOptions, CameraFrames, FrameTargets, Rejection
from videogrammetry.errors import CalibrationError
from videogrammetry.types import FloatArray, IntArray, PointSet, matrix_from_cov6

#: A pose of a picture needs four points: three leave up to four poses.
MIN_POINTS = 4
#: The target's accuracy where nothing is said: 0.1 mm per metre of its size.
DEFAULT_SIGMA_PER_SIZE = 1e-4


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One camera's picture of one stage.

    ``point`` (n,) rows of the target's point list seen at ``xy_px`` (n, 2) with
    ``cov_px2`` (n, 3), their ellipses (n, 3) and (n, 3, 3), NaN where not known;
    ``open_...``: targets without a number.
    """

    camera: int
    stage: int
    image: str
    point: IntArray
    xy_px: FloatArray
    cov_px2: FloatArray
    open_xy_px: FloatArray
    open_cov_px2: FloatArray
    ellipse: FloatArray
    ellipse_cov: FloatArray
    open_ellipse: FloatArray
    open_ellipse_cov: FloatArray

    def __len__(self) -> int:
        return len(self.point)


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """All pictures, with what could not be used."""

    pictures: tuple[Picture, ...]
    rejected: tuple[Rejection, ...]
    warnings: tuple[str, ...]

    def of_camera(self, camera: int) -> list[Picture]:
        """The pictures of one camera, by stage."""
        return [p for p in self.pictures if p.camera == camera]


def check_input(cameras: Sequence[CameraFrames], target: PointSet) -> None:
    """ValueError for what no calibration can start from."""
    if not cameras:
        raise ValueError("cameras: expected at least one, got none")
    names = [camera.name for camera in cameras]
    if len(set(names)) != len(names):
        raise ValueError(f"cameras: names must differ, got {names}")
    if len(np.unique(target.id)) != len(target):
        values, counts = np.unique(target.id, return_counts=True)
        raise ValueError(f"target: number {values[counts > 1][0]} stands there more than once")
    if not np.isfinite(target.position_mm).all():
        bad = target.id[~np.isfinite(target.position_mm).all(axis=1)][0]
        raise ValueError(f"target: coordinates of point {bad} are not finite")
    if target.diameter_mm is not None and (target.diameter_mm <= 0).any():
        bad = target.id[target.diameter_mm <= 0][0]
        raise ValueError(f"target: diameter_mm of point {bad} is not positive")
    for camera in cameras:
        stages = [frame.stage for frame in camera.frames]
        if len(set(stages)) != len(stages):
            raise ValueError(f"camera {camera.name}: two pictures of one stage")


def target_covariance(target: PointSet, options: CalibrationOptions) -> FloatArray:
    """(N, 3, 3) covariance of the target's coordinates: option, file, or 0.1 mm per metre."""
    n = len(target)
    if options.sigma_mm is not None:
        if not options.sigma_mm > 0:
            raise ValueError(f"sigma_mm: expected > 0, got {options.sigma_mm}")
        return np.tile(np.eye(3) * options.sigma_mm**2, (n, 1, 1))
    size = float(np.linalg.norm(np.ptp(target.position_mm, axis=0)))
    default = np.eye(3) * (DEFAULT_SIGMA_PER_SIZE * size) ** 2
    if target.cov_mm2 is None:
        return np.tile(default, (n, 1, 1))
    cov = matrix_from_cov6(target.cov_mm2)
    known = np.isfinite(cov).all(axis=(1, 2)) & (np.trace(cov, axis1=1, axis2=2) > 0)
    cov[~known] = default
    # A coordinate stated without error would make the weights infinite.
    return cov + np.eye(3) * (1e-7 * size) ** 2


def collect_pictures(
    cameras: Sequence[CameraFrames], target: PointSet, *, keep_unknown: bool = False
) -> Pictures:
    """Sort every frame's targets: known, un-coded, unknown to the target (counted), duplicate.

    ``keep_unknown``: numbers that the target has not are of use elsewhere and not listed.

    Raises
    ------
    CalibrationError : no number that was read is one of the target's.
    """
    row_of = {int(number): row for row, number in enumerate(target.id)}
    pictures: list[Picture] = []
    rejected: list[Rejection] = []
    coded = 0
    for index, camera in enumerate(cameras):
        for frame in sorted(camera.frames, key=lambda f: f.stage):
            coded += int((frame.id >= 0).sum())
            picture, reasons = _sort_frame(index, camera.name, frame, row_of)
            pictures.append(picture)
            rejected += reasons
    unknown = sum(r.kind == "unknown-target" for r in rejected)
    if coded == 0:
        raise CalibrationError(
            "no picture shows a coded target whose number was read; check the code family, its "
            "reading direction and the polarity ([targets] codes, direction, polarity)"
        )
    if unknown == coded:
        seen = sorted({r.point_id for r in rejected if r.point_id is not None})[:8]
        raise CalibrationError(
            f"none of the {coded} numbers read in the pictures is in the target's point list "
            f"(read e.g. {seen}; the list has {sorted(row_of)[:8]}...): the code family or the "
            "target file is another one"
        )
    warnings = []
    if keep_unknown:
        rejected = [r for r in rejected if r.kind != "unknown-target"]
    elif unknown:
        numbers = sorted({r.point_id for r in rejected if r.kind == "unknown-target"}, key=str)
        warnings.append(
            f"{unknown} of {coded} numbers read are not in the target's point list and are left "
            f"out: {', '.join(map(str, numbers[:12]))}{' ...' if len(numbers) > 12 else ''}"
        )
    return Pictures(pictures=tuple(pictures), rejected=tuple(rejected), warnings=tuple(warnings))


def _sort_frame(
    camera: int, name: str, frame: FrameTargets, row_of: dict[int, int]
) -> tuple[Picture, list[Rejection]]:
    xy = np.reshape(np.asarray(frame.xy_px, float), (-1, 2))
    cov = np.reshape(np.asarray(frame.cov_px2, float), (-1, 3))
    number = np.asarray(frame.id)
    if not len(xy) == len(cov) == len(number):
        raise ValueError(
            f"{frame.image}: {len(number)} ids, {len(xy)} positions, {len(cov)} covariances"
        )
    _check_covariance(frame.image, cov)
    ellipse, ellipse_cov = _ellipses(frame, len(number))
    rejected = []
    finite = np.isfinite(xy).all(axis=1)
    values, counts = np.unique(number[(number >= 0) & finite], return_counts=True)
    twice = {int(v) for v in values[counts > 1]}
    coded = np.flatnonzero((number >= 0) & finite)
    row = np.array([row_of.get(n, -1) for n in number[coded].tolist()], np.int32)
    good = (row >= 0) & ~np.isin(number[coded], list(twice))
    rows, keep = row[good], coded[good]
    for i in coded[~good]:
        point_id = int(number[i])
        if point_id not in row_of:
            rejected.append(
                Rejection(
                    kind="unknown-target",
                    camera=name,
                    image=frame.image,
                    point_id=point_id,
                    value=float(point_id),
                    reason=f"number {point_id} is not in the target's point list",
                )
            )
        else:
            rejected.append(
                Rejection(
                    kind="target",
                    camera=name,
                    image=frame.image,
                    point_id=point_id,
                    value=2.0,
                    reason=f"number {point_id} was read at several places",
                )
            )
    no_number = np.flatnonzero((number < 0) & finite)
    picture = Picture(
        camera=camera, stage=frame.stage, image=frame.image,
        point=rows, xy_px=xy[keep], cov_px2=cov[keep],
        open_xy_px=xy[no_number], open_cov_px2=cov[no_number],
        ellipse=ellipse[keep], ellipse_cov=ellipse_cov[keep],
        open_ellipse=ellipse[no_number], open_ellipse_cov=ellipse_cov[no_number],
    )  # fmt: skip
    return picture, rejected


def unread_picture(
    camera: int, frame: FrameTargets, point: Sequence[int], rows: Sequence[int]
) -> Picture:
    """Some of a frame's targets, as sightings of these points, without the others."""
    keep = list(rows)
    ellipse, ellipse_cov = _ellipses(frame, len(frame.id))
    return Picture(
        camera=camera, stage=frame.stage, image=frame.image, point=np.array(point, np.int32),
        xy_px=np.asarray(frame.xy_px, float)[keep], cov_px2=np.asarray(frame.cov_px2, float)[keep],
        open_xy_px=np.empty((0, 2)), open_cov_px2=np.empty((0, 3)),
        ellipse=ellipse[keep], ellipse_cov=ellipse_cov[keep],
        open_ellipse=np.empty((0, 3)), open_ellipse_cov=np.empty((0, 3, 3)),
    )  # fmt: skip


def _ellipses(frame: FrameTargets, count: int) -> tuple[FloatArray, FloatArray]:
    if frame.ellipse is None or frame.ellipse_cov is None:
        return np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    ellipse, cov = np.asarray(frame.ellipse, float), np.asarray(frame.ellipse_cov, float)
    if ellipse.shape != (count, 3) or cov.shape != (count, 3, 3):
        raise ValueError(
            f"{frame.image}: expected ellipse ({count}, 3) and ellipse_cov ({count}, 3, 3), got "
            f"{ellipse.shape} and {cov.shape}"
        )
    return ellipse, cov


def _check_covariance(image: str, cov: FloatArray) -> None:
    good = (cov[:, 0] > 0) & (cov[:, 2] > 0) & (cov[:, 0] * cov[:, 2] > cov[:, 1] ** 2)
    if not good.all():
        raise ValueError(
            f"{image}: covariance {cov[~good][0].tolist()} (xx, xy, yy) of an image point is not "
            "positive definite"
        )
