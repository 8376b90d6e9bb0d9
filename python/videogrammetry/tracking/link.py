"""Identity of points over stages: coded by number, un-coded by their motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from videogrammetry._core import tracking as _tracking
from videogrammetry.types import FloatArray, IntArray, StagePoints, Trajectories, cov6_from_matrix


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """How points are linked from stage to stage; fields and defaults equal the C++ struct's.

    Attributes
    ----------
    gate_sigma : a prediction may be missed by this many of its standard
        deviations, (0, 20].
    max_share_of_spacing : what no covariance vouches for is linked within this
        share of the distance to the nearest other point, (0, 0.5).
    neighbours : where the object bends, a point follows the points around it:
        this many lie within the weight's reach, >= 3.
    min_log_odds : links less sure than this against the best other assignment
        are decided by what follows, >= 0.
    window_stages : stages after which they are decided at last; 0: at once; <= 15.
    max_gap_stages : an un-coded point is given up after this many stages without it.
    """

    gate_sigma: float = 5.0
    max_share_of_spacing: float = 0.4
    neighbours: int = 6
    min_log_odds: float = 9.0
    window_stages: int = 10
    max_gap_stages: int = 200


@dataclass(frozen=True, kw_only=True)
class StageLinks:
    """What tracking says of a stage, and what it now knows better of earlier ones.

    Attributes
    ----------
    number : (P,) of every point of the stage.
    log_odds : (P,) of the link to the same point before, against the best
        assignment without it: infinite where a code says so, NaN where a number
        begins.
    renames : (K, 2) from, to: numbers that are another's at all stages before,
        to be applied in this order.
    revised_stage, revised_row, revised_number, revised_log_odds : (R,) points of
        the last ``window_stages`` stages (counted from 0, the first that was
        added) that have another number; after the renames, in this order.
    """

    number: IntArray
    log_odds: FloatArray
    renames: IntArray
    revised_stage: IntArray
    revised_row: IntArray
    revised_number: IntArray
    revised_log_odds: FloatArray

    def revise(self, numbers: Sequence[IntArray], log_odds: Sequence[FloatArray] = ()) -> None:
        """Apply renames and revisions to the arrays of the stages before, in place."""
        for old, new in self.renames.tolist():
            for of_stage in numbers:
                of_stage[of_stage == old] = new
        for stage, row, number, odds in zip(
            self.revised_stage.tolist(),
            self.revised_row.tolist(),
            self.revised_number.tolist(),
            self.revised_log_odds.tolist(),
            strict=True,
        ):
            numbers[stage][row] = number
            if log_odds:
                log_odds[stage][row] = odds


@dataclass(frozen=True, kw_only=True)
class ManyLinks:
    """What tracking says of consecutive stages; see :class:`StageLinks`.

    Attributes
    ----------
    number, log_odds : (P,) of the points of all stages.
    renames : (K, 3) the stage, counted from the first of these, that says so; from, to.
    revised_at : (R,) the stage, likewise, that says so. revised_stage : (R,) counted from
        the first stage that was ever added. revised_row, revised_number, revised_log_odds.
    """

    number: IntArray
    log_odds: FloatArray
    renames: IntArray
    revised_at: IntArray
    revised_stage: IntArray
    revised_row: IntArray
    revised_number: IntArray
    revised_log_odds: FloatArray


class Tracker:
    """Numbers for points, stage by stage, in memory that does not grow with the stages.

    Codes keep their number; un-coded points get numbers from ``first_free_id``
    that stay with them over gaps and crossings. The model is in
    ``cpp/videogrammetry/tracking/tracker.h`` and docs/method.md, section 6.

    Parameters
    ----------
    first_free_id : the first number for un-coded points: above the largest code.
    options : None: the defaults.

    Examples
    --------
    Two points that pass each other keep their numbers:

    >>> tracker = Tracker(100)
    >>> for s in range(9):
    ...     position = np.array([[s - 4.0, 0.1, 0.0], [4.0 - s, -0.1, 0.0]])
    ...     links = tracker.add(np.array([-1, -1]), position, np.tile(1e-4 * np.eye(3), (2, 1, 1)))
    >>> links.number.tolist()
    [100, 101]
    """

    def __init__(self, first_free_id: int, options: LinkOptions | None = None) -> None:
        options = options or LinkOptions()
        core_options = _tracking.LinkOptions()
        for field in fields(options):
            setattr(core_options, field.name, getattr(options, field.name))
        self._core = _tracking.Tracker(first_free_id, core_options)

    @property
    def num_points(self) -> int:
        """Points whose states are kept, seen or not."""
        return int(self._core.num_points)

    def add(self, id: IntArray, position_mm: FloatArray, cov_mm2: FloatArray) -> StageLinks:
        """Link the points of the next stage.

        Parameters
        ----------
        id : (P,) code or -1; a code that stands twice counts as not read.
        position_mm : (P, 3).
        cov_mm2 : (P, 3, 3) of the image noise.

        Raises
        ------
        ValueError
            If lengths differ, a number is not finite, an id is not below
            ``first_free_id``, or a covariance is not positive; nothing has changed then.
        """
        result = self._core.add(
            np.ascontiguousarray(id, dtype=np.int32),
            np.ascontiguousarray(position_mm, dtype=float),
            np.ascontiguousarray(cov_mm2, dtype=float),
        )
        renames = np.stack([result.pop("rename_from"), result.pop("rename_to")], axis=1)
        return StageLinks(renames=renames, **result)

    def add_stages(
        self, offsets: npt.ArrayLike, id: IntArray, position_mm: FloatArray, cov_mm2: FloatArray
    ) -> ManyLinks:
        """Link the points of consecutive stages, as :meth:`add` does one by one.

        Parameters
        ----------
        offsets : (S + 1,) the points of the s-th stage are offsets[s] to offsets[s + 1].
        id, position_mm : (P,), (P, 3) as in :meth:`add`.
        cov_mm2 : (P, 6) of the image noise, order ``COV6_ORDER``.

        Raises
        ------
        ValueError
            As :meth:`add`; the stages before the one that is named are linked then.

        Examples
        --------
        >>> x = np.array([[0.0, 0, 0], [1, 0, 0]])
        >>> noise = np.tile([1e-4, 0, 0, 1e-4, 0, 1e-4], (2, 1))
        >>> Tracker(100).add_stages([0, 1, 2], [7, 7], x, noise).number.tolist()
        [7, 7]
        """
        result = self._core.add_stages(
            np.ascontiguousarray(offsets, dtype=np.int64),
            np.ascontiguousarray(id, dtype=np.int32),
            np.ascontiguousarray(position_mm, dtype=float),
            np.ascontiguousarray(cov_mm2, dtype=float),
        )
        names = ("rename_at", "rename_from", "rename_to")
        renames = np.stack([result.pop(name) for name in names], axis=1)
        return ManyLinks(renames=renames, **result)


def link_stages(
    stages: Sequence[StagePoints], first_free_id: int, options: LinkOptions | None = None
) -> list[IntArray]:
    """Number the points of every stage: codes keep theirs, un-coded get numbers that stay.

    :class:`Tracker` over all stages, with what it knows better later applied to
    the stages before: a coded point whose ring could not be read is followed, and
    an un-coded number whose ring is read later becomes that code at all stages.

    Parameters
    ----------
    stages : the points of each stage, in order.
    first_free_id : the first number for un-coded points: above the family's
        largest code.

    Returns
    -------
    list of (P_s,) arrays
        The number of every point of every stage.
    """
    tracker = Tracker(first_free_id, options)
    numbers: list[IntArray] = []
    for points in stages:
        links = tracker.add(points.id, points.position_mm, points.cov_image_mm2)
        links.revise(numbers)
        numbers.append(links.number)
    return numbers


def build_trajectories(
    stages: Sequence[StagePoints],
    numbers: Sequence[IntArray],
    stage_number: IntArray,
    time_s: FloatArray,
    camera_names: Sequence[str],
) -> Trajectories:
    """Trajectories (S, P, ...) of the numbered points; NaN where a stage lacks a point."""
    point_id = np.unique(np.concatenate([*numbers, np.empty(0, np.int32)])).astype(np.int32)
    shape = (len(stages), len(point_id))
    position = np.full((*shape, 3), np.nan)
    cov = np.full((*shape, 6), np.nan)
    cov_image = np.full((*shape, 6), np.nan)
    used = np.zeros((*shape, len(camera_names)), dtype=bool)
    rms = np.full(shape, np.nan)
    for s, (points, ids) in enumerate(zip(stages, numbers, strict=True)):
        column = np.searchsorted(point_id, ids)
        position[s, column] = points.position_mm
        cov[s, column] = cov6_from_matrix(points.cov_image_mm2 + points.cov_rig_mm2)
        cov_image[s, column] = cov6_from_matrix(points.cov_image_mm2)
        used[s, column] = points.target >= 0
        rms[s, column] = points.rms_px
    return Trajectories(
        stage=np.asarray(stage_number, dtype=np.int32),
        time_s=np.asarray(time_s, dtype=float),
        point_id=point_id,
        position_mm=position,
        cov_mm2=cov,
        cov_image_mm2=cov_image,
        cameras_used=used,
        rms_px=rms,
        camera_names=tuple(camera_names),
    )
