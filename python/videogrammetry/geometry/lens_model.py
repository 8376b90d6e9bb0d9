"""Other programs' lenses, which distort the ideal point: OpenCV's polynomials and Kannala-Brandt.

With (x, y) = (X/Z, Y/Z) of the camera's frame, r^2 = x^2 + y^2 and the coefficients in
OpenCV's order k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y [1]:

    c   = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    x'' = c x + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
    y'' = c y + p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4

then the tilt of the sensor by tau_x, tau_y. Kannala-Brandt ("equidistant", OpenCV's and
Kalibr's fisheye) [2], with tan(theta) = r:

    x'' = x theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) / r

In both, pixel = (fx x'' + cx, fy y'' + cy), (0, 0) being the centre of the first pixel.

[1] OpenCV 4 documentation, "Camera Calibration and 3D Reconstruction".
[2] J. Kannala, S. Brandt, A generic camera model and calibration method for conventional,
    wide-angle, and fish-eye lenses, IEEE TPAMI 28 (2006) 1335-1340.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

#: Places between the centre and a pixel at which the picture must not fold over.
_STEPS_TO_FOLD = 24

FloatArray = npt.NDArray[np.float64]
LensKind = Literal["opencv", "equidistant"]

#: The numbers of coefficients that each kind can have.
NUM_COEFFICIENTS: dict[str, tuple[int, ...]] = {
    "opencv": (0, 4, 5, 8, 12, 14),
    "equidistant": (4,),
}
#: Names of OpenCV's coefficients, in its order.
OPENCV_NAMES = (
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    *("s1", "s2", "s3", "s4", "tau_x", "tau_y"),
)


@dataclass(frozen=True, kw_only=True)
class LensModel:
    """A lens as other programs describe it.

    Attributes
    ----------
    kind : "opencv" or "equidistant".
    focal_px : (2,) fx, fy. centre_px : (2,) cx, cy; (0, 0) is the first pixel's centre.
    coefficients : (0, 4, 5, 8, 12 or 14,) for "opencv", (4,) for "equidistant".
    """

    kind: LensKind
    focal_px: FloatArray
    centre_px: FloatArray
    coefficients: FloatArray

    def __post_init__(self) -> None:
        known = NUM_COEFFICIENTS.get(self.kind)
        if known is None:
            raise ValueError(f"kind: expected 'opencv' or 'equidistant', got {self.kind!r}")
        if np.shape(self.coefficients) not in [(n,) for n in known]:
            raise ValueError(
                f"coefficients: {self.kind} has {', '.join(map(str, known))} of them, got shape "
                f"{np.shape(self.coefficients)}"
            )
        if np.shape(self.focal_px) != (2,) or not np.all(np.asarray(self.focal_px) > 0):
            raise ValueError(f"focal_px: expected two positive numbers, got {self.focal_px}")


def project_lens(lens: LensModel, points_in_cam: npt.ArrayLike) -> FloatArray:
    """Pictures (N, 2) px of points (N, 3) of the camera's frame; NaN behind the camera.

    Examples
    --------
    >>> lens = LensModel(kind="opencv", focal_px=np.array([1000.0, 1000.0]),
    ...                  centre_px=np.array([50.0, 50.0]), coefficients=np.array([0.5, 0, 0, 0]))
    >>> project_lens(lens, [[0.1, 0.0, 1.0]]).round(6).tolist()
    [[150.5, 50.0]]
    """
    points = np.asarray(points_in_cam, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        ideal = np.where(points[:, 2:] > 0, points[:, :2] / points[:, 2:], np.nan)
        distort = _opencv if lens.kind == "opencv" else _equidistant
        result: FloatArray = distort(ideal, lens.coefficients) * lens.focal_px + lens.centre_px
    return result


def _opencv(ideal: FloatArray, coefficients: FloatArray) -> FloatArray:
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = np.pad(
        coefficients, (0, 14 - len(coefficients))
    )
    x, y = ideal.T
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    image = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2),
        ],
        axis=1,
    )
    return image if tau_x == 0 == tau_y else _tilted(image, tau_x, tau_y)


def _tilted(image: FloatArray, tau_x: float, tau_y: float) -> FloatArray:
    """The picture on a sensor that is turned by tau_x and tau_y (OpenCV's tilted model)."""
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    turn = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ about_x
    onto = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]])
    homogeneous = np.column_stack([image, np.ones(len(image))]) @ (onto @ turn).T
    tilted: FloatArray = homogeneous[:, :2] / homogeneous[:, 2:]
    return tilted


def _equidistant(ideal: FloatArray, coefficients: FloatArray) -> FloatArray:
    r = np.hypot(*ideal.T)
    theta = np.arctan(r)
    t2 = theta * theta
    k1, k2, k3, k4 = coefficients
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    ratio: FloatArray = np.where(r > 0, bent / np.where(r > 0, r, 1.0), 1.0)
    return ideal * ratio[:, None]


def rays_through_lens(lens: LensModel, pixels: npt.ArrayLike) -> FloatArray:
    """Directions (N, 3) = (X/Z, Y/Z, 1) of the rays through pixels (N, 2).

    Newton's method from the picture without distortion, to 1e-9 px; NaN where it
    does not get there: beyond the place where the polynomial folds over.

    Examples
    --------
    >>> lens = LensModel(kind="opencv", focal_px=np.array([1000.0, 1000.0]),
    ...                  centre_px=np.array([50.0, 50.0]), coefficients=np.array([0.5, 0, 0, 0]))
    >>> rays_through_lens(lens, [[150.5, 50.0]]).round(9).tolist()
    [[0.1, 0.0, 1.0]]
    """
    wanted = np.asarray(pixels, dtype=float)
    rays = np.column_stack([(wanted - lens.centre_px) / lens.focal_px, np.ones(len(wanted))])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(50):
            error = project_lens(lens, rays) - wanted
            if np.nanmax(np.abs(error), initial=0.0) < 1e-10:
                break
            by, determinant = _slope(lens, rays)
            rays[:, 0] -= (by[:, 1, 1] * error[:, 0] - by[:, 0, 1] * error[:, 1]) / determinant
            rays[:, 1] -= (by[:, 0, 0] * error[:, 1] - by[:, 1, 0] * error[:, 0]) / determinant
        missed = ~(np.abs(project_lens(lens, rays) - wanted).max(axis=1) < 1e-9)
        # Newton may have jumped over the fold: on the way from the centre there must be none.
        for share in np.linspace(0, 1, _STEPS_TO_FOLD):
            missed |= ~(_slope(lens, rays * [share, share, 1.0])[1] > 0)
    rays[missed] = np.nan
    return rays


def _slope(lens: LensModel, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (N, 2, 2) of the picture by X/Z and Y/Z, and their determinants (N,)."""
    step = 1e-7
    columns = [
        (project_lens(lens, rays + d) - project_lens(lens, rays - d)) / (2 * step)
        for d in step * np.eye(3)[:2]
    ]
    by = np.stack(columns, axis=-1)
    return by, by[:, 0, 0] * by[:, 1, 1] - by[:, 0, 1] * by[:, 1, 0]
