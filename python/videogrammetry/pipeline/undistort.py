"""Undistortion of tables and sequences: what ``videogrammetry undistort`` does."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import MeasurementError
from videogrammetry.geometry import Undistortion, undistort_ellipses, undistort_points
from videogrammetry.pipeline.frames import Progress, map_bounded, silent
from videogrammetry.project import TargetTable
from videogrammetry.sequence import JoinedSource, SequenceWriter
from videogrammetry.types import RigCamera


def undistort_targets(
    table: TargetTable,
    cameras: Mapping[str, tuple[RigCamera, RigCamera]],
    camera: str | None = None,
) -> TargetTable:
    """Targets as the ideal cameras would have shown them.

    Centres with the lens' curve over the ellipse (``undistort_ellipses``), covariances by
    the undistortion's derivative. A table holds standard deviations alone: x and y are
    taken as not correlated, and the small correlation that the derivative makes is not
    written.

    Parameters
    ----------
    cameras : name -> (real, ideal). camera : that of rows which name none; None: the
        only one of ``cameras``.

    Raises
    ------
    MeasurementError
        A row names no camera or an unknown one, or cannot be undistorted.
    """
    fallback = camera or (next(iter(cameras)) if len(cameras) == 1 else "")
    names = np.array([name or fallback for name in table.camera], dtype=object)
    for row, name in enumerate(names):
        if name not in cameras:
            what = f"camera {name!r} is not in the rig" if name else "no camera is named"
            raise MeasurementError(
                f"target {row + 1} ({table.image[row]}): {what}, which has "
                f"{', '.join(cameras)}; name one with --camera"
            )
    xy, axes, angle = np.empty((len(table), 2)), table.semi_axes_px.copy(), table.angle_rad.copy()
    sigma = np.empty_like(xy)
    for name, (real, ideal) in cameras.items():
        rows = np.flatnonzero(names == name)
        cov = np.zeros((len(rows), 2, 2))
        cov[:, [0, 1], [0, 1]] = table.sigma_px[rows] ** 2
        stated = np.isfinite(table.sigma_px[rows])
        _, turned = undistort_points(real, table.xy_px[rows], np.nan_to_num(cov), ideal=ideal)
        variance = turned[:, [0, 1], [0, 1]]
        sigma[rows] = np.where(stated, np.sqrt(variance), np.nan)
        xy[rows], axes[rows], angle[rows] = undistort_ellipses(
            real, table.xy_px[rows], table.semi_axes_px[rows], table.angle_rad[rows], ideal=ideal
        )
    lost = np.flatnonzero(~np.isfinite(xy).all(axis=1))
    if len(lost):
        raise MeasurementError(
            f"target {lost[0] + 1} ({table.image[lost[0]]}) lies where the distortion folds over; "
            "take it out, or calibrate up to the picture's corners"
        )
    return dataclasses.replace(table, xy_px=xy, semi_axes_px=axes, angle_rad=angle, sigma_px=sigma)


def undistort_sequence(
    source: JoinedSource,
    undistortion: Undistortion,
    create: Callable[[int], SequenceWriter],
    progress: Progress = silent,
) -> None:
    """All frames of a sequence, in threads, to a writer.

    ``create`` makes the writer of a bit depth: that of the first frame, as its file
    states it.

    Raises
    ------
    SequenceError, ValueError
        A frame cannot be read, or has not the camera's size.
    """
    first = source.read(0)
    bit_depth = source.bit_depth or 8 * first.dtype.itemsize
    single = dataclasses.replace(undistortion, num_threads=1)
    _ = single.map_px  # once, not in every thread

    def one(index: int) -> npt.NDArray[Any]:
        return single(source.read(index), largest=2**bit_depth - 1)

    with create(bit_depth) as writer:
        for done, frame in enumerate(map_bounded(one, range(len(source))), start=1):
            writer.append(frame)
            progress(done, len(source))


def picture_names(source: JoinedSource) -> list[str]:
    """Names of a sequence's pictures without suffix; their numbers where two would be alike.

    A frame of a file with several, ``rec.cihx#7``, is ``rec_000007``.
    """
    names = list(_stems(source))
    if len(set(names)) < len(names):
        return [f"{n}_{i:06d}" for i, n in enumerate(names, start=1)]
    return names


def _stems(source: JoinedSource) -> Iterator[str]:
    for i in range(len(source)):
        file, _, number = source.name(i).partition("#")
        stem = PurePath(file).stem
        yield f"{stem}_{int(number):06d}" if number.isdigit() else stem
