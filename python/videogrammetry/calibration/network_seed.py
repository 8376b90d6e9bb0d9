"""First pictures of a network without known points: a pair, its motion, the principal distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from videogrammetry.adjustment import relative_orientation
from videogrammetry.adjustment.start import RelativeCandidate
from videogrammetry.calibration.network_block import Block, with_interior
from videogrammetry.calibration.network_growth import MIN_POINTS, grow
from videogrammetry.calibration.network_rays import RowArray
from videogrammetry.geometry import camera_model
from videogrammetry.types import FloatArray, IntArray, RigCamera

#: f over the larger side that are tried where nothing is known: 90 to 14 degrees of view.
F_GRID = tuple(np.geomspace(0.5, 4.0, 10))
#: Factors of a start value of f that are tried where it is free.
F_FACTORS = (1.0, 0.75, 1.35)
#: Pairs that are oriented, and pairs from which a block is grown on trial.
_MAX_PAIRS, _TRIAL_PAIRS = 24, 3
#: Pictures of a trial block: three leave f and a plane's twin open too often.
_TRIAL_IMAGES = 6
#: Gate of the epipolar lines while distortion is unknown, as a share of the start gate.
_EPIPOLAR_SHARE = 0.4
#: Points further off count as wrong in a trial; a trial near that has failed.
_TRIAL_GATE, _WORST_SHARE = 0.2, 0.18
#: A trial with this share of image points within that share of the start gate needs
#: no other f: gross errors, which no f mends, are fewer.
_GOOD_SHARE, _GOOD_GATE = 0.85, 0.03
#: Angle between the rays of a pair that is best for both points and next pictures.
_BEST_ANGLE_RAD = np.radians(30.0)


@dataclass(frozen=True, kw_only=True)
class Seed:
    """A trial block and how well it fits.

    ``rms_px``: robust, with what was not placed at the gate; ``share`` of image points
    that fit well; ``factor``: (C,) on the
    cameras' f with which the trial began.
    """

    block: Block
    pair: tuple[int, int]
    rms_px: float
    share: float
    factor: FloatArray


def common_points(block: Block) -> IntArray:
    """(I, I) number of points that two pictures both see."""
    seen = csr_matrix(
        (np.ones(len(block.image), np.int32), (block.image, block.point)),
        shape=(len(block.rotation), len(block.position)),
    )
    seen.data[:] = np.minimum(seen.data, 1)
    product: csr_matrix = csr_matrix(seen @ seen.T)
    count = np.asarray(product.todense(), np.int32)
    np.fill_diagonal(count, 0)
    return count


def find_seed(block: Block, factors: Sequence[FloatArray]) -> list[Seed]:
    """Trial blocks, the best first; empty if no pair of open pictures can be oriented.

    The pairs with the most common points are oriented with every f; from the best
    (many agreeing points, rays that meet at about 30 degrees, a baseline) a block of
    six pictures is grown and adjusted with f free; the least residual wins.
    """
    pairs = _candidate_pairs(block)
    if not pairs:
        return []
    seeds: list[Seed] = []
    subsets: dict[tuple[int, int], RowArray] = {}
    for factor in factors:
        cameras = [with_f(c, float(x)) for c, x in zip(block.cameras, factor, strict=True)]
        for pair, candidates in _best_pairs(block, cameras, pairs):
            subset = subsets.setdefault(pair, _neighbours(block, pair))
            for candidate in candidates:
                seeds.append(_trial(block, cameras, pair, candidate, subset, factor))
            if any(seed.share > _GOOD_SHARE for seed in seeds):
                return _sorted(block, seeds)
    return _sorted(block, seeds)


def _sorted(block: Block, seeds: Sequence[Seed]) -> list[Seed]:
    fitting = [seed for seed in seeds if seed.rms_px < _WORST_SHARE * block.start_gate_px]
    return sorted(fitting, key=lambda seed: seed.rms_px)


def with_f(camera: RigCamera, factor: float) -> RigCamera:
    """The camera with its f times a factor."""
    interior = camera.interior.copy()
    interior[0] *= factor
    return with_interior(camera, interior)


def _candidate_pairs(block: Block) -> list[tuple[int, int]]:
    """Pairs with many common points, no picture in more than a few."""
    count = common_points(block)
    count[~block.allowed] = 0
    count[:, ~block.allowed] = 0
    first, second = np.triu_indices(len(count), 1)
    uses = np.zeros(len(count), int)
    pairs: list[tuple[int, int]] = []
    for k in np.argsort(-count[first, second], kind="stable"):
        i, j = int(first[k]), int(second[k])
        if count[i, j] < MIN_POINTS + 2 or len(pairs) == _MAX_PAIRS:
            break
        if max(uses[i], uses[j]) < 4:
            pairs.append((i, j))
            uses[[i, j]] += 1
    return pairs


def _common_rows(block: Block, i: int, j: int) -> tuple[RowArray, RowArray]:
    rows_i, rows_j = block.rows_of[i], block.rows_of[j]
    _, a, b = np.intersect1d(block.point[rows_i], block.point[rows_j], return_indices=True)
    return rows_i[a], rows_j[b]


def _best_pairs(
    block: Block, cameras: Sequence[RigCamera], pairs: Sequence[tuple[int, int]]
) -> list[tuple[tuple[int, int], tuple[RelativeCandidate, ...]]]:
    scored = []
    models = [camera_model(camera) for camera in cameras]
    for i, j in pairs:
        a, b = _common_rows(block, i, j)
        found = relative_orientation(
            models[block.camera_of[i]],
            block.xy_px[a],
            models[block.camera_of[j]],
            block.xy_px[b],
            threshold_px=_EPIPOLAR_SHARE * block.start_gate_px,
            max_samples=200,
        )
        if not found.candidates:
            continue
        best = found.candidates[0]
        inliers = int(best.inlier.sum())
        if inliers < max(MIN_POINTS + 2, 0.6 * len(a)):
            continue
        off = np.log(max(best.convergence_rad, 1e-4) / _BEST_ANGLE_RAD)
        scored.append((inliers / (1.0 + off**2), (i, j), found.candidates))
    scored.sort(key=lambda entry: -entry[0])
    return [(pair, candidates) for _, pair, candidates in scored[:_TRIAL_PAIRS]]


def _neighbours(block: Block, pair: tuple[int, int]) -> RowArray:
    """The pair and the pictures that see most of its common points: the same for every f."""
    a, _ = _common_rows(block, *pair)
    wanted = np.zeros(len(block.position), bool)
    wanted[block.point[a]] = True
    count = (
        np.bincount(block.image[wanted[block.point]], minlength=len(block.rotation)) * block.allowed
    )
    count[list(pair)] = np.iinfo(np.int32).max
    order = np.argsort(-count, kind="stable")[:_TRIAL_IMAGES]
    return order[count[order] >= MIN_POINTS]


def _trial(
    block: Block,
    cameras: Sequence[RigCamera],
    pair: tuple[int, int],
    candidate: RelativeCandidate,
    subset: RowArray,
    factor: FloatArray,
) -> Seed:
    trial = block.copy()
    trial.set_cameras(cameras)
    trial.allowed = np.zeros(len(block.allowed), bool)
    trial.allowed[subset] = True
    start_pair(trial, pair, candidate.rotation, candidate.translation)
    grow(trial, limit=len(subset))
    trial.bundle()
    rms_px, share = _fit(trial, subset)
    trial.allowed = block.allowed.copy()
    return Seed(block=trial, pair=pair, rms_px=rms_px, share=share, factor=factor)


def start_pair(
    block: Block, pair: tuple[int, int], rotation: FloatArray, translation: FloatArray
) -> None:
    """Place the pair, the first picture's frame as the object's, and their points."""
    block.gate_px = block.start_gate_px
    block.place(pair[0], np.eye(3), np.zeros(3))
    block.place(pair[1], rotation, translation)
    block.triangulate()
    block.bundle(interior=False)


def _fit(block: Block, subset: RowArray) -> tuple[float, float]:
    """Robust RMS over what two of the pictures see, and the share that fits well.

    What is not placed counts as wrong.
    """
    rows = np.concatenate([block.rows_of[image] for image in subset])
    twice = np.bincount(block.point[rows], minlength=len(block.position)) >= 2
    rows = rows[twice[block.point[rows]]]
    gate = _TRIAL_GATE * block.start_gate_px
    distance = np.nan_to_num(block.distance_px(rows), nan=gate)
    rms_px = float(np.sqrt(np.mean(np.minimum(distance, gate) ** 2))) if len(rows) else np.inf
    return rms_px, float(np.mean(distance < _GOOD_GATE * block.start_gate_px))
