"""The cameras of a rig as other programs describe them: what all their formats are written from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.calibration.conversion import (
    LensFit,
    Residual,
    fit_smallest_lens,
)
from videogrammetry.geometry import LensModel
from videogrammetry.types import FloatArray, RigData
from videogrammetry.version import __version__

#: Names of lens models, as the command takes them: kind and number of coefficients.
MODELS = {
    "opencv4": ("opencv", 4),
    "opencv5": ("opencv", 5),
    "opencv8": ("opencv", 8),
    "opencv12": ("opencv", 12),
    "opencv14": ("opencv", 14),
    "equidistant": ("equidistant", 4),
}


@dataclass(frozen=True, kw_only=True)
class LensCamera:
    """One camera in another program's terms.

    Attributes
    ----------
    lens : its model; (0, 0) is the centre of the first pixel.
    rotation, translation_mm : lens_from_world: the rig's cam_from_world, turned by
        ``roll_rad`` about the camera's z axis.
    residual : what the conversion leaves over the whole picture; None where it is not known.
    """

    name: str
    image_size_px: tuple[int, int]
    lens: LensModel
    rotation: FloatArray
    translation_mm: FloatArray
    residual: Residual | None = None
    roll_rad: float = 0.0

    @property
    def model(self) -> str:
        """Name in ``MODELS``."""
        count = len(self.lens.coefficients)
        return self.lens.kind if self.lens.kind == "equidistant" else f"opencv{count}"

    @property
    def camera_matrix(self) -> FloatArray:
        """(3, 3) OpenCV's camera matrix."""
        fx, fy = self.lens.focal_px
        cx, cy = self.lens.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def convert_rig(
    rig: RigData, models: Sequence[str], *, keep_axes: bool = False
) -> list[LensCamera]:
    """Every camera of a rig by the one of ``models`` that it needs.

    Parameters
    ----------
    models : names in ``MODELS`` that the format can hold, the smallest first. OpenCV's
        are tried until one is good enough; "equidistant" is taken if it is better.
    keep_axes : leave the cameras' axes as they are (``roll_rad`` = 0).

    Raises
    ------
    CalibrationError
        A camera's distortion folds over within its picture.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera
    >>> rig = RigData(cameras={"a": RigCamera(
    ...     image_size_px=(64, 48), interior=np.r_[100.0, np.zeros(9)], r0_px=20.0,
    ...     rotation=np.eye(3), translation_mm=np.zeros(3))})
    >>> [camera] = convert_rig(rig, ["opencv5", "opencv8"])
    >>> camera.model, camera.lens.focal_px.round(6).tolist(), camera.residual.max_px < 1e-6
    ('opencv5', [100.0, 100.0], True)
    """
    result = []
    for name, camera in rig.cameras.items():
        fits: list[LensFit] = []
        for kind in ("opencv", "equidistant"):
            counts = [MODELS[m][1] for m in models if MODELS[m][0] == kind]
            if counts:
                fits.append(fit_smallest_lens(camera, kind, counts, roll=not keep_axes))
        fit = min(fits, key=lambda f: f.residual.rms_px)
        result.append(
            LensCamera(
                name=name,
                image_size_px=camera.image_size_px,
                lens=fit.lens,
                rotation=fit.lens_from_cam @ camera.rotation,
                translation_mm=fit.lens_from_cam @ camera.translation_mm,
                residual=fit.residual,
                roll_rad=fit.roll_rad,
            )
        )
    return result


def notes(cameras: Sequence[LensCamera], lengths: str) -> list[str]:
    """What the head of every file says: units, frames, and each camera's residual."""
    lines = [
        f"videogrammetry {__version__}; lengths in {lengths}, angles in rad",
        "camera axes x right, y down, z forward; the orientation is camera from world",
    ]
    for camera in cameras:
        if camera.residual is not None:
            lines.append(
                f"{camera.name}: {camera.model} stands for the ten-parameter camera with a "
                f"residual of {camera.residual} over the whole picture"
            )
            if camera.roll_rad:
                lines.append(
                    f"{camera.name}: its axes are the rig file's, turned by "
                    f"{camera.roll_rad:.6g} rad about z (half of the shear E2)"
                )
    return lines


def numbers(values: FloatArray) -> str:
    """Numbers in full precision, joined by commas.

    Examples
    --------
    >>> numbers(np.array([1.0, -0.1, 1e-20]))
    '1.0, -0.1, 1e-20'
    """
    return ", ".join(repr(float(v)) for v in np.ravel(values))


def quaternion(rotation: FloatArray) -> FloatArray:
    """(4,) w, x, y, z of a rotation matrix, w >= 0.

    Examples
    --------
    >>> quaternion(np.diag([1.0, -1.0, -1.0])).tolist()
    [0.0, 1.0, 0.0, 0.0]
    """
    r = rotation
    # The symmetric matrix whose largest eigenvector is the quaternion (Bar-Itzhack 2000).
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0, 0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [0, 0, 0, r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    q = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    first = q[np.flatnonzero(np.abs(q) > 1e-12)[0]]
    result: FloatArray = np.where(np.abs(q) > 1e-16, q, 0.0) * np.sign(first)
    return result
