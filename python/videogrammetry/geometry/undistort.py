"""Pictures and image points as an ideal camera would have taken them.

The ideal camera stands where the real one does and has its principal distance; its
picture of a point is (f X/Z, f Y/Z) from the principal point, so that straight
lines are straight. Its pixels are the real one's: no scale, shift or turn is put
in between, but whole pixels where the picture is cropped or extended.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from videogrammetry._core import geometry as _geometry
from videogrammetry.errors import VideogrammetryError
from videogrammetry.geometry.camera import project, rays_through_pixels
from videogrammetry.types import FloatArray, RigCamera

Keep = Literal["size", "all", "valid"]
Interpolation = Literal["linear", "cubic", "lanczos"]

KEEPS: tuple[Keep, ...] = get_args(Keep)
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)

#: An undistorted picture may have this many times the pixels of the real one.
_LARGEST_RATIO = 16
_HALF = 0.5 + 1e-6
#: Points of an ellipse's outline that go through the lens.
_OUTLINE = 16


def ideal_camera(camera: RigCamera, keep: Keep = "size") -> RigCamera:
    """The camera without distortion that stands for ``camera``; orientation and f are the same.

    It has no standard deviations: what is not known of the distortion stays in the
    undistorted picture, and f, x0 and y0 are correlated with it.

    Parameters
    ----------
    keep : "size": the picture's size and principal point stay. "all": as large as
        needed for every pixel of the real picture. "valid": the largest picture,
        found from the edges, in which every pixel has been seen.

    Raises
    ------
    ValueError
        ``keep`` is none of these.
    VideogrammetryError
        The distortion folds over within the picture, or nothing would be left of it.

    Examples
    --------
    >>> cam = RigCamera(image_size_px=(640, 480), interior=np.array(
    ...     [1000.0, 3, -2, 4e-8, 0, 0, 0, 0, 0, 0]), r0_px=0.0, rotation=np.eye(3),
    ...     translation_mm=np.zeros(3))
    >>> for keep in KEEPS:
    ...     print(keep, ideal_camera(cam, keep).image_size_px)
    size (640, 480)
    all (646, 484)
    valid (642, 480)
    """
    if keep not in KEEPS:
        raise ValueError(f"keep: expected one of {', '.join(KEEPS)}, got {keep!r}")
    same = _pinhole(camera, (0, 0), camera.image_size_px)
    if keep == "size":
        return same
    left, top, right, bottom = _edges(camera, same)
    # Rounding of the edges must not cost or add a row: 1e-6 px.
    if keep == "all":
        low = np.floor([left.min() + _HALF, top.min() + _HALF])
        high = np.ceil([right.max() - _HALF, bottom.max() - _HALF])
    else:  # the curved edges lie outside this rectangle, so that all of it is within them
        low = np.ceil([left.max() + 0.5 - 1e-6, top.max() + 0.5 - 1e-6])
        high = np.floor([right.min() - 0.5 + 1e-6, bottom.min() - 0.5 + 1e-6])
    size = (high - low).astype(int) + 1
    if size.min() < 2 or np.prod(size) > _LARGEST_RATIO * np.prod(camera.image_size_px):
        raise VideogrammetryError(
            f"the picture without distortion would have {size[0]} x {size[1]} px, the real one has "
            f"{camera.image_size_px[0]} x {camera.image_size_px[1]}: the distortion is not that of "
            "a lens at the picture's edges; keep its size, or calibrate up to the corners"
        )
    return _pinhole(camera, (int(low[0]), int(low[1])), (int(size[0]), int(size[1])))


def _pinhole(
    camera: RigCamera, corner_px: tuple[int, int], image_size_px: tuple[int, int]
) -> RigCamera:
    """Without distortion; ``corner_px`` is its first pixel in the real camera's pixels."""
    change = 0.5 * (np.array(camera.image_size_px) - np.array(image_size_px)) - corner_px
    interior = np.zeros(10)
    interior[0] = camera.interior[0]
    interior[1:3] = camera.interior[1:3] + change
    return dataclasses.replace(
        camera,
        image_size_px=image_size_px,
        interior=interior,
        sigma={},
    )


def _edges(
    camera: RigCamera, ideal: RigCamera
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """x of the left edge, y of the top, x of the right, y of the bottom, without distortion.

    The picture's edges, half a pixel outside its outermost centres, at every pixel.
    """
    width, height = camera.image_size_px
    across, down = np.arange(2 * width + 1) / 2 - 0.5, np.arange(2 * height + 1) / 2 - 0.5
    sides = [
        np.stack(np.broadcast_arrays(x, y), axis=-1)
        for x, y in ((-0.5, down), (across, -0.5), (width - 0.5, down), (across, height - 0.5))
    ]
    result = [undistort_points(camera, side, ideal=ideal)[0] for side in sides]
    for side, points in zip(sides, result, strict=True):
        back = project(camera, rays_through_pixels(ideal, points))
        if not np.allclose(back, side, rtol=0, atol=1e-6):
            raise VideogrammetryError(
                "the distortion folds over within the picture: a pixel of the ideal camera would "
                "have two places in the real picture; calibrate with fewer free parameters (A3, "
                "A2), or with targets up to the corners"
            )
    return result[0][:, 0], result[1][:, 1], result[2][:, 0], result[3][:, 1]


def undistort_points(
    camera: RigCamera,
    xy_px: npt.ArrayLike,
    cov_px2: npt.ArrayLike | None = None,
    *,
    ideal: RigCamera | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Image points as the ideal camera would have taken them, with their covariance.

    u = p' + (1 + dd/dx)(x - p) to first order: cov_u = J cov J', J = d u / d x. The
    camera's own covariance is not in it: it is common to all points of a picture.

    Parameters
    ----------
    xy_px : (N, 2). cov_px2 : (N, 2, 2), or None for zero.
    ideal : None: ``ideal_camera(camera)``, with the same principal point.

    Returns
    -------
    (N, 2) and (N, 2, 2); NaN where the distortion cannot be undone.

    Examples
    --------
    >>> cam = RigCamera(image_size_px=(101, 101), interior=np.array(
    ...     [1000.0, 0, 0, 1e-6, 0, 0, 0, 0, 0, 0]), r0_px=0.0, rotation=np.eye(3),
    ...     translation_mm=np.zeros(3))
    >>> xy, cov = undistort_points(cam, [[150.0, 50.0]], 0.01 * np.eye(2)[None])
    >>> xy.round(9).tolist(), cov.round(9).tolist()
    ([[151.0, 50.0]], [[[0.010609, 0.0], [0.0, 0.010201]]])
    """
    pixels = np.ascontiguousarray(xy_px, dtype=float)
    target = _pinhole(camera, (0, 0), camera.image_size_px) if ideal is None else ideal
    places = project(target, rays_through_pixels(camera, pixels))
    jacobian = undistortion_jacobian(camera, pixels, target)
    if cov_px2 is None:
        return places, np.zeros((len(pixels), 2, 2))
    cov = np.asarray(cov_px2, dtype=float)
    if cov.shape != (len(pixels), 2, 2):
        raise ValueError(f"cov_px2: expected shape ({len(pixels)}, 2, 2), got {cov.shape}")
    return places, jacobian @ cov @ jacobian.transpose(0, 2, 1)


def undistortion_jacobian(camera: RigCamera, xy_px: npt.ArrayLike, ideal: RigCamera) -> FloatArray:
    """(N, 2, 2) derivative of the ideal camera's pixel by the real camera's.

    By central differences over a tenth of a pixel: exact to 1e-9 for polynomials
    as smooth as a lens'.
    """
    pixels = np.asarray(xy_px, dtype=float)
    step = 0.05
    columns = [
        project(ideal, rays_through_pixels(camera, pixels + d))
        - project(ideal, rays_through_pixels(camera, pixels - d))
        for d in step * np.eye(2)
    ]
    jacobian: FloatArray = np.stack(columns, axis=-1) / (2 * step)
    return jacobian


def undistort_ellipses(
    camera: RigCamera,
    centre_px: npt.ArrayLike,
    semi_axes_px: npt.ArrayLike,
    angle_rad: npt.ArrayLike,
    *,
    ideal: RigCamera | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ellipses as the ideal camera would have shown them: centres, semi-axes, angles.

    The lens' curve bends an ellipse's outline: its centre is not where the lens maps the
    centre (0.03 px for a dot of 18 px near a corner with the strongest lenses). Points of
    the outline go through the lens; with J the derivative at the centre they lie, in the
    frame in which J would make them the unit circle, at the radius rho(t), and the centre
    is at 2/n sum (rho - 1) (cos t, sin t): the least-squares circle to first order.
    Axes and angle are those of J times the ellipse.

    Parameters
    ----------
    centre_px, semi_axes_px : (N, 2). angle_rad : (N,) from x towards y.
    ideal : as for :func:`undistort_points`.

    Returns
    -------
    (N, 2), (N, 2) and (N,), the angle in [0, pi).

    Examples
    --------
    >>> cam = RigCamera(image_size_px=(101, 101), interior=np.array(
    ...     [1000.0, 0, 0, 0, 0, 0, 0, 0, 0.02, 0]), r0_px=0.0, rotation=np.eye(3),
    ...     translation_mm=np.zeros(3))
    >>> centre, axes, angle = undistort_ellipses(cam, [[60.0, 50.0]], [[5.0, 5.0]], [0.3])
    >>> centre.round(9).tolist(), axes.round(9).tolist(), angle.round(9).tolist()
    ([[60.2, 50.0]], [[5.1, 5.0]], [0.0])
    """
    centre = np.ascontiguousarray(centre_px, dtype=float)
    semi_axes, angle = np.asarray(semi_axes_px, dtype=float), np.asarray(angle_rad, dtype=float)
    if not len(centre):
        return centre, semi_axes, angle
    target = _pinhole(camera, (0, 0), camera.image_size_px) if ideal is None else ideal
    places, _ = undistort_points(camera, centre, ideal=target)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    half = turn * semi_axes[:, None, :]
    t = np.arange(_OUTLINE) * (2 * np.pi / _OUTLINE)
    circle = np.stack([np.cos(t), np.sin(t)], axis=1)
    outline = centre[:, None, :] + circle @ half.transpose(0, 2, 1)
    bent, _ = undistort_points(camera, outline.reshape(-1, 2), ideal=target)
    frame = undistortion_jacobian(camera, centre, target) @ half
    values, vectors = np.linalg.eigh(np.nan_to_num(frame @ frame.transpose(0, 2, 1)))
    off = bent.reshape(outline.shape) - places[:, None, :]
    rho = np.linalg.norm(
        np.einsum("nij,nkj->nki", np.linalg.pinv(np.nan_to_num(frame)), off), axis=2
    )
    shift = 2 * np.mean((rho - 1)[:, :, None] * circle, axis=1)
    major = vectors[:, :, 1]
    new_angle = np.arctan2(major[:, 1], major[:, 0]) % np.pi
    return (
        places + np.einsum("nij,nj->ni", frame, shift),
        np.sqrt(values[:, ::-1]),
        np.where(np.abs(new_angle - np.pi) < 1e-15, 0.0, new_angle),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Undistortion:
    """Turns pictures of one camera into those of the ideal one; the map is made once.

    Parameters
    ----------
    camera, ideal : the real camera and the one without distortion (``ideal_camera``).
    interpolation : "linear" (2 x 2 samples), "cubic" (4 x 4, Keys 1981) or "lanczos"
        (6 x 6, the best for measuring: docs/how-to/exchange.md).
    fill : grey value of pixels that the real camera has not seen.
    num_threads : 0: one a core.

    Examples
    --------
    >>> cam = RigCamera(image_size_px=(64, 48), interior=np.array(
    ...     [100.0, 0, 0, 1e-5, 0, 0, 0, 0, 0, 0]), r0_px=0.0, rotation=np.eye(3),
    ...     translation_mm=np.zeros(3))
    >>> undistort = Undistortion(camera=cam, ideal=ideal_camera(cam, "valid"))
    >>> picture = undistort(np.full((48, 64), 200, np.uint8))
    >>> picture.shape, picture.dtype, int(picture.min())
    ((48, 64), dtype('uint8'), 200)
    """

    camera: RigCamera
    ideal: RigCamera
    interpolation: Interpolation = "lanczos"
    fill: int = 0
    num_threads: int = 0

    def __post_init__(self) -> None:
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"interpolation: expected one of {', '.join(INTERPOLATIONS)}, got "
                f"{self.interpolation!r}"
            )

    @cached_property
    def map_px(self) -> FloatArray:
        """(h, w, 2) place in the real picture of every pixel of the ideal one; NaN: none."""
        width, height = self.ideal.image_size_px
        x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
        places = project(self.camera, rays_through_pixels(self.ideal, pixels))
        return np.ascontiguousarray(places.reshape(height, width, 2))

    def __call__(self, image: npt.NDArray[Any], largest: int | None = None) -> npt.NDArray[Any]:
        """The picture (h, w) of the ideal camera, of the same type.

        Parameters
        ----------
        image : (height, width), uint8 or uint16, of the real camera's size.
        largest : largest grey value (a 12-bit camera's 4095); None: the type's. The
            better interpolations overshoot at edges and are cut off there.

        Raises
        ------
        ValueError
            Another size or type.
        """
        picture = np.ascontiguousarray(image)
        width, height = self.camera.image_size_px
        if picture.shape != (height, width) or picture.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"image: expected ({height}, {width}) uint8 or uint16, the camera's, got "
                f"{picture.shape} {picture.dtype}"
            )
        most = int(np.iinfo(picture.dtype).max) if largest is None else largest
        kernel = getattr(_geometry.Interpolation, self.interpolation)
        result: npt.NDArray[Any] = _geometry.remap(
            picture, self.map_px, kernel, self.fill, most, self.num_threads
        )
        return result
