"""Start values of a photogrammetric network, from its image points alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.adjustment import principal_extents
from videogrammetry.calibration.network_block import Block
from videogrammetry.calibration.network_frame import (
    frame_on_known,
    robust_similarity,
    scale_from_bars,
)
from videogrammetry.calibration.network_growth import MIN_KNOWN_POINTS, MIN_POINTS, complete
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_links import MissingLink, describe_groups, missing_links
from videogrammetry.calibration.network_rays import BoolArray
from videogrammetry.calibration.network_seed import Seed, common_points, find_seed
from videogrammetry.calibration.network_start_focal import (
    focal_doubts,
    focal_factors,
    start_cameras,
)
from videogrammetry.calibration.network_start_known import from_known
from videogrammetry.errors import CalibrationError
from videogrammetry.types import INTERIOR_NAMES, FloatArray

#: Fewer points than this tie a picture weakly.
_FEW_POINTS = 8


@dataclass(frozen=True, kw_only=True)
class StartReport:
    """What the start found and what it is not sure of.

    Attributes
    ----------
    placed : names of the pictures with a pose; left_out : (name, reason) of the others.
    groups : names of the pictures of each connected group, the largest first; one
        where everything is tied together.
    links : what ties the groups together too weakly.
    scale : "known points", "scale bars" or "unit baseline".
    f_px : principal distance per camera. rms_px : RMS distance of what agrees.
    agrees : (M,) observations of the input within the gate of the start; False also
        where nothing is said (un-coded, not placed).
    doubts : sentences for the user.
    """

    placed: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...]
    groups: tuple[tuple[str, ...], ...]
    links: tuple[MissingLink, ...]
    scale: str
    f_px: dict[str, float]
    rms_px: float
    agrees: BoolArray
    doubts: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StartedNetwork:
    """The network with start values for interiors, poses and points, and the report."""

    network: NetworkInput
    report: StartReport


def start_network(network: NetworkInput, *, partial: bool = False) -> StartedNetwork:
    """Poses, points and principal distances of a network without help from the user.

    With known points (fixed or weighted, four in a picture, not in a line) pictures
    are resected; else the best pair is oriented relatively by its common points and
    intersected. Then the block grows: the picture with the most placed points is
    resected, new points are intersected, everything is adjusted robustly, until all
    pictures stand. Blocks that grew apart are joined by common points.

    An unknown f (NaN), or a free one that does not fit, is searched: trial blocks
    of six pictures are grown with several f, adjusted, and the best one is kept.

    Parameters
    ----------
    network : with what is known; poses that are given are taken over
        if they fit.
    partial : where pictures fall into groups that nothing ties together, go on with
        the largest (the others without pose) instead of raising.

    Returns
    -------
    StartedNetwork
        Poses are cam_from_object; the object's frame is that of the known points,
        else the first placed picture's, with the scale bars' scale, else with the
        first pair's baseline as 1 mm. What could not be placed is None or NaN.

    Raises
    ------
    CalibrationError
        Nothing can be oriented, the pictures fall into groups (the message says
        which link is missing), or the known points are left-handed.
    ValueError
        A camera without f that may not be estimated.

    References
    ----------
    Luhmann, Robson, Kyle, Boehm, Close-Range Photogrammetry and 3D Imaging, Sec. 4.4
    (network orientation from relative orientations and resections).
    """
    blocks, doubts, seed = _blocks(network)
    if not blocks:
        raise CalibrationError(_nothing(network))
    count = common_points(blocks[0])
    main = blocks[0]
    groups = [[int(i) for i in np.flatnonzero(block.placed)] for block in blocks]
    links = missing_links(network, groups, count) if len(groups) > 1 else ()
    if len(groups) > 1:
        message = describe_groups(network, groups, links)
        if not partial:
            raise CalibrationError(message)
        doubts.append(message)
    left_out = _left_out(network, main, groups)
    if len(left_out) > len(network.images) // 2 and not partial:
        raise CalibrationError(
            f"only {int(main.placed.sum())} of {len(network.images)} pictures could be placed; of "
            f"the others, {left_out[0][0]}: {left_out[0][1]}"
        )
    scale = _set_frame(main, network, seed, doubts)
    doubts += _weak_pictures(network, main)
    return _result(network, main, groups, links, left_out, scale, doubts)


# --- blocks -------------------------------------------------------------------


def _blocks(network: NetworkInput) -> tuple[list[Block], list[str], Seed | None]:
    """Blocks that nothing ties together, the largest first."""
    doubts: list[str] = []
    start = Block(network, start_cameras(network))
    seed: Seed | None = None
    main = from_known(network, start, doubts)
    if main is None:
        for candidate in find_seed(_free_block(start), focal_factors(network)):
            seed, main = candidate, candidate.block
            complete(main)
            break
        if main is None or seed is None:
            return [], doubts, None
    doubts += focal_doubts(network, main, searched=seed is not None)
    blocks = [main]
    tried = main.placed.copy()
    while True:
        more = _next_block(main, tried)
        if more is None:
            break
        tried |= more.placed
        if not _join(main, more):
            blocks.append(more)
    blocks.sort(key=lambda block: -int(block.placed.sum()))
    return blocks, doubts, seed


def _next_block(main: Block, tried: BoolArray) -> Block | None:
    """A block of pictures that the main one could not take, with its interiors."""
    if (~tried).sum() < 2:
        return None
    block = _free_block(main)
    block.rotation[:], block.translation[:] = np.nan, np.nan
    block.twin = {}
    block.allowed = ~tried
    seeds = find_seed(block, [np.ones(len(block.cameras))])
    if not seeds:
        return None
    other = seeds[0].block
    complete(other)
    return other if other.placed.sum() >= 2 else None


def _free_block(block: Block) -> Block:
    """The block without known points: they enter by a Helmert transformation later."""
    free = block.copy()
    free.known = np.zeros(len(block.known), bool)
    free.position = np.full_like(block.position, np.nan)
    return free


def _join(main: Block, other: Block) -> bool:
    """Take another block's pictures over by common points; False if those are too few."""
    both = main.has_point & other.has_point
    if both.sum() < 4 or principal_extents(main.position[both])[1] < 0.02:
        return False
    fit = robust_similarity(main.position[both], other.position[both])
    if fit.inlier.sum() < max(4, 0.6 * both.sum()):
        return False
    trial = main.copy()
    rotation, translation = fit.poses(other.rotation, other.translation)
    for image in np.flatnonzero(other.placed):
        trial.place(int(image), rotation[image], translation[image])
    new = other.has_point & ~main.has_point
    trial.position[new] = fit.points(other.position[new])
    noise = max(main.noise_px(), other.noise_px())
    trial.gate_px = main.start_gate_px
    trial.bundle()
    # (a wrong similarity bends the block: four points fit one with a wrong number too)
    if trial.noise_px() > 3.0 * max(noise, 0.1):
        return False
    trial.settle_gate()
    main.__dict__.update(trial.__dict__)
    complete(main)
    return True


# --- frame and result ---------------------------------------------------------


def _set_frame(block: Block, network: NetworkInput, seed: Seed | None, doubts: list[str]) -> str:
    """Put the block into the object's frame and scale; says by what."""
    if seed is None:
        return "known points"
    fit = frame_on_known(block.position, network)
    if fit is not None:
        block.rotation, block.translation = fit.poses(block.rotation, block.translation)
        block.position = fit.points(block.position)
        if not fit.inlier.all():
            known = (network.points.kind != "free") & block.has_point
            wrong = [network.points.name[i] for i in np.flatnonzero(known)[~fit.inlier]]
            doubts.append(
                f"{len(wrong)} of {len(fit.inlier)} known points do not fit the block, their "
                f"numbers or coordinates are wrong: {', '.join(wrong[:8])}"
            )
        return "known points"
    first, second = seed.pair if block.placed[list(seed.pair)].all() else (
        np.flatnonzero(block.placed)[:2]
    )  # fmt: skip
    rotation, shift = block.rotation[first].copy(), block.translation[first].copy()
    centre = -np.einsum("nji,nj->ni", block.rotation, block.translation)
    baseline = float(np.linalg.norm(centre[second] - centre[first]))
    scale = scale_from_bars(block.position, network)
    how = "unit baseline" if scale is None else "scale bars"
    factor = 1.0 / baseline if scale is None else scale
    # x_new = factor * (R1 x + t1): the first picture's camera is the frame.
    block.position = factor * (block.position @ rotation.T + shift)
    block.rotation = block.rotation @ rotation.T
    block.translation = factor * (block.translation - block.rotation @ shift)
    if scale is None:
        doubts.append(
            f"the scale is unknown: the distance of {network.images[first].name} and "
            f"{network.images[second].name} is 1 mm; give a scale bar or known points"
        )
    return how


def _left_out(
    network: NetworkInput, main: Block, groups: Sequence[Sequence[int]]
) -> tuple[tuple[str, str], ...]:
    """Pictures in no group, with the reason."""
    reasons = []
    least = MIN_KNOWN_POINTS if main.known.any() else MIN_POINTS
    for image in np.setdiff1d(np.arange(len(network.images)), np.concatenate(groups)):
        seen, placed = len(main.rows_of[image]), main.count_placed(int(image))
        if seen < least:
            reason = f"only {seen} points with a number; a pose needs {least}"
        elif placed < least:
            reason = (
                f"sees {placed} of the placed points; a pose needs {least}: take "
                "pictures between it and its neighbours"
            )
        else:
            reason = (
                f"no pose fits its {placed} placed points: wrong numbers, another camera, or "
                "points in a line"
            )
        reasons.append((network.images[image].name, reason))
    return tuple(reasons)


def _weak_pictures(network: NetworkInput, block: Block) -> list[str]:
    doubts = []
    distance = block.distance_px()
    for image in np.flatnonzero(block.placed):
        good = int((distance[block.rows_of[image]] < block.gate_px).sum())
        name = network.images[image].name
        if good < _FEW_POINTS:
            doubts.append(f"picture {name} hangs on {good} points only")
        if int(image) in block.twin:
            again = block.resect(int(image))
            if len(again) > 1 and again[1].cost_px2 < 2.0 * again[0].cost_px2:
                doubts.append(
                    f"picture {name}: the mirrored pose of its flat part fits as well; its "
                    "points do not decide"
                )
    return doubts


def _nothing(network: NetworkInput) -> str:
    block = Block(network, start_cameras(network))
    count = common_points(block)
    if count.max(initial=0) == 0:
        return (
            f"no two of the {len(network.images)} pictures show a common point with a number; "
            "check that codes are read and that names agree between pictures"
        )
    i, j = np.unravel_index(int(count.argmax()), count.shape)
    return (
        f"no two pictures can be oriented relative to each other: the most common points, "
        f"{int(count[i, j])}, are in {network.images[i].name} and {network.images[j].name}; 8 are "
        "needed that are right, seen from places apart (rays that meet at 20 to 60 degrees); where "
        "there are enough, the numbers, the picture's size or a start value of f are wrong"
    )


def _result(
    network: NetworkInput,
    block: Block,
    groups: Sequence[Sequence[int]],
    links: tuple[MissingLink, ...],
    left_out: tuple[tuple[str, str], ...],
    scale: str,
    doubts: Sequence[str],
) -> StartedNetwork:
    distance = block.distance_px()
    good = distance < block.gate_px
    agrees = np.zeros(len(network.observations), bool)
    agrees[block.row] = good
    known = (network.points.kind != "free") & np.isfinite(network.points.position_mm).all(axis=1)
    position = np.where(known[:, None], network.points.position_mm, block.position)
    images = tuple(
        replace(image, rotation=block.rotation[k], translation_mm=block.translation[k])
        if block.placed[k]
        else replace(image, rotation=None, translation_mm=None)
        for k, image in enumerate(network.images)
    )
    cameras = tuple(
        replace(camera, interior=_interior(network, block, c))
        for c, camera in enumerate(network.cameras)
    )
    report = StartReport(
        placed=tuple(network.images[k].name for k in np.flatnonzero(block.placed)),
        left_out=left_out,
        groups=tuple(tuple(network.images[k].name for k in group) for group in groups),
        links=links,
        scale=scale,
        f_px={
            camera.name: float(block.cameras[c].interior[0])
            for c, camera in enumerate(network.cameras)
        },
        rms_px=float(np.sqrt(np.mean(distance[good] ** 2))) if good.any() else np.nan,
        agrees=agrees,
        doubts=tuple(doubts),
    )
    started = replace(
        network,
        cameras=cameras,
        images=images,
        points=replace(network.points, position_mm=position),
    )
    return StartedNetwork(network=started, report=report)


def _interior(network: NetworkInput, block: Block, camera: int) -> FloatArray:
    """The found interior; a value that is observed with a sigma stays the observed one."""
    given = np.asarray(network.cameras[camera].interior, float)
    observed = np.array([name in network.cameras[camera].sigma for name in INTERIOR_NAMES])
    return np.where(observed & np.isfinite(given), given, block.cameras[camera].interior)
