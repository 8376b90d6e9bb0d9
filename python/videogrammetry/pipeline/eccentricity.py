"""How far off the centres of ellipses may be whose circles are not known yet."""

from __future__ import annotations

import numpy as np

from videogrammetry.types import FloatArray, RigCamera, Targets


def possible_eccentricity(camera: RigCamera, targets: Targets) -> FloatArray:
    """(N, 3) covariance (xx, xy, yy) of the unknown eccentricity of circles not yet matched.

    A circle whose picture has the semi-major axis a lies at most a^2 / (2 f) from
    the ellipse's centre on the axis (sin t cos t = 1/2); which way, one picture
    does not say. Taken as a standard deviation per axis, it keeps the rays of large
    circles near the camera within the gate.
    """
    bound = targets.semi_axes_px[:, 0] ** 2 / (2 * camera.interior[0])
    return np.stack([bound**2, 0 * bound, bound**2], axis=1)
