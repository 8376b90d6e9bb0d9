"""Growth of a block of pictures: resection of the next, intersection of what they see."""

from __future__ import annotations

import numpy as np

from videogrammetry.adjustment.start import PoseCandidate
from videogrammetry.calibration.network_block import Block

#: Placed points that a picture must see; four known ones have a redundancy of 2.
MIN_POINTS, MIN_KNOWN_POINTS = 5, 4
#: Pictures with this share of the most placed points are placed together.
_BATCH_SHARE = 0.7
#: A second pose of no more than this times the first one's cost is a twin.
_TWIN_COST = 4.0


def grow(block: Block, *, limit: int | None = None) -> None:
    """Place pictures, those with the most placed points first, until none can be.

    A picture whose two poses (of a flat part) fit alike waits until others, which
    are decided, have placed more points; where only such are left the better pose
    is taken and its twin kept for :func:`settle`.
    """
    failed: dict[int, int] = {}
    while limit is None or block.placed.sum() < limit:
        room = len(block.placed) if limit is None else limit - int(block.placed.sum())
        batch = _next_pictures(block, failed)[:room]
        if not batch:
            break
        if not _place(block, batch, failed, twins=False):
            _place(block, batch[:1], failed, twins=True)
        for image in batch:
            if not block.placed[image]:
                failed[image] = block.count_placed(image)
        if block.placed[batch].any():
            block.triangulate()
            block.bundle()
            block.settle_gate()
            block.triangulate(again=True)


def _next_pictures(block: Block, failed: dict[int, int]) -> list[int]:
    """The open pictures with the most placed points; failed ones only with more than then."""
    least = MIN_KNOWN_POINTS if block.known.any() else MIN_POINTS
    count = {
        int(image): block.count_placed(int(image))
        for image in np.flatnonzero(~block.placed & block.allowed)
    }
    ready = {i: n for i, n in count.items() if n >= least and n > failed.get(i, 0)}
    most = max(ready.values(), default=0)
    batch = [i for i, n in ready.items() if n >= _BATCH_SHARE * most]
    # No more than are placed: a batch leans on what stood before it.
    batch.sort(key=lambda i: -ready[i])
    return batch[: max(2, int(block.placed.sum()))]


def _place(block: Block, batch: list[int], failed: dict[int, int], *, twins: bool) -> bool:
    any_placed = False
    for image in batch:
        found = fitting(block, image)
        if not found or (len(found) > 1 and not twins):
            continue
        block.place(image, found[0].rotation, found[0].translation_mm)
        if len(found) > 1:
            block.twin[image] = found[1]
        failed.pop(image, None)
        any_placed = True
    return any_placed


def fitting(block: Block, image: int) -> list[PoseCandidate]:
    """Poses of a picture that fit most of its placed points; two where both fit alike."""
    count = block.count_placed(image)
    least = MIN_KNOWN_POINTS if block.known.any() else MIN_POINTS
    needed = max(least, 0.6 * count)
    found = [c for c in block.resect(image) if c.inliers >= needed]
    if not found:
        return []
    worst = _TWIN_COST * found[0].cost_px2 + (0.02 * block.gate_px) ** 2
    return [c for c in found if c.cost_px2 <= worst]


def settle(block: Block) -> None:
    """Resect every picture again: a pose that fits much better replaces the one it has.

    With all points placed the twin of a flat part shows by its residuals; a picture
    that fits less than half of its points loses its pose.
    """
    changed = False
    for image in np.flatnonzero(block.placed):
        rows = block.rows_of[image]
        distance = block.distance_px(rows)
        distance = distance[~np.isnan(distance)]
        if len(distance) < MIN_KNOWN_POINTS:
            continue
        cost = float(np.mean(np.minimum(distance, block.gate_px) ** 2))
        found = block.resect(int(image))
        if found and found[0].cost_px2 < 0.5 * cost:
            block.place(int(image), found[0].rotation, found[0].translation_mm)
            changed = True
        elif (distance < block.gate_px).mean() < 0.5 and not block.known.any():
            block.remove(int(image))
            changed = True
    block.triangulate(again=True)
    if changed:
        block.bundle()
        block.settle_gate()
        block.triangulate(again=True)


def complete(block: Block) -> None:
    """Grow a block to all pictures that it can take, and adjust it as a whole."""
    grow(block)
    settle(block)
    grow(block)
    block.bundle()
    block.settle_gate()
    block.triangulate(again=True)
