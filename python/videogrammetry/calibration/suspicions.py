"""What a calibration's input and result give away: wrong units, sizes, files, attitudes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from videogrammetry.adjustment import Adjustment, principal_extents
from videogrammetry.calibration.bundle import Bundle
from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.calibration.pictures import MIN_POINTS
from videogrammetry.calibration.run import CameraFrames, KnownLength
from videogrammetry.errors import CalibrationError
from videogrammetry.types import FloatArray, PointSet

#: More of a camera's points outside its picture than this are no misreadings.
_OUTSIDE_SHARE = 0.01
#: Targets that are smaller or larger have their coordinates in another unit.
_SMALLEST_MM, _LARGEST_MM = 10.0, 1e5
#: Lenses are not mounted further from the picture's centre, as a part of its side.
_OFF_CENTRE = 0.1
#: A target is flat if its third extent is below this share of its first.
_FLAT = 1e-3
#: Attitudes of a flat target that differ by less count as one.
_SAME_ATTITUDE_RAD = np.radians(5.0)
#: Shifts of a target by less, as a part of its distance, are none.
_MOVED = 0.02
#: With fewer, sigma0 itself is known to no better than a sixth (1 / sqrt(2 r)).
_FEW_REDUNDANT = 20
#: Residuals so many times the stated sigma, and this large, are no noise of the pictures.
_LARGE_FLOOR, _LARGE_FLOOR_PX = 5.0, 0.1


def check_frames(cameras: Sequence[CameraFrames]) -> None:
    """CalibrationError for pictures that are given twice, or of another size than stated.

    Two pictures whose targets have the same places to the last digit are one picture:
    noise never repeats itself.
    """
    seen: dict[bytes, tuple[str, str]] = {}
    for camera in cameras:
        for frame in camera.frames:
            number, xy = np.asarray(frame.id), np.reshape(np.asarray(frame.xy_px, float), (-1, 2))
            if len(number) < MIN_POINTS or len(number) != len(xy):
                continue
            rows = np.column_stack([number, xy])
            key = rows[np.lexsort(rows.T)].tobytes()
            if key in seen:
                other, image = seen[key]
                raise CalibrationError(
                    f"picture {frame.image} of camera {camera.name} and {image} of camera {other} "
                    f"hold the same {len(number)} targets at the same places to the last digit: "
                    "one picture is given twice; name every camera's own pictures, each once"
                )
            seen[key] = (camera.name, frame.image)
        _check_size(camera)


def _check_size(camera: CameraFrames) -> None:
    places = [np.reshape(np.asarray(f.xy_px, float), (-1, 2)) for f in camera.frames]
    xy = np.concatenate(places) if places else np.empty((0, 2))
    xy = xy[np.isfinite(xy).all(axis=1)]
    size = np.array(camera.image_size_px)
    outside = ((xy < -1) | (xy > size)).any(axis=1)
    if len(xy) and outside.mean() > _OUTSIDE_SHARE:
        low, high = xy.min(axis=0), xy.max(axis=0)
        raise CalibrationError(
            f"camera {camera.name}: {int(outside.sum())} of its {len(xy)} image points lie outside "
            f"its pictures of {size[0]} x {size[1]} px (x from {low[0]:.0f} to {high[0]:.0f}, y "
            f"from {low[1]:.0f} to {high[1]:.0f}); is image_size_px that of other pictures, or "
            "width and height exchanged? Coordinates count from the centre of the upper left pixel"
        )


def doubts_of_target(target: PointSet) -> list[str]:
    """Warnings: a size that speaks of another unit, two numbers at one place."""
    warnings = []
    size = float(np.linalg.norm(np.ptp(target.position_mm, axis=0)))
    if len(target) > 1 and not _SMALLEST_MM <= size <= _LARGEST_MM:
        warnings.append(
            f"the target is {size:.3g} mm across: coordinates are millimetres here, are the "
            "table's in metres or micrometres? All lengths and the rig have this scale"
        )
    for a, b in sorted(cKDTree(target.position_mm).query_pairs(1e-6 * max(size, 1e-12)))[:3]:
        warnings.append(
            f"the target's points {target.id[a]} and {target.id[b]} lie at one place: one of them "
            "has a wrong number or wrong coordinates"
        )
    return warnings


def check_attitudes(
    bundle: Bundle, cameras: Sequence[CameraFrames], f_given: Sequence[bool], target: PointSet
) -> None:
    """CalibrationError if a flat target in one attitude has to give f and principal point.

    A plane's picture fixes two numbers of the interior at most (Zhang 2000, Eqs. 3-4): one
    attitude gives f where the principal point is held, and no more; what is found beside
    fits the pictures as well as the truth. Shifts help where two cameras see them.
    """
    extents = principal_extents(target.position_mm)
    if extents[2] > _FLAT * extents[0]:
        return
    normal = np.linalg.svd(target.position_mm - target.position_mm.mean(axis=0))[2][2]
    for index, camera in enumerate(bundle.camera_of):
        free = bundle.network.free(index)
        if f_given[camera] or "f" not in free or not {"x0", "y0"} & set(free):
            continue
        images = [
            i for i, p in enumerate(bundle.pictures) if p.camera == camera and i not in bundle.inner
        ]
        poses = [bundle.cam_from_target(i) for i in images]
        if not poses or _span_rad(np.array([r @ normal for r, _ in poses])) > _SAME_ATTITUDE_RAD:
            continue
        # Cameras that see a shifted plane together determine each other.
        centre = np.array([r @ target.position_mm.mean(axis=0) + t for r, t in poses])
        moved = np.linalg.norm(np.ptp(centre, axis=0)) > _MOVED * np.linalg.norm(centre[0])
        if len(bundle.camera_of) == 1 or not moved:
            raise CalibrationError(
                f"camera {cameras[camera].name}: its {len(images)} pictures show the flat target "
                "in one attitude only, which does not determine f and the principal point; tilt "
                "the target by 30 degrees and more between pictures and roll it by 90, or give "
                'start values and free = ["f", "A1"]'
            )


def _span_rad(normals: FloatArray) -> float:
    """Largest angle between two directions."""
    cosine = np.clip(np.abs(normals @ normals.T), 0.0, 1.0)
    return float(np.arccos(cosine.min()))


def doubts_of_result(
    bundle: Bundle, adjustment: Adjustment, cameras: Sequence[CameraFrames]
) -> list[str]:
    """Warnings: hardly any redundancy, a principal point far off, residuals beyond the noise."""
    warnings = []
    if adjustment.redundancy < _FEW_REDUNDANT:
        share = 1.0 / np.sqrt(2.0 * max(adjustment.redundancy, 1))
        warnings.append(
            f"the redundancy is {adjustment.redundancy} only: sigma0, and with it every standard "
            f"deviation, is known to {share:.0%}, and a wrong point is hardly found; take more "
            "pictures with more points"
        )
    for index, camera in enumerate(bundle.camera_of):
        frames = cameras[camera]
        off = np.abs(bundle.network.interior(index)[1:3]) / frames.image_size_px
        if off.max() > _OFF_CENTRE:
            x0, y0 = bundle.network.interior(index)[1:3]
            warnings.append(
                f"camera {frames.name}: the principal point lies {x0:.0f}, {y0:.0f} px off the "
                f"centre of pictures of {frames.image_size_px[0]} x {frames.image_size_px[1]} px: "
                "are the coordinates those of pictures of another size, of a crop, or with "
                "another origin? If not, the pictures hardly determine it: tilt the target more"
            )
        floor = bundle.network.floor_px(index)
        cov = np.concatenate([p.cov_px2 for p in bundle.pictures if p.camera == camera])
        sigma = float(np.sqrt(np.median(cov[:, [0, 2]])))
        if max(_LARGE_FLOOR_PX, _LARGE_FLOOR * sigma) < floor <= 0.5:
            warnings.append(
                f"camera {frames.name}: its points scatter by {floor:.2f} px, {floor / sigma:.0f} "
                "times as much as they should: the model does not fit (a parameter held at a "
                "wrong value, a camera that moved, a target that bends, pictures that are not "
                "synchronous); the standard deviations do not cover that"
            )
    return warnings


def doubts_of_lengths(bars: AdjustedBars, lengths: Sequence[KnownLength]) -> list[str]:
    """Warnings of known lengths that the others, and the target, contradict."""
    out = np.flatnonzero(~bars.used)
    if not len(out):
        return []
    if len(out) == len(bars):
        part = float(np.median(bars.residual_mm / bars.length_mm))
        return [
            f"all {len(bars)} known lengths contradict the target's coordinates (they are "
            f"{abs(part):.2%} {'longer' if part > 0 else 'shorter'} than the adjusted ones) and "
            "are left out: the scale is the target's; check units, point numbers and temperatures"
        ]
    return [
        f"the known length {lengths[i].point_a}-{lengths[i].point_b} of {bars.length_mm[i]:.3f} mm "
        f"is {bars.residual_mm[i]:+.3f} mm from the adjusted one ({abs(bars.normalised[i]):.1f} "
        "standard deviations) and is left out: check its number, unit and temperature"
        for i in out.tolist()
    ]
