"""From photographs of an object to the coordinates of its targets (the paper's step 1)."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_circles import PictureEllipses, circles_of
from videogrammetry.calibration.network_input import (
    NO_SCALE_BARS,
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
    ScaleBars,
)
from videogrammetry.calibration.network_result import NetworkAdjustment, NetworkOptions
from videogrammetry.calibration.network_start import StartReport, start_network
from videogrammetry.calibration.network_uncoded import link_uncoded
from videogrammetry.calibration.object_frame import drawing_fit, moved_network, own_axes
from videogrammetry.calibration.two_sided import TwoSides, two_sides, two_sides_remark
from videogrammetry.errors import CalibrationError, TableError
from videogrammetry.geometry import default_r0_px
from videogrammetry.pipeline.frames import Progress, map_bounded, read_and_recognize, silent
from videogrammetry.project.network_tables import NamedPoints, NamedScaleBar
from videogrammetry.recognition import RecognitionOptions
from videogrammetry.sequence.photograph import PhotoFacts, photo_facts
from videogrammetry.sequence.source import JoinedSource
from videogrammetry.types import INTERIOR_NAMES, Targets

#: Dots of which a picture needs some that are read, to be worth anything.
MIN_CODED = 3


@dataclass(frozen=True, kw_only=True)
class TargetOptions:
    """How photographs are measured.

    Attributes
    ----------
    recognition : of the targets.
    cameras : patterns of pictures' names, one a camera; without any, pictures of equal body,
        lens, focal length (EXIF) and size are of one camera.
    f_px : start value of f for all cameras; None: from EXIF, else searched.
    free : interior parameters to estimate; None: all ten, each kept if significant.
    eccentricity : model the ellipses' centres of dots whose normal the pictures tell.
    diameter_mm : of the dots; None: from the ellipses.
    uncoded : give un-coded dots that several pictures see a number and measure them.
    critical_value : of the data snooping.
    num_threads : 0 = one a core.
    """

    recognition: RecognitionOptions = field(default_factory=RecognitionOptions)
    cameras: tuple[str, ...] = ()
    f_px: float | None = None
    free: tuple[str, ...] | None = None
    eccentricity: bool = True
    diameter_mm: float | None = None
    uncoded: bool = True
    critical_value: float = 4.0
    num_threads: int = 0


@dataclass(frozen=True, kw_only=True)
class Photographs:
    """What the photographs hold: one entry a picture."""

    names: tuple[str, ...]
    files: tuple[Path, ...]
    sizes_px: tuple[tuple[int, int], ...]
    targets: tuple[Targets, ...]
    facts: tuple[PhotoFacts, ...]


@dataclass(frozen=True, kw_only=True)
class MeasuredTarget:
    """An object measured from photographs: the adjusted network and what it says of its sides."""

    photographs: Photographs
    network: NetworkInput
    result: NetworkAdjustment
    sides: TwoSides | None


def read_photographs(
    source: JoinedSource,
    names: Sequence[str],
    options: TargetOptions,
    progress: Progress = silent,
) -> Photographs:
    """Recognise the targets of all photographs."""

    def one(index: int) -> tuple[Targets, tuple[int, int]]:
        size = source.image_size_px_of(index)
        return read_and_recognize(source, index, options.recognition), size

    found = []
    for pair in map_bounded(one, range(len(source)), options.num_threads):
        found.append(pair)
        progress(len(found), len(source), "recognising")
    files = tuple(source.file(i) for i in range(len(source)))
    return Photographs(
        names=tuple(names),
        files=files,
        sizes_px=tuple(size for _, size in found),
        targets=tuple(targets for targets, _ in found),
        facts=tuple(photo_facts(path) for path in files),
    )


def picture_by_name(
    source: JoinedSource, names: Sequence[str]
) -> Callable[[str], npt.NDArray[Any] | None]:
    """Photographs by the names under which they were measured, for reports; None of others."""
    index = {name: i for i, name in enumerate(names)}

    @lru_cache(maxsize=4)
    def picture(name: str) -> npt.NDArray[Any] | None:
        return source.read(index[name]) if name in index else None

    return picture


def measure_target(
    photographs: Photographs,
    bars: Sequence[NamedScaleBar] = (),
    nominal: NamedPoints | None = None,
    options: TargetOptions | None = None,
    progress: Progress = silent,
) -> MeasuredTarget:
    """Coordinates of an object's targets from hand-held photographs.

    Coded targets link the pictures (relative orientations, resections); un-coded ones are
    matched by epipolar lines and confirmed by further pictures; a free network with the
    cameras' interior is adjusted, scaled by the bars, its datum by inner constraints.

    Parameters
    ----------
    photographs : of one object that did not change, from many places, some rolled by 90
        degrees. Pictures of equal camera, lens, focal length and size share their interior.
    bars : scale bars between coded targets. Without any, lengths are in an arbitrary unit
        unless ``nominal`` gives it.
    nominal : rough coordinates, as drawn: they place the object's frame (and give the
        scale where there is no bar); measured coordinates do not follow them otherwise.

    Raises
    ------
    CalibrationError, TableError : what is missing, where, and what to do.
    """
    options = options or TargetOptions()
    _check_twice(photographs)
    network = _network(photographs, bars, options)
    progress(0, 4, "orienting")
    started = start_network(network)
    _check_placed(started.report)
    remarks = list(dict.fromkeys(started.report.doubts))
    network = started.network
    progress(1, 4, "matching")
    if options.uncoded and (network.observations.point < 0).any():
        linked = link_uncoded(network)
        network = linked.network
        if linked.report.ambiguous:
            remarks.append(
                f"{linked.report.ambiguous} un-coded dots fit more than one point and were left "
                "out; more photographs from other directions would settle them"
            )
    network = _without_unknown(network)
    progress(2, 4, "adjusting")
    how = NetworkOptions(estimate_floor=True, num_threads=options.num_threads)
    result = adjust_network(network, how)
    network = _placed(network, result, nominal)
    if options.eccentricity:
        result = adjust_network(network, replace(how, robust_start=False))
        network = circles_of(network, result, _ellipses(photographs), options.diameter_mm)
    progress(3, 4, "adjusting")
    result = adjust_network(network, replace(how, robust_start=False))
    sides = two_sides(result)
    if sides is not None and (remark := two_sides_remark(sides, result.points.name)):
        remarks.append(remark)
    if not bars and nominal is None:
        remarks.append(
            "no scale bar and no nominal coordinates: all lengths are in an arbitrary unit; "
            "name a scale bar with --scale-bars"
        )
    progress(4, 4, "adjusting")
    result = replace(result, warnings=tuple(dict.fromkeys((*remarks, *result.warnings))))
    return MeasuredTarget(photographs=photographs, network=network, result=result, sides=sides)


def _check_twice(photographs: Photographs) -> None:
    """CalibrationError if a photograph is there twice: noise never repeats itself."""
    seen: dict[bytes, str] = {}
    for name, targets in zip(photographs.names, photographs.targets, strict=True):
        if len(targets) < MIN_CODED:
            continue
        key = targets.centre_px.tobytes()
        if key in seen:
            raise CalibrationError(
                f"photographs {seen[key]} and {name} hold the same {len(targets)} targets at the "
                "same places to the last digit: one photograph is given twice; take one out"
            )
        seen[key] = name


def _check_placed(report: StartReport) -> None:
    """CalibrationError if no network hangs together; two pictures alone check nothing."""
    if len(report.placed) > 2 or not report.left_out:
        return
    lost = "; ".join(f"{name}: {reason}" for name, reason in report.left_out[:4])
    raise CalibrationError(
        f"only {len(report.placed)} photographs ({', '.join(report.placed)}) hang together. "
        f"{lost}. Neighbouring photographs should share eight coded targets or more: take some in "
        "between"
    )


def _network(
    photographs: Photographs, bars: Sequence[NamedScaleBar], options: TargetOptions
) -> NetworkInput:
    """Tables of what was recognised; targets without a number wait for matching."""
    cameras, camera_of = _cameras(photographs, options)
    coded = [t.unique_id for t in photographs.targets]
    numbers = sorted({int(n) for ids in coded for n in ids[ids >= 0]})
    if not numbers:
        raise CalibrationError(
            "no coded target was read in any photograph: is --codes the family that is printed, "
            "and --polarity and --diameter-px as in the pictures? (videogrammetry recognize "
            "--overlay shows what is found)"
        )
    row = {number: i for i, number in enumerate(numbers)}
    image, point, xy, cov = [], [], [], []
    for i, (targets, ids) in enumerate(zip(photographs.targets, coded, strict=True)):
        keep = (ids >= 0) | options.uncoded
        image.append(np.full(int(keep.sum()), i, np.int32))
        point.append(np.array([row.get(int(n), -1) for n in ids[keep]], np.int32))
        xy.append(targets.centre_px[keep])
        cov.append(
            np.stack(
                [targets.cov[keep, 0, 0], targets.cov[keep, 0, 1], targets.cov[keep, 1, 1]], axis=1
            )
        )
    all_cov = np.concatenate(cov)
    names = tuple(map(str, numbers))
    return NetworkInput(
        cameras=cameras,
        images=tuple(
            NetworkImage(name=name, camera=camera)
            for name, camera in zip(photographs.names, camera_of, strict=True)
        ),
        points=NetworkPoints(
            name=names,
            position_mm=np.full((len(names), 3), np.nan),
            kind=np.full(len(names), "free"),
        ),
        observations=NetworkObservations(
            image=np.concatenate(image),
            point=np.concatenate(point),
            xy_px=np.concatenate(xy),
            cov_px2=all_cov,
        ),
        scale_bars=_bars(bars, names, photographs),
        sigma_px=float(np.sqrt(np.median(all_cov[:, [0, 2]]))),
        datum="free",
        critical_value=options.critical_value,
    )


def _cameras(
    photographs: Photographs, options: TargetOptions
) -> tuple[tuple[NetworkCamera, ...], list[int]]:
    """One camera a body, lens, focal length and picture size."""
    cameras: list[NetworkCamera] = []
    known: dict[object, int] = {}
    camera_of = []
    for name, size, facts in zip(
        photographs.names, photographs.sizes_px, photographs.facts, strict=True
    ):
        pattern = _pattern_of(name, options.cameras)
        key = (size, pattern) if options.cameras else (size, facts.body, facts.lens, facts.focal_mm)
        if key not in known:
            known[key] = len(cameras)
            interior = np.zeros(len(INTERIOR_NAMES))
            interior[0] = options.f_px or facts.f_px(size) or np.nan
            cameras.append(
                NetworkCamera(
                    name=pattern or f"camera{len(cameras) + 1}",
                    image_size_px=size,
                    interior=interior,
                    r0_px=default_r0_px(size),
                    free=options.free,
                )
            )
        camera_of.append(known[key])
    return tuple(cameras), camera_of


def _pattern_of(name: str, patterns: Sequence[str]) -> str:
    """The first pattern that a picture's name fits; empty without patterns."""
    for pattern in patterns:
        if fnmatch.fnmatch(name, pattern):
            return pattern
    if patterns:
        raise TableError(
            f"picture {name} fits none of the cameras' patterns ({', '.join(patterns)}): name a "
            "pattern for it too"
        )
    return ""


def _bars(
    bars: Sequence[NamedScaleBar], names: tuple[str, ...], photographs: Photographs
) -> ScaleBars:
    if not bars:
        return NO_SCALE_BARS
    row = {name: i for i, name in enumerate(names)}
    for number, bar in enumerate(bars, 1):
        for end in (bar.point_a, bar.point_b):
            if end not in row:
                raise TableError(
                    f"scale bar {number} ({bar.point_a}-{bar.point_b}): its end {end} was read in "
                    f"none of the {len(photographs.names)} photographs; photograph it, or take the "
                    "bar out of the table"
                )
    return ScaleBars(
        point_a=np.array([row[bar.point_a] for bar in bars], np.int32),
        point_b=np.array([row[bar.point_b] for bar in bars], np.int32),
        length_mm=np.array([bar.length_mm for bar in bars]),
        sigma_mm=np.array([bar.sigma_mm for bar in bars]),
        certificate=tuple(bar.certificate for bar in bars),
    )


def _without_unknown(network: NetworkInput) -> NetworkInput:
    """Without the targets that belong to no point."""
    o = network.observations
    keep = o.point >= 0
    return replace(
        network,
        observations=NetworkObservations(
            image=o.image[keep], point=o.point[keep], xy_px=o.xy_px[keep], cov_px2=o.cov_px2[keep]
        ),
    )


def _ellipses(photographs: Photographs) -> dict[str, PictureEllipses]:
    return {
        name: PictureEllipses(
            ellipse=np.column_stack([t.centre_px, t.semi_axes_px, t.angle_rad]),
            cov=t.cov[:, 2:, 2:],
        )
        for name, t in zip(photographs.names, photographs.targets, strict=True)
    }


def _placed(
    network: NetworkInput, result: NetworkAdjustment, nominal: NamedPoints | None
) -> NetworkInput:
    """The network at its solution, in the frame that users get."""
    if nominal is not None:
        placed = drawing_fit(
            result, nominal.name, nominal.position_mm, has_scale=len(network.scale_bars) > 0
        )
        return moved_network(network, result, *placed)
    return moved_network(
        network, result, *own_axes(result.points.position_mm, result.images.centre_mm[0])
    )
