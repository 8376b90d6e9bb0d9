"""Un-coded targets of a network: matched over all pictures by epipolar lines and third rays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.calibration.network_block import placed_block
from videogrammetry.calibration.network_input import NetworkInput, NetworkPoints
from videogrammetry.calibration.network_rays import BoolArray
from videogrammetry.calibration.network_uncoded_match import MIN_RAYS, Matcher, new_names
from videogrammetry.errors import CalibrationError
from videogrammetry.types import FloatArray


@dataclass(frozen=True, kw_only=True)
class UncodedReport:
    """What became of the un-coded image points.

    ``new_points``; ``assigned`` image points that belong to them;
    ``ambiguous`` ones that fitted several points; ``single`` ones without partners;
    ``rounds`` of matching and adjustment.
    """

    new_points: int
    assigned: int
    ambiguous: int
    single: int
    rounds: int


@dataclass(frozen=True, kw_only=True)
class LinkedNetwork:
    """The network with new points and their observations, and the report."""

    network: NetworkInput
    report: UncodedReport


def link_uncoded(network: NetworkInput, *, max_rounds: int = 3) -> LinkedNetwork:
    """Give un-coded image points (``point`` -1) numbers by matching them over all pictures.

    Two image points may belong together if each lies on the other's epipolar line
    (distance in units of its standard deviation, from the adjusted poses' and
    interiors' covariance). Their intersection is predicted in the other pictures
    that face it; it is a point if it is found there more often than chance would
    have it (expected number of chance points below 1e-3), by at least three rays.
    What fits several points is left out. Then the block is adjusted with the new
    points and the rest is matched again.

    Parameters
    ----------
    network : with poses, interiors and coded points as :func:`start_network` or an
        adjustment left them.
    max_rounds : of matching and adjustment.

    Returns
    -------
    LinkedNetwork
        New points are named with numbers above the largest one, free, with
        positions; interiors and poses as the last adjustment left them.

    Raises
    ------
    CalibrationError : fewer than two pictures with a pose.
    """
    if sum(image.rotation is not None for image in network.images) < 2:
        raise CalibrationError(
            "un-coded points need at least two pictures with a pose: start or adjust the coded "
            "network first"
        )
    first_new, rounds, ambiguous = len(network.points), 0, 0
    while rounds < max_rounds:
        rounds += 1
        matcher = Matcher(network)
        matcher.extend_known()
        matcher.match_pairs()
        matcher.merge_split(first_new)
        ambiguous = matcher.ambiguous
        if not matcher.changed:
            break
        network = _adjusted(matcher.result())
    network = _without_weak(network, first_new)
    open_count = int((network.observations.point < 0).sum())
    return LinkedNetwork(
        network=network,
        report=UncodedReport(
            new_points=len(network.points) - first_new,
            assigned=int((network.observations.point >= first_new).sum()),
            ambiguous=min(ambiguous, open_count),
            single=max(0, open_count - ambiguous),
            rounds=rounds,
        ),
    )


# --- between rounds -----------------------------------------------------------


def _adjusted(network: NetworkInput) -> NetworkInput:
    """The network after a robust bundle over coded and new points."""
    block = placed_block(network)
    block.bundle()
    images = tuple(
        replace(image, rotation=block.rotation[k], translation_mm=block.translation[k])
        if block.placed[k]
        else image
        for k, image in enumerate(network.images)
    )
    cameras = tuple(
        replace(camera, interior=block.cameras[c].interior)
        for c, camera in enumerate(network.cameras)
    )
    points = replace(network.points, position_mm=block.position)
    return replace(network, images=images, cameras=cameras, points=points)


def _without_weak(network: NetworkInput, first_new: int) -> NetworkInput:
    """Without image points that miss their new point, and new points of fewer than three rays."""
    block = placed_block(network)
    distance = block.distance_px()
    block.settle_gate()
    point = network.observations.point.copy()
    bad = (block.point >= first_new) & ~(distance < block.gate_px)
    point[block.row[bad]] = -1
    rays = np.bincount(point[point >= 0], minlength=len(network.points))
    keep = (np.arange(len(rays)) < first_new) | (rays >= MIN_RAYS)
    place = np.where(keep, np.cumsum(keep) - 1, -1)
    point[point >= 0] = place[point[point >= 0]]
    names = new_names(network.points.name[:first_new], int(keep[first_new:].sum()))
    points = _selected(network.points, keep)
    return replace(
        network,
        points=replace(points, name=(*network.points.name[:first_new], *names)),
        observations=replace(network.observations, point=point.astype(np.int32)),
    )


def _selected(points: NetworkPoints, keep: BoolArray) -> NetworkPoints:
    def pick(array: FloatArray | None) -> FloatArray | None:
        return None if array is None else array[keep]

    return replace(
        points,
        name=tuple(name for name, kept in zip(points.name, keep, strict=True) if kept),
        position_mm=points.position_mm[keep],
        kind=points.kind[keep],
        cov_mm2=pick(points.cov_mm2),
        normal=pick(points.normal),
        diameter_mm=pick(points.diameter_mm),
    )
