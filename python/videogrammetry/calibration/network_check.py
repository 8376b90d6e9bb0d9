"""Faults of a network that can be named before anything is calculated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.calibration.network_input import (
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
    ScaleBars,
)
from videogrammetry.calibration.network_result import BoolArray, NetworkRejection
from videogrammetry.errors import CalibrationError
from videogrammetry.types import IntArray

#: A pose has six unknowns: three points of known position determine it, up to four ways.
MIN_POINTS_OF_IMAGE = 4
#: Millimetres from the sensor's corner or centre never exceed this part of the pixels.
MILLIMETRES_PART = 0.05
#: The tolerance of a picture's edge: half a pixel either origin.
EDGE_PX = 1.0


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A network of what can be adjusted, and what had to be left out of it."""

    network: NetworkInput
    rejected: tuple[NetworkRejection, ...]
    warnings: tuple[str, ...]


def check_network(network: NetworkInput) -> Checked:
    """Refuse what is wrong in itself; set aside what cannot take part.

    Left out, with a line each: points of unknown position in fewer than two
    pictures, pictures of fewer than four points, un-coded targets, and pictures that
    no chain of common points joins to the largest group.

    Raises
    ------
    ValueError : not finite, indices out of range, wrong shapes.
    CalibrationError : coordinates outside the pictures or in other units, a point
        twice in a picture, nothing left to adjust.
    """
    _check_arrays(network)
    _check_repeated(network)
    _check_pixels(network)
    datum, warnings = _with_datum(network)
    used = network.observations.point >= 0
    if not used.any():
        raise CalibrationError(
            "no observation names its point: give the targets' numbers in the column point"
        )
    rejected: list[NetworkRejection] = []
    if not used.all():
        warnings.append(
            f"{int((~used).sum())} targets without a point's name take no part: matching of "
            "un-coded targets comes before the adjustment"
        )
    used = _enough_rays(datum, used, rejected)
    used = _connected(datum, used, rejected, warnings)
    used = _enough_rays(datum, used, rejected)
    if not used.any():
        raise CalibrationError(_nothing_left(datum, rejected))
    _lonely_picture(datum, used)
    kept = _subset(datum, used, rejected, warnings)
    _known_points(kept)
    return Checked(network=kept, rejected=tuple(rejected), warnings=tuple(warnings))


def _check_arrays(network: NetworkInput) -> None:
    seen = network.observations
    shapes = {"xy_px": (len(seen), 2), "cov_px2": (len(seen), 3), "point": (len(seen),)}
    for name, shape in shapes.items():
        array = np.asarray(getattr(seen, name))
        if array.shape != shape:
            raise ValueError(f"observations.{name}: expected shape {shape}, got {array.shape}")
        bad = ~np.isfinite(array.reshape(len(seen), -1)).all(axis=1)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise ValueError(
                f"observations.{name}: row {row} ({_place(network, row)}) is not finite"
            )
    if (seen.cov_px2[:, [0, 2]] <= 0).any():
        raise ValueError("observations.cov_px2: expected positive variances")
    limits = {
        "observations.image": (seen.image, 0, len(network.images)),
        "observations.point": (seen.point, -1, len(network.points)),
        "scale_bars.point_a": (network.scale_bars.point_a, 0, len(network.points)),
        "scale_bars.point_b": (network.scale_bars.point_b, 0, len(network.points)),
        "images.camera": (np.array([i.camera for i in network.images]), 0, len(network.cameras)),
    }
    for name, (index, low, high) in limits.items():
        if len(index) and (index.min() < low or index.max() >= high):
            raise ValueError(f"{name}: expected {low} to {high - 1}, got {index.min()} to "
                             f"{index.max()}")  # fmt: skip
    if len(set(network.points.name)) < len(network.points):
        raise ValueError("points.name: a name stands twice; every point has its own")
    known = network.points.kind != "free"
    bad = known & ~np.isfinite(network.points.position_mm).all(axis=1)
    if bad.any():
        name = network.points.name[int(np.flatnonzero(bad)[0])]
        raise CalibrationError(
            f"point {name} is fixed or has sigmas, but no coordinates: give them, or let it be free"
        )
    if not network.sigma_px > 0:
        raise ValueError(f"sigma_px: expected > 0, got {network.sigma_px}")


def _place(network: NetworkInput, row: int) -> str:
    seen = network.observations
    image, point = int(seen.image[row]), int(seen.point[row])
    name = network.points.name[point] if 0 <= point < len(network.points) else "without a name"
    picture = network.images[image].name if 0 <= image < len(network.images) else "?"
    return f"picture {picture}, point {name}"


def _check_repeated(network: NetworkInput) -> None:
    seen = network.observations
    known = np.flatnonzero(seen.point >= 0)
    key = seen.image[known].astype(np.int64) * (len(network.points) + 1) + seen.point[known]
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    if (count > 1).any():
        row = int(known[first[count > 1][0]])
        raise CalibrationError(
            f"{_place(network, row)}: observed {int(count[count > 1][0])} times in one picture; a "
            "picture shows a point once: take the wrong ones out, or give them other names"
        )


def _check_pixels(network: NetworkInput) -> None:
    seen = network.observations
    size = np.array([network.cameras[i.camera].image_size_px for i in network.images], float)
    size = size[seen.image]
    for index, camera in enumerate(network.cameras):
        of = np.array([i.camera for i in network.images])[seen.image] == index
        if of.sum() >= MIN_POINTS_OF_IMAGE and (
            np.abs(seen.xy_px[of]).max() < MILLIMETRES_PART * min(camera.image_size_px)
        ):
            raise CalibrationError(
                f"camera {camera.name}: all image points lie within "
                f"{np.abs(seen.xy_px[of]).max():.3g} of the corner of a picture of "
                f"{camera.image_size_px[0]} x {camera.image_size_px[1]} pixels: these are "
                "millimetres, not pixels; divide by the pixel's size, counted from the centre of "
                "the top-left pixel, y down"
            )
    out = ((seen.xy_px < -EDGE_PX) | (seen.xy_px > size - 1 + EDGE_PX)).any(axis=1)
    if out.any():
        row = int(np.flatnonzero(out)[0])
        x, y = seen.xy_px[row]
        w, h = size[row].astype(int)
        raise CalibrationError(
            f"{_place(network, row)}: ({x:.6g}, {y:.6g}) px lies outside the picture of {w} x {h} "
            f"pixels ({int(out.sum())} of {len(seen)} do): is image_size_px right, are the "
            "coordinates in pixels from the top-left pixel's centre, x right and y down?"
        )


def _with_datum(network: NetworkInput) -> tuple[NetworkInput, list[str]]:
    """Under inner constraints every point is unknown; what was said of them is a start only."""
    known = network.points.kind != "free"
    if network.datum != "free" or not known.any():
        return network, []
    points = replace(
        network.points,
        kind=np.full(len(network.points), "free"),
        cov_mm2=None,
        full_cov_mm2=None,
    )
    warning = (
        f'datum = "free": the {int(known.sum())} fixed or weighted points are unknowns as all '
        "others; their coordinates give the frame, their sigmas are not used"
    )
    return replace(network, points=points), [warning]


def _enough_rays(
    network: NetworkInput, used: BoolArray, rejected: list[NetworkRejection]
) -> BoolArray:
    """Without points in one picture alone and pictures of too few points, repeatedly."""
    seen = network.observations
    used = used.copy()
    unknown = network.points.kind == "free"
    while True:
        rays = np.bincount(seen.point[used], minlength=len(network.points))
        lonely = np.flatnonzero(unknown & (rays == 1))
        for point in lonely:
            image = int(seen.image[used & (seen.point == point)][0])
            rejected.append(
                NetworkRejection(
                    kind="point",
                    value=1.0,
                    test="rays",
                    image=network.images[image].name,
                    point=network.points.name[point],
                    reason="in one picture alone, and of unknown position",
                )
            )
        out = used & np.isin(seen.point, lonely)
        used &= ~out
        count = np.bincount(seen.image[used], minlength=len(network.images))
        few = np.flatnonzero((count > 0) & (count < MIN_POINTS_OF_IMAGE))
        few_used = used & np.isin(seen.image, few)
        for row in few:
            rejected.append(_rejected_image(network, int(row), int(count[row])))
        used &= ~few_used
        if not out.any() and not few_used.any():
            return used


def _rejected_image(network: NetworkInput, image: int, count: int) -> NetworkRejection:
    return NetworkRejection(
        kind="image",
        value=float(count),
        test="points",
        image=network.images[image].name,
        point="",
        reason=f"only {count} of its points are known or in other pictures, and a pose needs "
        f"{MIN_POINTS_OF_IMAGE}",
    )


def _groups(network: NetworkInput, used: BoolArray) -> IntArray:
    """(I,) group of each picture: joined by common points or by points of known position."""
    seen = network.observations
    num = len(network.images)
    # One more node stands for the frame that known points define.
    parent = np.arange(num + 1 + len(network.points))
    frame = num

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = int(parent[i])
        return i

    for point in np.flatnonzero(network.points.kind != "free"):
        parent[root(num + 1 + int(point))] = root(frame)
    for image, point in zip(seen.image[used], seen.point[used], strict=True):
        parent[root(int(image))] = root(num + 1 + int(point))
    return np.array([root(i) for i in range(num)], np.int32)


def _connected(
    network: NetworkInput,
    used: BoolArray,
    rejected: list[NetworkRejection],
    warnings: list[str],
) -> BoolArray:
    """Without the pictures that share no point with the largest group."""
    if not used.any():
        return used
    seen = network.observations
    group = _groups(network, used)
    present = np.unique(seen.image[used])
    names, counts = np.unique(group[present], return_counts=True)
    if len(names) == 1:
        return used
    largest = names[counts.argmax()]
    out = present[group[present] != largest]
    listed = ", ".join(network.images[i].name for i in out[:8]) + (", ..." if len(out) > 8 else "")
    warnings.append(
        f"the pictures fall into {len(names)} groups without a common point; the largest, of "
        f"{counts.max()} pictures, is adjusted, and {listed} left out: take pictures that show "
        "points of both, or give points known in one frame"
    )
    for image in out:
        rejected.append(
            NetworkRejection(
                kind="image",
                value=0.0,
                test="connection",
                image=network.images[image].name,
                point="",
                reason="shares no point with the largest group of pictures",
            )
        )
    return np.asarray(used & (group[seen.image] == largest))


def _nothing_left(network: NetworkInput, rejected: list[NetworkRejection]) -> str:
    pictures = [r for r in rejected if r.kind == "image"]
    why = f"; {pictures[0].image}: {pictures[0].reason}" if pictures else ""
    if len(network.images) == 1:
        return (
            "one picture alone cannot tell where points are: take pictures from several places, "
            f"or give at least {MIN_POINTS_OF_IMAGE} points of known position (fixed, or with "
            f"sigmas){why}"
        )
    return (
        f"too few common points: no picture has {MIN_POINTS_OF_IMAGE} points that are known or "
        f"that another picture shows as well{why}; are the points named alike in all pictures?"
    )


def _lonely_picture(network: NetworkInput, used: BoolArray) -> None:
    """One picture of fixed points is a resection; of unknown ones it is nothing."""
    seen = network.observations
    known = network.points.kind[seen.point[used]] != "free"
    if len(np.unique(seen.image[used])) == 1 and known.sum() < MIN_POINTS_OF_IMAGE:
        raise CalibrationError(_nothing_left(network, []))


def _known_points(network: NetworkInput) -> None:
    """The frame's seven degrees of freedom must come from the points that should give it."""
    if network.datum == "free":
        return
    known = network.points.kind != "free"
    seen = np.isin(np.arange(len(network.points)), network.observations.point)
    where = "fixed or given with sigmas"
    if network.datum == "fixed" and known.any() and not (network.points.kind == "fixed").any():
        raise CalibrationError(
            'datum = "fixed", but no point that pictures show is fixed: name at least three with '
            'fixed = [...], or write datum = "weighted"'
        )
    positions = network.points.position_mm[known & seen]
    if len(positions) < 3:
        raise CalibrationError(
            f'datum = "{network.datum}": {len(positions)} points that pictures show are {where}, '
            'and a frame needs three that are not on a line: name more, or write datum = "free"'
        )
    centred = positions - positions.mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False)
    if spread[1] < 1e-6 * max(spread[0], 1e-300):
        raise CalibrationError(
            f'datum = "{network.datum}": all {len(positions)} points that are {where} lie on one '
            "line, so that the rotation about it is free: add one beside it, or write datum = "
            '"free"'
        )


def _subset(
    network: NetworkInput,
    used: BoolArray,
    rejected: list[NetworkRejection],
    warnings: list[str],
) -> NetworkInput:
    """The network of the used observations, without the pictures and points that have none."""
    seen = network.observations
    images = np.unique(seen.image[used])
    points = np.unique(seen.point[used])
    image_of = np.full(len(network.images), -1, np.int32)
    image_of[images] = np.arange(len(images))
    point_of = np.full(len(network.points), -1, np.int32)
    point_of[points] = np.arange(len(points))
    unseen = np.setdiff1d(np.arange(len(network.points)), seen.point[seen.point >= 0])
    if len(unseen):
        listed = ", ".join(network.points.name[i] for i in unseen[:8])
        more = ", ..." if len(unseen) > 8 else ""
        warnings.append(
            f"{len(unseen)} points of the table are in no picture and take no part: {listed}{more}"
        )
    return replace(
        network,
        images=tuple(network.images[i] for i in images),
        points=_points_subset(network.points, points),
        observations=NetworkObservations(
            image=image_of[seen.image[used]],
            point=point_of[seen.point[used]],
            xy_px=np.asarray(seen.xy_px[used], float),
            cov_px2=np.asarray(seen.cov_px2[used], float),
        ),
        scale_bars=_bars_subset(network, point_of, rejected),
    )


def _points_subset(points: NetworkPoints, rows: IntArray) -> NetworkPoints:
    full = points.full_cov_mm2
    if full is not None:
        weighted = np.flatnonzero(points.kind == "weighted")
        kept = np.flatnonzero(np.isin(weighted, rows))
        places = (3 * kept[:, None] + np.arange(3)).ravel()
        full = full[np.ix_(places, places)]
    return NetworkPoints(
        name=tuple(points.name[i] for i in rows),
        position_mm=np.asarray(points.position_mm[rows], float),
        kind=points.kind[rows],
        cov_mm2=None if points.cov_mm2 is None else points.cov_mm2[rows],
        full_cov_mm2=full,
        normal=None if points.normal is None else points.normal[rows],
        diameter_mm=None if points.diameter_mm is None else points.diameter_mm[rows],
    )


def _bars_subset(
    network: NetworkInput, point_of: IntArray, rejected: list[NetworkRejection]
) -> ScaleBars:
    bars = network.scale_bars
    a, b = point_of[bars.point_a], point_of[bars.point_b]
    whole = (a >= 0) & (b >= 0)
    for i in np.flatnonzero(~whole):
        missing = bars.point_a[i] if a[i] < 0 else bars.point_b[i]
        rejected.append(
            NetworkRejection(
                kind="scale-bar",
                value=float(bars.length_mm[i]),
                test="ends",
                image="",
                point=bar_name(network, int(i)),
                reason=f"its end {network.points.name[missing]} is not in two pictures that take "
                "part",
            )
        )
    certificates = bars.certificate or ("",) * len(bars)
    return ScaleBars(
        point_a=a[whole],
        point_b=b[whole],
        length_mm=np.asarray(bars.length_mm, float)[whole],
        sigma_mm=np.asarray(bars.sigma_mm, float)[whole],
        certificate=tuple(c for c, is_whole in zip(certificates, whole, strict=True) if is_whole),
    )


def bar_name(network: NetworkInput, bar: int) -> str:
    """A scale bar by its ends."""
    bars = network.scale_bars
    return f"{network.points.name[bars.point_a[bar]]}-{network.points.name[bars.point_b[bar]]}"
