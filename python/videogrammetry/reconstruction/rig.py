"""The rig as its user meets it: load, project, triangulate."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import project
from videogrammetry.project import read_rig, write_rig
from videogrammetry.reconstruction.triangulate import triangulate
from videogrammetry.types import FloatArray, RigData

#: Standard deviation of an image coordinate where neither the caller nor the rig says one.
_DEFAULT_SIGMA_PX = 0.05


class Rig(RigData):
    """Calibrated cameras in one frame.

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
        """Pictures (N, 2) px of points (N, 3) mm in every camera; NaN where there is none."""
        points = np.asarray(points_in_world, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points_in_world: expected shape (N, 3), got {points.shape}")
        return {
            name: project(camera, points @ camera.rotation.T + camera.translation_mm)
            for name, camera in self.cameras.items()
        }

    def triangulate(
        self,
        pixels: Mapping[str, npt.ArrayLike],
        sigma_px: float | Mapping[str, npt.ArrayLike] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Points of corresponding pixels, with the covariance of noise and calibration.

        The calibration's part is stated in the frame of the calibrated volume
        (see :class:`Triangulator`).

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
        names = self._known(list(pixels))
        index = {name: i for i, name in enumerate(self.cameras)}
        stack = np.stack([np.asarray(pixels[name], dtype=float) for name in names], axis=1)
        if stack.ndim != 3 or stack.shape[2] != 2:
            raise ValueError(f"pixels: expected (N, 2) for every camera, got {stack[:, 0].shape}")
        sigma = np.stack([self._sigma(name, sigma_px, len(stack)) for name in names], axis=1)
        seen = np.isfinite(stack).all(axis=2)
        point, camera = np.nonzero(seen)
        variance = sigma[point, camera] ** 2
        result = triangulate(
            self,
            np.concatenate([[0], np.cumsum(seen.sum(axis=1))]),
            np.array([index[name] for name in names])[camera],
            stack[point, camera],
            np.stack([variance, 0 * variance, variance], axis=1),
        )
        return result["position_mm"], result["cov_image_mm2"] + result["cov_rig_mm2"]

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
