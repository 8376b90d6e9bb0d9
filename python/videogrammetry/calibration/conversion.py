"""Conversion between the ten-parameter camera and other programs' lenses, with its residual.

The ten parameters correct the *measured* point (or distort the ideal one, in the
other direction); OpenCV, ROS, Kalibr, COLMAP and mrcal distort the *ideal* point.
Neither polynomial is the other's inverse, so one is fitted to the other: least
squares over a grid of the whole picture, of the distances in pixels. Both models
have one projection centre, so that the residual does not depend on depth.

The ten parameters hold a shear (E2), which no other model here has. Half of it is
a turn of the camera about its axis: this turn (``roll``) is fitted too, and the
exported orientation contains it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import (
    LensModel,
    default_r0_px,
    project,
    project_lens,
    project_with_jacobians,
    rays_through_lens,
    rays_through_pixels,
    rotation_from_vector,
)
from videogrammetry.geometry.lens_model import LensKind
from videogrammetry.types import FloatArray, RigCamera

#: Points of the grid along the longer side: for the fit, and for what is stated.
_FIT_POINTS, _STATED_POINTS = 25, 129
#: Largest residual, in px, at which no model with more coefficients is tried.
ENOUGH_PX = 0.005
#: A model with more coefficients is worth it if it makes the RMS smaller than this share.
_WORTH = 0.9
#: Weight of the effect at the picture's corner (px) of k4 and those after it: keeps numerator
#: and denominator, and prism and tilt, from growing against each other without end.
_RIDGE = 1e-3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Residual:
    """What a conversion leaves: distances of the two pictures of a ray, over the whole picture."""

    rms_px: float
    max_px: float

    def __str__(self) -> str:
        return f"RMS {self.rms_px:.2g} px, largest {self.max_px:.2g} px"


@dataclasses.dataclass(frozen=True, kw_only=True)
class LensFit:
    """A lens of another program that stands for a camera.

    ``roll_rad``: its frame is the camera's, turned about z: x_in_lens = Rz(roll) x_in_cam.
    """

    lens: LensModel
    roll_rad: float
    residual: Residual

    @property
    def lens_from_cam(self) -> FloatArray:
        """(3, 3) rotation."""
        return rotation_from_vector([0.0, 0.0, self.roll_rad])


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraFit:
    """A ten-parameter camera (without orientation) that stands for another program's lens.

    ``roll_rad``: x_in_cam = Rz(roll) x_in_lens, 0 but for lenses with a tilt.
    """

    camera: RigCamera
    residual: Residual
    roll_rad: float = 0.0

    @property
    def cam_from_lens(self) -> FloatArray:
        """(3, 3) rotation."""
        return rotation_from_vector([0.0, 0.0, self.roll_rad])


def picture_grid(image_size_px: tuple[int, int], num_points: int) -> FloatArray:
    """Pixels (N, 2) of a grid from edge to edge of a picture, ``num_points`` on the longer side.

    Examples
    --------
    >>> picture_grid((4, 2), 3).tolist()
    [[-0.5, -0.5], [1.5, -0.5], [3.5, -0.5], [-0.5, 1.5], [1.5, 1.5], [3.5, 1.5]]
    """
    longest = max(image_size_px)
    counts = [max(2, round(num_points * side / longest)) for side in image_size_px]
    x, y = (np.linspace(-0.5, s - 0.5, n) for s, n in zip(image_size_px, counts, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def lens_residual(camera: RigCamera, lens: LensModel, roll_rad: float = 0.0) -> Residual:
    """Distances between a camera's pixels and the pictures that a lens gives of their rays."""
    pixels, rays = _rays_of_picture(camera, _STATED_POINTS)
    return _residual(project_lens(lens, _turned(rays, roll_rad)) - pixels)


def fit_lens(
    camera: RigCamera, kind: LensKind, num_coefficients: int, *, roll: bool = True
) -> LensFit:
    """The lens of another program that is nearest to a camera.

    Minimises the sum of squared distances, in px, between the pixels of a grid
    and the pictures that the lens gives of their rays.

    Parameters
    ----------
    kind, num_coefficients : see :class:`~videogrammetry.geometry.LensModel`.
    roll : whether the lens' frame may be turned about its axis (see the module).

    Raises
    ------
    CalibrationError
        The camera's distortion folds over within its picture, or nothing fits.
    """
    values = _start(camera)
    # The models contain each other: a larger one is begun where the smallest has ended.
    for count in dict.fromkeys((min(4, num_coefficients), num_coefficients)):
        values = _fit_from(camera, kind, count, values, roll)
    return _lens_fit(camera, kind, values)


def fit_smallest_lens(
    camera: RigCamera, kind: LensKind, counts: Sequence[int], *, roll: bool = True
) -> LensFit:
    """The lens with the fewest coefficients that does as well as one with more.

    The first of ``counts`` whose largest residual is below 0.005 px (a tenth of a
    good target's standard deviation); if there is none, the first one whose RMS the
    best undercuts by less than a tenth.
    """
    fits: list[LensFit] = []
    values = _start(camera)
    for count in counts:
        values = _fit_from(camera, kind, count, values, roll)
        fits.append(_lens_fit(camera, kind, values))
        if fits[-1].residual.max_px <= ENOUGH_PX:
            return fits[-1]
    best = min(fit.residual.rms_px for fit in fits)
    return next(fit for fit in fits if _WORTH * fit.residual.rms_px <= best)


def _start(camera: RigCamera) -> FloatArray:
    """fx, fy, cx, cy, roll of the camera without distortion."""
    f, x0, y0 = camera.interior[:3]
    width, height = camera.image_size_px
    return np.array([f, f, x0 + 0.5 * (width - 1), y0 + 0.5 * (height - 1), 0.0])


def _fit_from(
    camera: RigCamera, kind: LensKind, count: int, values: FloatArray, roll: bool
) -> FloatArray:
    """fx, fy, cx, cy, roll, coefficients, begun at those of a smaller model."""
    error = _lens_error(kind, *_rays_of_picture(camera, _FIT_POINTS), roll)
    begin = np.concatenate([values, np.zeros(count + 5 - len(values))])
    fits = [
        least_squares(error, start, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12)
        for start in _starts(begin, count)
    ]
    best: FloatArray = min(fits, key=lambda fit: float(fit.cost)).x
    if not roll:
        best[4] = 0.0
    return best


def _lens_fit(camera: RigCamera, kind: LensKind, values: FloatArray) -> LensFit:
    lens, roll = _lens(kind, values), float(values[4])
    return LensFit(lens=lens, roll_rad=roll, residual=lens_residual(camera, lens, roll))


def camera_of_lens(
    lens: LensModel,
    image_size_px: tuple[int, int],
    *,
    measured: bool | None = None,
    r0_px: float | None = None,
) -> CameraFit:
    """The ten-parameter camera of another program's lens; its frame is the lens' own.

    A tilt shears the picture along its diagonals; E2 shears it along a row, so that
    the camera of a tilted lens is turned about its axis (``roll_rad``).

    Parameters
    ----------
    measured : direction of the distortion. None: that of the ideal point where the
        lens is a ten-parameter camera exactly (OpenCV's k1, k2, p1, p2, k3 with
        fx = fy), else that of the measured point, fitted.
    r0_px : None: 0 for an exact conversion, else 2/3 of the half diagonal.

    Raises
    ------
    CalibrationError
        The lens folds over within the picture, or the fit failed.

    Notes
    -----
    With r0 = 0, A1 = k1/f^2, A2 = k2/f^4, A3 = k3/f^6, B1 = p2/f, B2 = p1/f: the
    names of the tangential terms are crossed.
    """
    exact = _exact_camera(lens, image_size_px)
    if exact is not None and measured is not True and not r0_px:
        pixels = picture_grid(image_size_px, _STATED_POINTS)
        rays = _lens_rays(lens, pixels)
        return CameraFit(camera=exact, residual=_residual(project(exact, rays) - pixels))
    r0 = default_r0_px(image_size_px) if r0_px is None else r0_px
    return _fit_camera(lens, image_size_px, measured is not False, r0)


def _exact_camera(lens: LensModel, image_size_px: tuple[int, int]) -> RigCamera | None:
    k = np.pad(lens.coefficients, (0, max(0, 5 - len(lens.coefficients))))
    if lens.kind != "opencv" or lens.focal_px[0] != lens.focal_px[1] or np.any(k[5:]):
        return None
    f = float(lens.focal_px[0])
    k1, k2, p1, p2, k3 = k[:5]
    x0, y0 = lens.centre_px - 0.5 * (np.array(image_size_px) - 1)
    return _camera(
        image_size_px,
        np.array([f, x0, y0, k1 / f**2, k2 / f**4, k3 / f**6, p2 / f, p1 / f, 0.0, 0.0]),
        0.0,
        measured=False,
    )


def _fit_camera(
    lens: LensModel, image_size_px: tuple[int, int], measured: bool, r0_px: float
) -> CameraFit:
    pixels = picture_grid(image_size_px, _FIT_POINTS)
    rays = _lens_rays(lens, pixels)
    fx, fy = lens.focal_px
    x0, y0 = lens.centre_px - 0.5 * (np.array(image_size_px) - 1)
    # In units of their effect at 2/3 of the half diagonal: steps of one size.
    scale = default_r0_px(image_size_px) ** -np.array([0, 0, 0, 2, 4, 6, 1, 1, 0, 0], dtype=float)

    tilted = bool(np.any(lens.coefficients[12:]))

    def camera(values: FloatArray) -> RigCamera:
        return _camera(image_size_px, values[:10] * scale, r0_px, measured=measured)

    def error(values: FloatArray, /, *_: Any, **__: Any) -> FloatArray:
        seen = project(camera(values), _turned(rays, values[10]))
        held = 0.0 if tilted else values[10]
        return np.append(np.nan_to_num((seen - pixels).ravel(), nan=1e3), held)

    def slope(values: FloatArray, /, *_: Any, **__: Any) -> FloatArray:
        turned = _turned(rays, values[10])
        by_point, by_interior = project_with_jacobians(camera(values), turned)[1:]
        by_roll = -by_point[:, :, 0] * turned[:, 1:2] + by_point[:, :, 1] * turned[:, :1]
        matrix = np.zeros((2 * len(rays) + 1, 11))
        matrix[:-1, :10] = by_interior.reshape(-1, 10) * scale
        matrix[:-1, 10] = by_roll.ravel()
        if not tilted:
            matrix[:, 10], matrix[-1, 10] = 0.0, 1.0
        finite: FloatArray = np.nan_to_num(matrix)
        return finite

    # x + E1 x = f X/Z of the measured direction is fx = f / (1 + E1), fy = f.
    stretch = fy / fx - 1 if measured else fx / fy - 1
    start = np.array([fy, x0, y0, 0, 0, 0, 0, 0, stretch, 0, 0])
    found = least_squares(error, start, jac=slope, method="lm", x_scale="jac", xtol=1e-14)
    result, roll = camera(found.x), float(found.x[10]) if tilted else 0.0
    pixels = picture_grid(image_size_px, _STATED_POINTS)
    seen = project(result, _turned(_lens_rays(lens, pixels), roll))
    return CameraFit(camera=result, residual=_residual(seen - pixels), roll_rad=roll)


def _camera(
    image_size_px: tuple[int, int], interior: FloatArray, r0_px: float, *, measured: bool
) -> RigCamera:
    return RigCamera(
        image_size_px=image_size_px,
        interior=interior,
        r0_px=r0_px,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
        measured=measured,
    )


def _starts(values: FloatArray, count: int) -> list[FloatArray]:
    """Where a fit begins; a tilt squeezes the picture at either sign, along either diagonal."""
    if count < 14:
        return [values]
    tilts = [(0.0, 0.0), *((a, b) for a in (-0.05, 0.05) for b in (-0.05, 0.05))]
    return [np.concatenate([values[:17], tilt]) for tilt in tilts]


def _lens_error(
    kind: LensKind, pixels: FloatArray, rays: FloatArray, roll: bool
) -> Callable[[FloatArray], FloatArray]:
    """Residuals as a function of fx, fy, cx, cy, roll and the coefficients."""
    far = float(np.max(np.hypot(rays[:, 0], rays[:, 1])))

    def error(values: FloatArray) -> FloatArray:
        angle = values[4] if roll else 0.0
        seen = project_lens(_lens(kind, values), _turned(rays, angle)) - pixels
        effect = values[0] * values[10:] * far ** _POWERS[: max(0, len(values) - 10)]
        held = 0.0 if roll else values[4]
        return np.concatenate([np.nan_to_num(seen.ravel(), nan=1e3), _RIDGE * effect, [held]])

    return error


#: Power of r with which k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y move the picture.
_POWERS = np.array([3, 5, 7, 2, 4, 2, 4, 2, 2])


def _lens(kind: LensKind, values: FloatArray) -> LensModel:
    return LensModel(
        kind=kind,
        # A step of the fit may leave the range; what it gives there is far off anyway.
        focal_px=np.maximum(values[:2], 1e-3),
        centre_px=values[2:4],
        coefficients=values[5:],
    )


def _turned(rays: FloatArray, roll_rad: float) -> FloatArray:
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    x, y, z = rays.T
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def _rays_of_picture(camera: RigCamera, num_points: int) -> tuple[FloatArray, FloatArray]:
    pixels = picture_grid(camera.image_size_px, num_points)
    rays = rays_through_pixels(camera, pixels)
    back = project(camera, rays)
    if not np.allclose(back, pixels, rtol=0, atol=1e-6):
        bad = pixels[~(np.abs(back - pixels).max(axis=1) < 1e-6)][0]
        raise CalibrationError(
            f"the camera's distortion folds over within the picture (at {bad[0]:.0f}, "
            f"{bad[1]:.0f} px), so no other model can stand for it; calibrate with fewer free "
            "parameters (A3, A2), or with targets up to the picture's corners"
        )
    return pixels, rays


def _lens_rays(lens: LensModel, pixels: FloatArray) -> FloatArray:
    rays = rays_through_lens(lens, pixels)
    missing = np.isnan(rays[:, 0])
    if missing.any():
        bad = pixels[missing][0]
        raise CalibrationError(
            f"the lens' distortion folds over within the picture (at {bad[0]:.0f}, {bad[1]:.0f} "
            "px): coefficients and image size do not belong together, or the order of the "
            "coefficients is another one"
        )
    return rays


def _residual(difference_px: FloatArray) -> Residual:
    distance = np.hypot(*difference_px.T)
    if not np.isfinite(distance).all():
        raise CalibrationError(
            "the fitted model has no picture of some rays of the camera; ask for a model with "
            "fewer or more coefficients"
        )
    return Residual(rms_px=float(np.sqrt(np.mean(distance**2))), max_px=float(distance.max()))
