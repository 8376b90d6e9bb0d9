"""What is kept of some stages: flat arrays, in memory or in one file."""

from __future__ import annotations

import json
import math
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.calibrated_volume import CalibratedVolume
from videogrammetry.errors import MeasurementError
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.pipeline.chunk import ChunkResult
from videogrammetry.project.atomic import atomic_path
from videogrammetry.types import (
    POINT_FLAGS,
    FloatArray,
    IntArray,
    cov6_from_matrix,
)

#: Least log odds of a match or a link that is not called ambiguous: 100 to 1.
SURE_LOG_ODDS = 4.6
#: Of the RMS residual over what its redundancy lets expect: two-sided 1e-4.
_CRITICAL = 3.89


@dataclass(frozen=True, kw_only=True)
class ChunkRecord:
    """Some stages: M targets in the order of stage and camera, P points in that of stages.

    Attributes
    ----------
    stage : (S,) numbers from 1.
    target_count : (S, C). point_count : (S,).
    centre_px, semi_axes_px, sigma_px, residual_px : (M, 2). angle_rad : (M,).
    code_id : (M,). match_status, ring_status : (M,).
    target_point : (M,) the point that a target went into, counted over the chunk, or -1.
    point_code : (P,) code number or -1.
    position_mm : (P, 3). cov_mm2, cov_image_mm2 : (P, 6).
    cameras_used : (P, C). rms_px : (P,). flags : (P,) bits by ``POINT_FLAGS``.
    eccentricity_px : (P,), or empty where it was not asked for.
    coded_ends : (S, C, 2) how many coded targets of a camera met the rays of their ID in
        another camera, and how many did not.
    size_mm : sizes of the sightings left out for them. size_checked, without_normal : counts.
    searched_whole : (S, C) whether the whole frame was searched.
    """

    stage: IntArray
    target_count: IntArray
    point_count: IntArray
    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    sigma_px: FloatArray
    residual_px: FloatArray
    code_id: IntArray
    match_status: npt.NDArray[np.uint8]
    ring_status: npt.NDArray[np.uint8]
    target_point: IntArray
    point_code: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray
    cov_image_mm2: FloatArray
    cameras_used: npt.NDArray[np.bool_]
    rms_px: FloatArray
    flags: npt.NDArray[np.uint8]
    eccentricity_px: FloatArray
    coded_ends: IntArray
    size_mm: FloatArray
    size_checked: int
    without_normal: int
    searched_whole: npt.NDArray[np.bool_]

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(np.asarray(getattr(self, name)).nbytes for name in _NAMES)

    def point_offsets(self) -> npt.NDArray[np.int64]:
        """(S + 1,) where the points of every stage begin."""
        return np.concatenate([[0], np.cumsum(self.point_count)]).astype(np.int64)


_NAMES = tuple(field.name for field in fields(ChunkRecord))
_NUMBERS = ("size_checked", "without_normal")


def make_record(
    result: ChunkResult,
    stage: IntArray,
    volume: CalibratedVolume,
    searched_whole: npt.NDArray[np.bool_] | None = None,
) -> ChunkRecord:
    """The record of a chunk's result."""
    cameras, points = result.cameras, result.points
    count = np.stack([np.diff(c.offsets) for c in cameras], axis=1).astype(np.int32)
    # Stage by stage, in it camera by camera: where every camera's targets go.
    start = np.concatenate([[0], np.cumsum(count.reshape(-1))])[:-1].reshape(count.shape)
    rows = [
        start[camera.stage, c] + np.arange(len(camera.targets)) - camera.offsets[camera.stage]
        for c, camera in enumerate(cameras)
    ]
    total = int(count.sum())

    def gather(parts: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        pairs = parts[0].dtype == np.float64 and parts[0].ndim == 2
        if pairs:  # as one number each, which numpy puts several times as fast
            parts = [np.ascontiguousarray(part).view(np.complex128)[:, 0] for part in parts]
        joined = np.empty(total, parts[0].dtype)
        for where, part in zip(rows, parts, strict=True):
            joined[where] = part
        return joined.view(np.float64).reshape(total, 2) if pairs else joined

    targets = [camera.targets for camera in cameras]
    point_of, residual = _of_targets(result)
    point_stage = result.point_stage
    size = result.size
    cov_image = cov6_from_matrix(points.cov_image_mm2)
    return ChunkRecord(
        stage=np.asarray(stage, dtype=np.int32),
        target_count=count,
        point_count=np.bincount(point_stage, minlength=len(stage)).astype(np.int32),
        centre_px=gather([t.centre_px for t in targets]),
        semi_axes_px=gather([t.semi_axes_px for t in targets]),
        angle_rad=gather([t.angle_rad for t in targets]),
        sigma_px=gather([t.sigma_px for t in targets]),
        residual_px=gather(residual),
        code_id=gather([t.id for t in targets]),
        match_status=gather(list(result.matches.status)),
        ring_status=gather([t.ring_status for t in targets]),
        target_point=gather(point_of),
        point_code=points.id.astype(np.int32),
        position_mm=points.position_mm,
        cov_mm2=cov_image + cov6_from_matrix(points.cov_rig_mm2),
        cov_image_mm2=cov_image,
        cameras_used=points.target >= 0,
        rms_px=points.rms_px,
        flags=_flags(result, volume),
        eccentricity_px=np.empty(0) if points.eccentricity_px is None else points.eccentricity_px,
        coded_ends=_coded_ends(result, len(stage)),
        size_mm=np.empty(0) if size is None else size.measured_mm,
        size_checked=0 if size is None else size.num_checked,
        without_normal=result.without_normal,
        searched_whole=np.ones(count.shape, bool) if searched_whole is None else searched_whole,
    )


def join_records(records: Sequence[ChunkRecord]) -> ChunkRecord:
    """The record of consecutive stages from those of their parts."""
    if len(records) == 1:
        return records[0]
    values: dict[str, Any] = {
        name: np.concatenate([getattr(record, name) for record in records])
        for name in _NAMES
        if name not in _NUMBERS
    }
    values |= {name: sum(getattr(record, name) for record in records) for name in _NUMBERS}
    before = np.cumsum([0, *(len(record.point_code) for record in records[:-1])])
    values["target_point"] = np.concatenate(
        [
            np.where(record.target_point >= 0, record.target_point + first, -1).astype(np.int32)
            for record, first in zip(records, before, strict=True)
        ]
    )
    return ChunkRecord(**values)


def _of_targets(result: ChunkResult) -> tuple[list[IntArray], list[FloatArray]]:
    """Of every camera's targets the point that each went into, and its residual there."""
    point_of, residual = [], []
    # A pair as one number: see gather.
    pairs = np.ascontiguousarray(result.points.residual_px).view(np.complex128)[..., 0]
    for c, camera in enumerate(result.cameras):
        points = np.full(len(camera.targets), -1, dtype=np.int32)
        left = np.full(len(camera.targets), complex(np.nan, np.nan))
        seen = np.flatnonzero(result.points.target[:, c] >= 0)
        index = result.points.target[seen, c]
        points[index] = seen
        left[index] = pairs[seen, c]
        point_of.append(points)
        residual.append(left.view(np.float64).reshape(-1, 2))
    return point_of, residual


def _coded_ends(result: ChunkResult, num_stages: int) -> IntArray:
    ends = np.zeros((num_stages, len(result.cameras), 2), dtype=np.int32)
    for c, camera in enumerate(result.cameras):
        status = result.matches.status[c]
        for k, name in enumerate(("matched", "inconsistent ID")):
            counted = (camera.unique_id >= 0) & (status == TARGET_STATUS.index(name))
            ends[:, c, k] = np.bincount(camera.stage[counted], minlength=num_stages)
    return ends


def _flags(result: ChunkResult, volume: CalibratedVolume) -> npt.NDArray[np.uint8]:
    """Bits by ``POINT_FLAGS`` of what one stage says of its points."""
    points = result.points
    rays = (points.target >= 0).sum(axis=1)
    # Wilson and Hilferty's cube root makes chi-square normal.
    redundancy = np.maximum(2 * rays - 3, 1)
    width = 2 / (9 * redundancy)
    normal = (np.cbrt(points.chi2 / redundancy) - (1 - width)) / np.sqrt(width)
    unsure = (points.id < 0) & (_log_odds(result) < SURE_LOG_ODDS)
    said = {
        "two_rays": rays == 2,
        "large_residual": normal > _CRITICAL,
        "outside_volume": ~volume.contains(points.position_mm),
        "ambiguous": unsure,
    }
    flags = np.zeros(len(points), dtype=np.uint8)
    for name, where in said.items():
        flags |= np.where(where, 1 << POINT_FLAGS.index(name), 0).astype(np.uint8)
    return flags


def _log_odds(result: ChunkResult) -> FloatArray:
    """(P,) of the matches that the points come of."""
    odds = np.full(len(result.points), np.inf)
    for c in range(len(result.cameras)):
        of_target = np.full(len(result.cameras[c].targets), np.inf)
        seen = np.flatnonzero(result.matches.target[:, c] >= 0)
        of_target[result.matches.target[seen, c]] = result.matches.log_odds[seen]
        here = np.flatnonzero(result.points.target[:, c] >= 0)
        odds[here] = of_target[result.points.target[here, c]]
    return odds


#: What reading a damaged archive may raise.
_DAMAGED = (OSError, KeyError, TypeError, ValueError, EOFError, RuntimeError, struct.error)
#: Arrays begin at multiples of so many bytes, whatever numbers they hold.
_ALIGN = 16


def write_record(path: Path, record: ChunkRecord) -> None:
    """Writes a record, whole or not at all.

    An uncompressed ``.npz`` of two arrays, because two dozen would take longer than what is
    in them: the bytes of all fields one after the other, and in JSON what they are. The
    archive's checksums tell a damaged part, which is measured anew; so it need not wait for
    the disk.
    """
    layout, pieces, end = [], [], 0
    for name in _NAMES:
        array = np.ascontiguousarray(getattr(record, name))
        layout.append([name, array.dtype.str, list(np.shape(getattr(record, name))), end])
        gap = -array.nbytes % _ALIGN
        pieces += [array.reshape(-1).view(np.uint8).data, bytes(gap)]
        end += array.nbytes + gap
    told = np.frombuffer(json.dumps(layout).encode(), np.uint8)
    with atomic_path(path, flush=False) as beside, zipfile.ZipFile(beside, "w") as archive:
        with archive.open("layout.npy", "w") as member:
            np.lib.format.write_array(member, told)
        with archive.open("data.npy", "w", force_zip64=True) as member:
            header = {"descr": "|u1", "fortran_order": False, "shape": (end,)}
            np.lib.format.write_array_header_1_0(member, header)
            for piece in pieces:
                member.write(piece)


def read_record(path: Path) -> ChunkRecord:
    """Reads a record; its arrays cannot be written to.

    Raises
    ------
    MeasurementError
        The file is damaged.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            told, data = (_array_bytes(file, archive, n) for n in ("layout.npy", "data.npy"))
        values: dict[str, Any] = {}
        for name, dtype, shape, begin in json.loads(told.tobytes()):
            count = math.prod(shape)
            values[name] = np.frombuffer(data.data, dtype, count, begin).reshape(shape)
        values |= {name: int(values[name]) for name in _NUMBERS}
        return ChunkRecord(**values)
    except (*_DAMAGED, zipfile.BadZipFile) as error:
        raise MeasurementError(
            f"{path}: this part of the measurement is damaged ({error}); remove the file and run "
            "`videogrammetry measure` again: it is measured anew"
        ) from error


def _array_bytes(file: BinaryIO, archive: zipfile.ZipFile, name: str) -> npt.NDArray[np.uint8]:
    """An array of bytes; its checksum is looked at. ``archive.read`` would copy it twice."""
    info = archive.getinfo(name)
    file.seek(info.header_offset)
    local = file.read(30)  # the format's "local file header", its two last numbers lengths
    file.seek(int.from_bytes(local[26:28], "little") + int.from_bytes(local[28:30], "little"), 1)
    data = np.fromfile(file, np.uint8, info.file_size)
    if zlib.crc32(data.data) != info.CRC or data[:8].tobytes() != b"\x93NUMPY\x01\x00":
        raise ValueError(f"the checksum of {name} is another")
    return data[10 + int(data[8]) + 256 * int(data[9]) :]
