"""To which image point the stated standard deviations refer: the corrected one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.adjustment import Network
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.geometry import rays_through_pixels
from videogrammetry.types import FloatArray, RigCamera

#: Weights that change by less than this part are left as they are.
SAME_PART = 0.01
#: Step of the derivatives: far below the lens's changes, far above rounding.
_STEP_PX = 0.5


def corrected_covariances(tables: NetworkInput, network: Network) -> FloatArray:
    """(M, 3) covariances of the measured points whose corrected points have the stated ones.

    Where the distortion corrects the measured point (``distortion = "measured"``), the
    observation equation is that of the corrected one (Hu et al. 2012, Eqs. 2 and 4; so
    do PhotoModeler and DBAT): measured + d(measured) + v = projection, with v of the
    stated covariance S. For the measured point that is J^-1 S J^-T, with J = d corrected
    / d measured. J is 1 at the principal point, whatever r0 is: the corrected picture is
    taken at the scale of the measured one there. In the ideal direction the measured
    point itself is the observation, and its covariance stays.
    """
    seen = tables.observations
    cov = np.array(seen.cov_px2, dtype=float)
    camera_of = np.array([image.camera for image in tables.images])[seen.image]
    for index, camera in enumerate(tables.cameras):
        mine = camera_of == index
        if not camera.measured or not mine.any():
            continue
        jacobian = _jacobian(tables, network.camera_unknowns(index), index, seen.xy_px[mine])
        if np.abs(jacobian - np.eye(2)).max() < 0.5 * SAME_PART:
            continue
        inverse = np.linalg.inv(jacobian)
        stated = cov[mine][:, [[0, 1], [1, 2]]]
        moved = inverse @ stated @ inverse.transpose(0, 2, 1)
        cov[mine] = moved[:, (0, 0, 1), (0, 1, 1)]
    return cov


def _jacobian(
    tables: NetworkInput, values: FloatArray, index: int, pixels: FloatArray
) -> FloatArray:
    """(M, 2, 2) derivatives of the corrected picture by the measured one."""
    camera = tables.cameras[index]
    lens = RigCamera(
        image_size_px=camera.image_size_px,
        interior=values[:10],
        r0_px=camera.r0_px,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )
    # The polynomial is 0 at r0, so that the middle is scaled by what it takes off there.
    r2 = camera.r0_px**2
    middle = 1.0 - values[3] * r2 - values[4] * r2**2 - values[5] * r2**3
    y_centre = 0.5 * (camera.image_size_px[1] - 1) + values[2]
    height = 1.0 + values[10]

    def corrected(at: FloatArray) -> FloatArray:
        square = np.stack([at[:, 0], y_centre + height * (at[:, 1] - y_centre)], axis=1)
        return np.asarray(values[0] / middle * rays_through_pixels(lens, square)[:, :2])

    columns = [
        (corrected(pixels + step) - corrected(pixels - step)) / (2 * _STEP_PX)
        for step in _STEP_PX * np.eye(2)
    ]
    return np.stack(columns, axis=2)


def differ(before: FloatArray, after: FloatArray) -> bool:
    """Whether a variance changes by a part that matters."""
    return bool((np.abs(after[:, [0, 2]] / before[:, [0, 2]] - 1) > SAME_PART).any())


def with_covariances(tables: NetworkInput, cov_px2: FloatArray) -> NetworkInput:
    """The tables with other covariances of the image points."""
    return replace(tables, observations=replace(tables.observations, cov_px2=cov_px2))
