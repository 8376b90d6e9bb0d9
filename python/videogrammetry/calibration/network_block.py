"""A block of pictures that grows: placed pictures, placed points, what fits them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import Network, resect, robust_bundle
from videogrammetry.adjustment.start import PoseCandidate
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_rays import BoolArray, RowArray, intersect_rays
from videogrammetry.geometry import camera_model, project, rays_through_pixels
from videogrammetry.types import INTERIOR_NAMES, FloatArray, RigCamera

#: Share of the picture's diagonal beyond which a point counts as a wrong number
#: while lens distortion and f are rough.
START_GATE = 0.01
#: Least gate, as a share of the diagonal, and its width in standard deviations.
LEAST_GATE, GATE_SIGMAS = 0.0005, 8.0
#: Least angle between the rays of a new point: depth is 30 times less sure than across.
MIN_ANGLE_RAD = np.radians(2.0)
#: Points that are intersected together, which bounds the tables' size.
_AT_ONCE = 2000
#: A median distance is this many standard deviations of a coordinate (Rayleigh).
_MEDIAN_SIGMAS = 1.177
#: Parameters that a start needs: what is left of the others fits into the gate.
_START_FREE = ("f", "x0", "y0", "A1", "A2")


class Block:
    """Placed pictures and points of a network, in one frame.

    Attributes
    ----------
    cameras : interiors as they stand (poses identity).
    image, point, xy_px : the observations with a number, (M,), (M,), (M, 2).
    position : (N, 3), NaN where not placed; ``known`` (N,) are held.
    rotation, translation : (I, 3, 3), (I, 3) cam_from_object, NaN where not placed.
    twin : image -> a second pose that fitted alike when it was placed.
    """

    def __init__(self, network: NetworkInput, cameras: Sequence[RigCamera]) -> None:
        coded = np.flatnonzero(network.observations.point >= 0)
        self.network = network
        self.cameras = list(cameras)
        self.row = coded
        self.image = network.observations.image[coded]
        self.point = network.observations.point[coded]
        self.xy_px = network.observations.xy_px[coded]
        self.camera_of = np.array([image.camera for image in network.images])
        position = np.asarray(network.points.position_mm, float)
        self.known: BoolArray = (network.points.kind != "free") & np.isfinite(position).all(1)
        self.position = np.where(self.known[:, None], position, np.nan)
        self.rotation = np.full((len(network.images), 3, 3), np.nan)
        self.translation = np.full((len(network.images), 3), np.nan)
        self.twin: dict[int, PoseCandidate] = {}
        self.allowed = np.ones(len(network.images), bool)
        diagonal = max(float(np.hypot(*camera.image_size_px)) for camera in network.cameras)
        self.start_gate_px = START_GATE * diagonal
        self.least_gate_px = LEAST_GATE * diagonal
        self.gate_px = self.start_gate_px
        self._rays: FloatArray | None = None
        self.rows_of = _grouped(self.image, len(network.images))
        self.rows_of_point = _grouped(self.point, len(position))

    def copy(self) -> Block:
        """An independent block (the observations are shared)."""
        other = Block.__new__(Block)
        other.__dict__.update(self.__dict__)
        other.cameras = list(self.cameras)
        other.position = self.position.copy()
        other.rotation, other.translation = self.rotation.copy(), self.translation.copy()
        other.allowed = self.allowed.copy()
        other.twin = dict(self.twin)
        return other

    @property
    def placed(self) -> BoolArray:
        """(I,) pictures with a pose."""
        result: BoolArray = np.isfinite(self.translation[:, 0])
        return result

    @property
    def has_point(self) -> BoolArray:
        """(N,) points with a position."""
        result: BoolArray = np.isfinite(self.position[:, 0])
        return result

    @property
    def rays(self) -> FloatArray:
        """(M, 3) unit directions in the cameras' frames, with the interiors as they stand."""
        if self._rays is None:
            self._rays = np.full((len(self.image), 3), np.nan)
            for c, camera in enumerate(self.cameras):
                rows = np.flatnonzero(self.camera_of[self.image] == c)
                if len(rows) and camera.interior[0] > 0:
                    ray = rays_through_pixels(camera, self.xy_px[rows])
                    self._rays[rows] = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        return self._rays

    def set_cameras(self, cameras: Sequence[RigCamera]) -> None:
        """Replace the interiors."""
        self.cameras = list(cameras)
        self._rays = None

    def place(self, image: int, rotation: FloatArray, translation: FloatArray) -> None:
        """Give a picture its pose."""
        self.rotation[image], self.translation[image] = rotation, translation

    def remove(self, image: int) -> None:
        """Take a picture's pose away."""
        self.rotation[image], self.translation[image] = np.nan, np.nan
        self.twin.pop(image, None)

    def distance_px(self, rows: RowArray | None = None) -> FloatArray:
        """(M,) distance from the prediction; NaN without one, inf behind a camera."""
        rows = np.arange(len(self.image)) if rows is None else rows
        result = np.full(len(rows), np.nan)
        image, point = self.image[rows], self.point[rows]
        both = self.placed[image] & self.has_point[point]
        for c, camera in enumerate(self.cameras):
            at = np.flatnonzero(both & (self.camera_of[image] == c))
            if len(at) == 0:
                continue
            r, t = self.rotation[image[at]], self.translation[image[at]]
            in_cam = np.einsum("nij,nj->ni", r, self.position[point[at]]) + t
            distance = np.linalg.norm(project(camera, in_cam) - self.xy_px[rows[at]], axis=1)
            result[at] = np.where(np.isfinite(distance), distance, np.inf)
        return result

    def noise_px(self) -> float:
        """Standard deviation of an image coordinate, from the median distance."""
        distance = self.distance_px()
        distance = distance[~np.isnan(distance)]
        # (half of the points of a pair's block fit exactly across the epipolar lines)
        return float(np.median(distance) / _MEDIAN_SIGMAS) if len(distance) else np.inf

    def settle_gate(self) -> None:
        """The gate that the present fit allows."""
        self.gate_px = float(
            np.clip(GATE_SIGMAS * self.noise_px(), self.least_gate_px, self.start_gate_px)
        )

    def triangulate(self, *, again: bool = False) -> None:
        """Place the points that two placed pictures see; ``again``: also the badly placed."""
        open_points = ~self.has_point
        if again:
            distance = self.distance_px()
            seen = ~np.isnan(distance)
            bad = np.bincount(self.point[seen & (distance > self.gate_px)],
                              minlength=len(self.position))  # fmt: skip
            count = np.bincount(self.point[seen], minlength=len(self.position))
            open_points |= ~self.known & (3 * bad > count)
        self.position[open_points] = np.nan
        rows = np.flatnonzero(open_points[self.point] & self.placed[self.image])
        rows = rows[np.isfinite(self.rays[rows]).all(axis=1)]
        rows = rows[np.argsort(self.point[rows], kind="stable")]
        number = np.bincount(self.point[rows], minlength=len(self.position))
        # Points with about as many rays together: the tables are padded to the largest.
        of_class = np.where(number > 1, np.ceil(2 * np.log2(np.maximum(number, 2))), -1)
        for size in np.unique(of_class[of_class >= 0]):
            every = np.flatnonzero(of_class == size)
            for part in np.array_split(every, len(every) // _AT_ONCE + 1):
                self._intersect(part, rows)

    def _intersect(self, points: RowArray, rows: RowArray) -> None:
        """Place points by their rays; ``rows``: of observations, sorted by point."""
        rows = rows[np.isin(self.point[rows], points)]
        place = np.searchsorted(points, self.point[rows])
        begin = np.searchsorted(place, np.arange(len(points)))
        rank = np.arange(len(rows)) - begin[place]
        images = self.image[rows]
        r = self.rotation[images]
        shape = (len(points), int(rank.max()) + 1)
        centre, direction = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
        f_px = np.ones(shape)
        centre[place, rank] = -np.einsum("nji,nj->ni", r, self.translation[images])
        direction[place, rank] = np.einsum("nji,nj->ni", r, self.rays[rows])
        f_px[place, rank] = self.focal_px(images)
        self.position[points] = intersect_rays(centre, direction, f_px, self.gate_px, MIN_ANGLE_RAD)

    def focal_px(self, images: RowArray) -> FloatArray:
        """f of pictures."""
        f = np.array([camera.interior[0] for camera in self.cameras])
        result: FloatArray = f[self.camera_of[images]]
        return result

    def resect(self, image: int) -> list[PoseCandidate]:
        """Poses of a picture from the placed points that it sees."""
        rows = self.rows_of[image]
        rows = rows[self.has_point[self.point[rows]]]
        if len(rows) < 4:
            return []
        camera = camera_model(self.cameras[self.camera_of[image]])
        return resect(
            camera, self.position[self.point[rows]], self.xy_px[rows], threshold_px=self.gate_px
        )

    def count_placed(self, image: int) -> int:
        """Number of placed points that a picture sees."""
        return int(self.has_point[self.point[self.rows_of[image]]].sum())

    def bundle(self, *, interior: bool = True, max_iterations: int = 40) -> None:
        """Adjust placed pictures and points robustly; with ``interior``, also f and distortion."""
        for _ in range(2):
            distance = self.distance_px()
            use = np.isfinite(distance)
            rays = np.bincount(self.point[use], minlength=len(self.position))
            use &= (rays[self.point] >= 2) | self.known[self.point]
            images = np.unique(self.image[use])
            if not len(images):
                return
            if len(images) < 2 and not self.known.any():
                return
            sigma = float(np.clip(np.median(distance[use]) / _MEDIAN_SIGMAS, 0.02, 20.0))
            self._bundle_once(use, images, sigma, interior, max_iterations)

    def _bundle_once(
        self,
        use: BoolArray,
        images: RowArray,
        sigma_px: float,
        interior: bool,
        max_iterations: int,
    ) -> None:
        network = Network()
        for c, camera in enumerate(self.cameras):
            count = int((self.camera_of[images] == c).sum())
            network.add_camera(
                str(c),
                camera,
                free=self.free_parameters(c, count) if interior else (),
                prior_sigma=self._loose_prior(c),
                start=self._prior_mean(c),
            )
        index = np.full(len(self.rotation), -1)
        for image in images:
            pose = network.add_pose(str(image), self.rotation[image], self.translation[image])
            camera_index = int(self.camera_of[image])
            index[image] = network.add_image(str(image), camera_index, inner=pose)
        has = self.has_point
        extent = float(np.nanmax(np.nanstd(self.position[has], axis=0))) or 1.0
        sigma = np.where(self.known, 1e-5, 10.0) * extent
        network.set_points(
            np.arange(len(has)),
            np.where(has[:, None], self.position, 0.0),
            sigma[:, None, None] ** 2 * np.eye(3),
        )
        cov = np.tile([sigma_px**2, 0.0, sigma_px**2], (int(use.sum()), 1))
        network.set_observations(index[self.image[use]], self.point[use], self.xy_px[use], cov)
        robust_bundle(network, max_iterations=max_iterations)
        if not self._plausible(network):
            return
        seen = np.unique(self.point[use & ~self.known[self.point]])
        self.position[seen] = network.positions_mm[seen]
        for pose, image in enumerate(images):
            self.place(int(image), *network.pose(pose))
        if interior:
            self.set_cameras(
                [
                    with_interior(camera, network.interior(c))
                    for c, camera in enumerate(self.cameras)
                ]
            )

    def _plausible(self, network: Network) -> bool:
        return all(
            0.1 < network.interior(c)[0] / camera.interior[0] < 10.0
            for c, camera in enumerate(self.cameras)
            if camera.interior[0] > 0
        )

    def free_parameters(self, camera: int, num_images: int) -> tuple[str, ...]:
        """What of a camera a bundle of so many of its pictures estimates."""
        wanted = self.network.cameras[camera].free
        offered = INTERIOR_NAMES if wanted is None else wanted
        most = ("f", "A1") if num_images < 6 else _START_FREE
        return tuple(name for name in most if name in offered) if num_images > 1 else ()

    def _prior_mean(self, camera: int) -> FloatArray:
        given = np.asarray(self.network.cameras[camera].interior, float)
        return np.where(np.isfinite(given), given, self.cameras[camera].interior)

    def _loose_prior(self, camera: int) -> dict[str, float]:
        """The user's sigmas; else what no lens exceeds, so that a weak block stays sane."""
        given, side = self.network.cameras[camera], max(self.network.cameras[camera].image_size_px)
        r0 = self.cameras[camera].r0_px
        loose = {"x0": 0.05 * side, "y0": 0.05 * side, "A1": 0.1 / r0**2, "A2": 0.1 / r0**4}
        named = {name: sigma for name, sigma in given.sigma.items() if name in INTERIOR_NAMES}
        return {**loose, **named}


def with_interior(camera: RigCamera, interior: FloatArray) -> RigCamera:
    """The camera with another interior."""
    return RigCamera(
        image_size_px=camera.image_size_px, interior=np.array(interior, float), r0_px=camera.r0_px,
        rotation=np.eye(3), translation_mm=np.zeros(3), measured=camera.measured,
    )  # fmt: skip


def _grouped(label: npt.NDArray[np.integer], count: int) -> list[RowArray]:
    """Rows of each label 0 ... count - 1."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.searchsorted(label[order], np.arange(1, count)))


def placed_block(network: NetworkInput) -> Block:
    """The network as a block, with the poses and positions that it has."""
    cameras = [
        with_interior(
            RigCamera(
                image_size_px=c.image_size_px, interior=np.asarray(c.interior, float),
                r0_px=c.r0_px, rotation=np.eye(3), translation_mm=np.zeros(3), measured=c.measured,
            ),
            np.asarray(c.interior, float),
        )
        for c in network.cameras
    ]  # fmt: skip
    block = Block(network, cameras)
    for k, image in enumerate(network.images):
        if image.rotation is not None and image.translation_mm is not None:
            block.place(k, np.asarray(image.rotation), np.asarray(image.translation_mm))
    block.position = np.array(network.points.position_mm, float)
    return block
