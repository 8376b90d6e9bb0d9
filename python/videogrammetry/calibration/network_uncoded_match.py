"""One round of matching a network's un-coded targets, on fixed poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import poisson

from videogrammetry.adjustment import Network
from videogrammetry.calibration.network_block import placed_block
from videogrammetry.calibration.network_epipolar import (
    View,
    epipolar_pairs,
    ideal_rays,
    intersect_two,
)
from videogrammetry.calibration.network_input import NetworkInput, NetworkPoints
from videogrammetry.calibration.network_rays import RowArray, agreeing, intersect_rays
from videogrammetry.calibration.network_seed import common_points
from videogrammetry.types import INTERIOR_NAMES, FloatArray

#: Distance from an epipolar line, and from a prediction (chi-square, 2 degrees), at 99.9 %.
_LINE_SIGMAS, _GATE_CHI2 = 3.29, 13.8
#: Expected number of chance points per pair of pictures that is accepted.
_FALSE_POINTS = 1e-3
#: Rays of a point: with three the third confirms in two coordinates.
MIN_RAYS = 3
#: Least share of the pictures that face a point in which it must be found.
_SEEN_SHARE = 0.25
#: Angle between two pictures' rays to the object that match well.
_MIN_PAIR_RAD, _BEST_PAIR_RAD, _MAX_PAIR_RAD = np.radians([4.0, 20.0, 60.0])
#: Angle to the first picture within which a third one may see the same side.
_MAX_THIRD_RAD = np.radians(75.0)
_NEIGHBOURS = 8
#: Two new points within this many standard deviations may be one: depth is a few times
#: less sure than across.
_SAME_SIGMAS = 12.0
#: A prediction less certain than this confirms nothing, px.
_MAX_PREDICTION_PX = 8.0


def new_names(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Numbers above the largest number among the names.

    Examples
    --------
    >>> new_names(["7", "bar", "12"], 2)
    ('13', '14')
    """
    largest = max((int(name) for name in names if name.isdecimal()), default=0)
    return tuple(str(largest + 1 + k) for k in range(count))


class Matcher:
    """One round of matching on fixed poses."""

    def __init__(self, network: NetworkInput) -> None:
        self.network = network
        self.block = placed_block(network)
        self.block.settle_gate()
        self.noise_px = max(self.block.noise_px(), 0.01)
        self.point = network.observations.point.copy()
        self.position = [*np.asarray(network.points.position_mm, float)]
        self.changed = False
        self.ambiguous = 0
        self.placed = np.flatnonzero(self.block.placed)
        self.count = common_points(self.block)
        self.cov, self.views = self._views()
        self.open = {k: np.ones(len(view.row), bool) for k, view in self.views.items()}
        has = self.block.has_point
        self.middle = self.block.position[has].mean(axis=0)
        low, high = self.block.position[has].min(axis=0), self.block.position[has].max(axis=0)
        spare = 0.5 * float(np.linalg.norm(high - low))
        self.low, self.high = low - spare, high + spare

    def _views(self) -> tuple[FloatArray, dict[int, View]]:
        network, block = Network(), self.block
        free = []
        for c, camera in enumerate(block.cameras):
            count = int((block.camera_of[self.placed] == c).sum())
            names = block.free_parameters(c, count)
            network.add_camera(
                str(c),
                camera,
                free=names,
                prior_sigma=block._loose_prior(c),
                start=camera.interior,
            )
            free.append(names)
        index = np.full(len(block.rotation), -1)
        for image in self.placed:
            pose = network.add_pose(str(image), block.rotation[image], block.translation[image])
            index[image] = network.add_image(str(image), int(block.camera_of[image]), inner=pose)
        distance = block.distance_px()
        use = distance < block.gate_px
        rays = np.bincount(block.point[use], minlength=len(block.position))
        use &= rays[block.point] >= 2
        has = block.has_point & (rays >= 2)
        # A soft datum: an epipolar distance does not depend on it.
        soft = 0.1 * float(np.nanmax(np.nanstd(block.position[has], axis=0)))
        network.set_points(
            np.arange(len(has)),
            np.where(has[:, None], block.position, 0.0),
            np.tile(soft**2 * np.eye(3), (len(has), 1, 1)),
        )
        cov = np.tile([self.noise_px**2, 0.0, self.noise_px**2], (int(use.sum()), 1))
        network.set_observations(index[block.image[use]], block.point[use], block.xy_px[use], cov)
        dispersion = network.dispersion()
        model = np.full(len(block.rotation), np.nan)
        _, predicted = dispersion.predict(index[block.image[use]], block.point[use])
        largest = np.sqrt(np.maximum(predicted[:, 0], predicted[:, 2]))
        for image in self.placed:
            mine = largest[block.image[use] == image]
            model[image] = np.nanmax(mine) if len(mine) else 1.0
        observations = self.network.observations
        views = {}
        for image in self.placed:
            row = np.flatnonzero((observations.image == image) & (self.point < 0))
            c = int(block.camera_of[image])
            ideal, by_interior = ideal_rays(block.cameras[c], observations.xy_px[row])
            at = np.array([dispersion.interior_index[c, k] for k in range(len(INTERIOR_NAMES))])
            views[int(image)] = View(
                camera=block.cameras[c],
                camera_index=c,
                rotation=block.rotation[image],
                translation=block.translation[image],
                row=row,
                xy_px=observations.xy_px[row],
                ideal=ideal,
                by_interior=by_interior,
                pose_at=int(dispersion.pose_index[index[image]]),
                interior_at=at,
                sigma_px=self.noise_px,
                model_px=float(model[image]),
            )
        return dispersion.cov, views

    # - points that stand -

    def extend_known(self) -> None:
        """Give open image points to placed points that are not yet seen there."""
        has = np.flatnonzero(np.isfinite(np.array(self.position)[:, 0]))
        position = np.array(self.position)[has]
        seen = set(zip(self.network.observations.image.tolist(), self.point.tolist(), strict=True))
        facing = self._seen_from(has)
        for image, view in self.views.items():
            index = np.flatnonzero(self.open[image])
            unseen = np.array(
                [k for k, p in enumerate(has) if (image, int(p)) not in seen], dtype=int
            )
            if len(index) == 0 or len(unseen) == 0:
                continue
            direction = view.centre - position[unseen]
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            turned = np.sum(direction * facing[unseen], axis=1) > np.cos(_MAX_THIRD_RAD)
            xy, _, inside = view.predict(position[unseen])
            ok = np.flatnonzero(inside & turned)
            if len(ok) == 0:
                continue
            gate = np.sqrt(_GATE_CHI2) * view.total_px
            distance, at = _neighbours(cKDTree(view.xy_px[index]), xy[ok], min(2, len(index)))
            alone = (distance[:, 0] < gate) & (
                (distance[:, 1] > 3 * gate) if distance.shape[1] > 1 else True
            )
            found = view.xy_px[index[at[:, 0]]]
            back, _ = _neighbours(cKDTree(xy[ok]), found, min(2, len(ok)))
            if len(ok) > 1:
                alone &= back[:, 1] > 3 * gate
            for k in np.flatnonzero(alone):
                self._claim(image, int(index[at[k, 0]]), int(has[unseen[ok[k]]]))

    def _seen_from(self, points: RowArray) -> FloatArray:
        """Mean unit direction from each point to the pictures that see it."""
        block = self.block
        centre = -np.einsum("nji,nj->ni", block.rotation, block.translation)
        rows = np.flatnonzero(block.placed[block.image])
        sight = centre[block.image[rows]] - block.position[block.point[rows]]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        total = np.zeros((len(block.position), 3))
        fine = np.isfinite(sight[:, 0])
        np.add.at(total, block.point[rows[fine]], sight[fine])
        length = np.linalg.norm(total, axis=1, keepdims=True)
        result: FloatArray = (total / np.where(length > 0, length, 1.0))[points]
        return result

    def _claim(self, image: int, index: int, point: int) -> None:
        self.point[self.views[image].row[index]] = point
        self.open[image][index] = False
        self.changed = True

    # - new points -

    def match_pairs(self) -> None:
        """Match the pairs of pictures, the best first, each on what is still open."""
        for i, j in self._pairs():
            self._match_pair(i, j)

    def _angle(self, i: int, j: int) -> float:
        u, v = self.views[i].centre - self.middle, self.views[j].centre - self.middle
        return float(np.arccos(np.clip(u @ v / np.linalg.norm(u) / np.linalg.norm(v), -1, 1)))

    def _pairs(self) -> list[tuple[int, int]]:
        """Each picture with its best neighbours: common points, rays at about 20 degrees."""
        chosen: dict[tuple[int, int], float] = {}
        for i in self.views:
            scored = []
            for j in self.views:
                if i == j or self.count[i, j] < 3:
                    continue
                angle = self._angle(i, j)
                if _MIN_PAIR_RAD < angle < _MAX_PAIR_RAD:
                    scored.append((abs(np.log(angle / _BEST_PAIR_RAD)), j))
            for cost, j in sorted(scored)[:_NEIGHBOURS]:
                chosen[min(i, j), max(i, j)] = cost
        return sorted(chosen, key=lambda pair: chosen[pair])

    def _match_pair(self, i: int, j: int) -> None:
        a, b = self.views[i], self.views[j]
        open_a, open_b = np.flatnonzero(self.open[i]), np.flatnonzero(self.open[j])
        if len(open_a) == 0 or len(open_b) == 0:
            return
        pairs = epipolar_pairs(a, b, self.cov, open_a, open_b, _LINE_SIGMAS)
        points, cov = intersect_two(a, b, pairs.first, pairs.second, 0.5 * float(_MIN_PAIR_RAD))
        inside = ((points > self.low) & (points < self.high)).all(axis=1)
        first, second = pairs.first[inside], pairs.second[inside]
        points, cov = points[inside], cov[inside]
        if len(points) == 0:
            return
        third, expected, facing = self._confirm(i, j, points, cov)
        found = (third >= 0).sum(axis=1)
        chance = len(points) * np.asarray(poisson.sf(found - 1, expected))
        good = (found >= MIN_RAYS - 2) & (chance < _FALSE_POINTS)
        good &= found >= _SEEN_SHARE * facing
        order = sorted(np.flatnonzero(good), key=lambda k: (-found[k], chance[k]))
        self._settle(i, j, [(int(first[k]), int(second[k]), third[k]) for k in order])

    def _confirm(
        self, i: int, j: int, points: FloatArray, cov: FloatArray
    ) -> tuple[RowArray, FloatArray, RowArray]:
        """Open image point (P, I) at each prediction or -1, chance hits, pictures that face."""
        third = np.full((len(points), len(self.block.rotation)), -1)
        expected, facing = np.zeros(len(points)), np.zeros(len(points), int)
        for k, view in self.views.items():
            index = np.flatnonzero(self.open[k])
            if k in (i, j) or len(index) == 0:
                continue
            if max(self._angle(i, k), self._angle(j, k)) > _MAX_THIRD_RAD:
                continue
            xy, by_point, inside = view.predict(points)
            total = np.einsum("nij,njk,nlk->nil", by_point, cov, by_point)
            total = total + view.total_px**2 * np.eye(2)
            # The larger eigenvalue, written out: points behind the camera are NaN here.
            half = 0.5 * (total[:, 0, 0] + total[:, 1, 1])
            apart = np.hypot(0.5 * (total[:, 0, 0] - total[:, 1, 1]), total[:, 0, 1])
            largest = np.sqrt(half + apart)
            usable = np.flatnonzero(inside & (largest < _MAX_PREDICTION_PX))
            if len(usable) == 0:
                continue
            tree = cKDTree(view.xy_px[index])
            _, at = _neighbours(tree, xy[usable], min(2, len(index)))
            chi2 = np.stack(
                [
                    _mahalanobis(view.xy_px[index[at[:, c]]] - xy[usable], total[usable])
                    for c in range(at.shape[1])
                ],
                axis=1,
            )
            one = (chi2 < _GATE_CHI2).sum(axis=1) == 1
            which = np.argmin(chi2, axis=1)
            third[usable[one], k] = index[at[one, which[one]]]
            area = np.pi * _GATE_CHI2 * np.sqrt(np.linalg.det(total[usable]))
            expected[usable] += 1.0 - np.exp(-_density(tree) * area)
            facing[usable] += 1
        return third, expected, facing

    def _settle(self, i: int, j: int, found: Sequence[tuple[int, int, RowArray]]) -> None:
        """Make points of what was found, most rays first; two that share rays are ambiguous."""
        taken: dict[tuple[int, int], int] = {}
        rivals = self._rivals(i, j, found)
        for number, (first, second, third) in enumerate(found):
            rays = [(i, first), (j, second)]
            rays += [(int(k), int(third[k])) for k in np.flatnonzero(third >= 0)]
            if any(ray in taken for ray in rays[:2]):
                continue  # the better one of two that share an image point stands
            rays = [ray for ray in rays if ray not in taken]
            if number in rivals:
                self.ambiguous += 2
                continue
            kept, position = self._refined(rays)
            if position is None or len(kept) < MIN_RAYS:
                continue
            point = len(self.position)
            self.position.append(position)
            for image, index in kept:
                taken[image, index] = point
                self._claim(image, index, point)

    def _rivals(self, i: int, j: int, found: Sequence[tuple[int, int, RowArray]]) -> set[int]:
        """Candidates for which another with the same image point has as many rays."""
        rays = [int((third >= 0).sum()) for _, _, third in found]
        rivals: set[int] = set()
        for side in (0, 1):
            groups: dict[int, list[int]] = {}
            for number, candidate in enumerate(found):
                groups.setdefault(int(candidate[side]), []).append(number)
            for numbers in groups.values():
                # (found is sorted: the first has the most)
                if len(numbers) > 1 and 2 * rays[numbers[1]] > rays[numbers[0]]:
                    rivals.update(numbers)
        return rivals

    def _refined(
        self, rays: Sequence[tuple[int, int]]
    ) -> tuple[list[tuple[int, int]], FloatArray | None]:
        """The rays that meet in one point, and the point."""
        views = [self.views[image] for image, _ in rays]
        centre = np.array([view.centre for view in views])
        direction = np.array(
            [view.directions(np.array([k]))[0] for view, (_, k) in zip(views, rays, strict=True)]
        )
        f_px = np.array([view.f_px for view in views])
        gate = np.sqrt(_GATE_CHI2) * max(view.total_px for view in views)
        position = intersect_rays(
            centre[None], direction[None], f_px[None], gate, float(_MIN_PAIR_RAD)
        )[0]
        if not np.isfinite(position).all():
            return [], None
        near = agreeing(position, centre, direction, f_px, gate)
        return [ray for ray, kept in zip(rays, near, strict=True) if kept], position

    def merge_split(self, first_new: int) -> None:
        """Join new points at one place that no picture sees apart.

        A dot whose prediction had a rival in some pictures is found a second time
        from those that were left.
        """
        position = np.array(self.position)
        new = np.flatnonzero(np.isfinite(position[:, 0]))
        new = new[new >= first_new]
        if len(new) < 2:
            return
        views = list(self.views.values())
        depth = np.median([np.linalg.norm(view.centre - self.middle) for view in views])
        across = max(view.total_px / view.f_px for view in views)
        near = cKDTree(position[new]).query_pairs(_SAME_SIGMAS * float(depth) * across)
        image = self.network.observations.image
        for a, b in sorted(near):
            first, second = int(new[a]), int(new[b])
            in_first, in_second = image[self.point == first], image[self.point == second]
            if len(in_first) and len(in_second) and not np.isin(in_first, in_second).any():
                self.point[self.point == second] = first
                self.position[second] = np.full(3, np.nan)

    def result(self) -> NetworkInput:
        """The network with the new points and assignments."""
        points = self.network.points
        new = len(self.position) - len(points)
        names = new_names(points.name, new)
        extended = NetworkPoints(
            name=(*points.name, *names),
            position_mm=np.array(self.position),
            kind=np.concatenate([points.kind.astype("U8"), np.full(new, "free", "U8")]),
            cov_mm2=_padded(points.cov_mm2, new),
            full_cov_mm2=points.full_cov_mm2,
            normal=_padded(points.normal, new),
            diameter_mm=_padded(points.diameter_mm, new),
        )
        observations = replace(self.network.observations, point=self.point.astype(np.int32))
        return replace(self.network, points=extended, observations=observations)


def _padded(array: FloatArray | None, new: int) -> FloatArray | None:
    if array is None:
        return None
    return np.concatenate([array, np.full((new, *array.shape[1:]), np.nan)])


def _mahalanobis(difference: FloatArray, cov: FloatArray) -> FloatArray:
    result: FloatArray = np.einsum(
        "ni,ni->n", difference, np.linalg.solve(cov, difference[..., None])[..., 0]
    )
    return result


def _neighbours(tree: cKDTree, points: FloatArray, count: int) -> tuple[FloatArray, RowArray]:
    """Distances and indices of the nearest, (N, count) each."""
    distance, index = tree.query(points, k=np.arange(1, count + 1))
    return np.asarray(distance), np.asarray(index)


def _density(tree: cKDTree) -> float:
    """Image points per px2 where they stand: from the distance of the fourth neighbour."""
    count = min(5, tree.n)
    if count < 2:
        return 1e-6
    distance, _ = _neighbours(tree, np.asarray(tree.data), count)
    return float((count - 1) / (np.pi * max(np.median(distance[:, -1]), 1e-3) ** 2))
