"""The rig as its user meets it: load, project, triangulate."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import project_from_world
from videogrammetry.project import read_rig, write_rig
from videogrammetry.reconstruction.triangulate import Triangulator
from videogrammetry.reconstruction.uncertainty import (
    Distance,
    Intersection,
    Projection,
    predict_pictures,
)
from videogrammetry.types import FloatArray, RigData

#: Standard deviation of an image coordinate where neither the caller nor the rig says one.
_DEFAULT_SIGMA_PX = 0.05


class Rig(RigData):
    """Calibrated cameras in one frame.

    :meth:`project` and :meth:`triangulate` give plain arrays; :meth:`predict`,
    :meth:`intersect` and :meth:`distance` also say what of the uncertainty comes
    from the image noise and what from the calibration.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera
    >>> lens = dict(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)], r0_px=40.0,
    ...             rotation=np.eye(3))
    >>> rig = Rig(cameras={"a": RigCamera(translation_mm=np.zeros(3), **lens),
    ...                    "b": RigCamera(translation_mm=np.array([-20.0, 0, 0]), **lens)})
    >>> pixels = rig.project([[10.0, 0.0, 1000.0]])
    >>> {name: xy.tolist() for name, xy in pixels.items()}
    {'a': [[60.0, 50.0]], 'b': [[40.0, 50.0]]}
    >>> position, cov = rig.triangulate(pixels)
    >>> position.round(6).tolist()
    [[10.0, 0.0, 1000.0]]
    """

    @classmethod
    def from_data(cls, data: RigData) -> Self:
        """A rig of what a calibration or a file gave."""
        return cls(**{name: getattr(data, name) for name in RigData.__dataclass_fields__})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read rig.json (and rig.npz beside it); ProjectFileError says what is wrong."""
        return cls.from_data(read_rig(path))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write rig.json, and rig.npz beside it if there is a covariance."""
        write_rig(path, self)

    def project(self, points_in_world: npt.ArrayLike) -> dict[str, FloatArray]:
        """Pictures (N, 2) px of points (N, 3) mm in every camera; NaN where there is none.

        Of a camera that looks through a window into a fluid: refracted.
        """
        points = _points(points_in_world)
        return {name: project_from_world(camera, points) for name, camera in self.cameras.items()}

    def predict(
        self,
        points_in_world: npt.ArrayLike,
        *,
        cov_mm2: npt.ArrayLike | None = None,
        sigma_px: float | Mapping[str, npt.ArrayLike] | None = None,
        frame: str = "volume",
    ) -> Projection:
        """Pictures of points with covariances: of the noise, the points and the calibration.

        Parameters
        ----------
        points_in_world : (N, 3) mm. cov_mm2 : (N, 3, 3) theirs; None: exact.
        sigma_px : as for :meth:`triangulate`, of one measurement.
        frame : "volume": the points are fixed in the calibrated volume; "rig":
            in the rig's axes (see :class:`Triangulator`).

        Examples
        --------
        A focal length of 1000 px known to 2 px, a point 0.1 beside the axis:

        >>> from videogrammetry.types import RigCamera
        >>> camera = RigCamera(image_size_px=(301, 301), interior=np.r_[1000.0, np.zeros(9)],
        ...                    r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3))
        >>> rig = Rig(cameras={"a": camera}, cov=np.array([[4.0]]), cov_names=("a/f",))
        >>> seen = rig.predict([[100.0, 0.0, 1000.0]], sigma_px=0.1)
        >>> seen.xy_px["a"].tolist(), np.sqrt(seen.cov_rig_px2["a"][0, 0, 0]).round(6).item()
        ([[250.0, 150.0]], 0.2)
        """
        points = _points(points_in_world)
        cov = None if cov_mm2 is None else np.asarray(cov_mm2, dtype=float)
        if cov is not None and cov.shape != (len(points), 3, 3):
            raise ValueError(f"cov_mm2: expected ({len(points)}, 3, 3), got {cov.shape}")
        sigma = {name: self._sigma(name, sigma_px, len(points)) for name in self.cameras}
        return predict_pictures(self, points, sigma, cov, frame)

    def triangulate(
        self,
        pixels: Mapping[str, npt.ArrayLike],
        sigma_px: float | Mapping[str, npt.ArrayLike] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Points of corresponding pixels, with the covariance of noise and calibration.

        The calibration's part is stated in the frame of the calibrated volume
        (see :class:`Triangulator`); :meth:`intersect` tells the parts apart.

        Parameters
        ----------
        pixels : camera -> (N, 2); NaN where a camera does not see a point.
        sigma_px : standard deviation of an image coordinate: one number, or
            camera -> (N,) or number. None: the rig's own floor, else 0.05 px.

        Returns
        -------
        position_mm : (N, 3), NaN where fewer than two cameras see the point or
            the rays do not meet before the cameras.
        cov_mm2 : (N, 3, 3).

        Raises
        ------
        ValueError
            If a camera is unknown or the arrays differ in length.
        """
        found = self.intersect(pixels, sigma_px)
        return found.position_mm, found.cov_mm2

    def intersect(
        self,
        pixels: Mapping[str, npt.ArrayLike],
        sigma_px: float | Mapping[str, npt.ArrayLike] | None = None,
        *,
        frame: str = "volume",
    ) -> Intersection:
        """As :meth:`triangulate`, with covariances by their cause, residuals and status.

        ``frame``: of the calibration's covariance, "volume" or "rig".

        Examples
        --------
        >>> from videogrammetry.types import RigCamera
        >>> lens = dict(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
        ...             r0_px=40.0, rotation=np.eye(3))
        >>> rig = Rig(cameras={"a": RigCamera(translation_mm=np.zeros(3), **lens),
        ...                    "b": RigCamera(translation_mm=np.array([-20.0, 0, 0]), **lens)})
        >>> found = rig.intersect({"a": [[60.0, 50], [50, 50]], "b": [[40.0, 50], [30, 50]]}, 0.1)
        >>> found.distance(0, 1).length_mm.round(6).tolist(), found.rig_known
        ([10.0], False)
        """
        names = self._known(list(pixels))
        index = {name: i for i, name in enumerate(self.cameras)}
        arrays = [np.asarray(pixels[name], dtype=float) for name in names]
        shapes = {a.shape for a in arrays}
        if len(shapes) > 1 or arrays[0].ndim != 2 or arrays[0].shape[1] != 2:
            texts = ", ".join(f"{n} {a.shape}" for n, a in zip(names, arrays, strict=True))
            raise ValueError(f"pixels: expected (N, 2) for every camera, got {texts}")
        columns = np.array([index[name] for name in names])
        xy = np.full((len(arrays[0]), len(self.cameras), 2), np.nan)
        xy[:, columns] = np.stack(arrays, axis=1)
        sigma = np.ones(xy.shape[:2])
        sigma[:, columns] = np.stack([self._sigma(n, sigma_px, len(xy)) for n in names], axis=1)
        seen = np.isfinite(xy).all(axis=2)
        point, camera = np.nonzero(seen)
        variance = sigma[point, camera] ** 2
        triangulator = Triangulator(self, frame=frame)
        result = triangulator(
            np.concatenate([[0], np.cumsum(seen.sum(axis=1))]),
            camera,
            xy[point, camera],
            np.stack([variance, 0 * variance, variance], axis=1),
        )
        residual = np.full(xy.shape, np.nan)
        residual[point, camera] = result["residual_px"]
        return Intersection(
            **{name: result[name] for name in ("position_mm", "cov_image_mm2", "cov_rig_mm2")},
            residual_px={name: residual[:, index[name]] for name in names},
            chi2=result["chi2"],
            convergence_rad=result["convergence_rad"],
            status=np.asarray(result["status"], np.int32),
            cameras_used=seen,
            sigma_px=sigma,
            rig_known=self.cov is not None,
            triangulator=triangulator,
        )

    def distance(
        self,
        pixels_a: Mapping[str, npt.ArrayLike],
        pixels_b: Mapping[str, npt.ArrayLike],
        sigma_px: float | None = None,
    ) -> Distance:
        """Distances between points by the pictures of their ends, (N, 2) a camera and end.

        The ends may be seen by different cameras. The calibration's error is
        common to both ends and cancels in part: it is counted with its
        correlation, and no frame matters for it.
        """
        ends = [{k: np.asarray(v, dtype=float) for k, v in p.items()} for p in (pixels_a, pixels_b)]
        lengths = {len(v) for end in ends for v in end.values()}
        if len(lengths) != 1:
            raise ValueError("pixels_b: expected as many points as pixels_a, for every camera")
        count = lengths.pop()
        absent = np.full((count, 2), np.nan)
        names = [name for name in self.cameras if any(name in end for end in ends)]
        names += [name for end in ends for name in end if name not in self.cameras]
        together = {n: np.concatenate([end.get(n, absent) for end in ends]) for n in names}
        found = self.intersect(together, sigma_px)
        rows = np.arange(count)
        return found.distance(rows, rows + count)

    def _known(self, names: Sequence[str]) -> Sequence[str]:
        unknown = [name for name in names if name not in self.cameras]
        if unknown:
            raise ValueError(
                f"pixels: camera {unknown[0]!r} is not in the rig, which has "
                f"{', '.join(self.cameras)}"
            )
        if len(names) < 2:
            raise ValueError(f"pixels: triangulation needs two cameras or more, got {len(names)}")
        return names

    def _sigma(
        self, name: str, sigma_px: float | Mapping[str, npt.ArrayLike] | None, count: int
    ) -> FloatArray:
        if sigma_px is None:
            value: npt.ArrayLike = self.sigma_floor_px.get(name, 0.0) or _DEFAULT_SIGMA_PX
        elif isinstance(sigma_px, Mapping):
            value = sigma_px[name]
        else:
            value = sigma_px
        return np.broadcast_to(np.asarray(value, dtype=float), (count,))


def _points(points_in_world: npt.ArrayLike) -> FloatArray:
    points = np.asarray(points_in_world, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points_in_world: expected shape (N, 3), got {points.shape}")
    return points
