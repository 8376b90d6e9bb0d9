"""The cameras of a rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.types.arrays import FloatArray

#: Order of the ten interior parameters in every vector, matrix and file.
INTERIOR_NAMES = ("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2")


@dataclass(frozen=True, kw_only=True)
class FlatInterface:
    """A flat window between the cameras' air and a fluid: plane normal . X = distance_mm.

    Attributes
    ----------
    name : cameras that look through the same window name the same.
    normal : (3,) unit, pointing to the cameras, in the frame of the rig.
    distance_mm : of the window's face on the cameras' side from the frame's origin,
        along the normal.
    fluid_index, glass_index : refractive indices over that of air.
    glass_thickness_mm : 0 = no glass (or as thin as not to matter).
    sigma : "tilt_1", "tilt_2" (rad), "distance" (mm) -> standard deviation, where estimated.
    """

    name: str = "window"
    normal: FloatArray
    distance_mm: float
    fluid_index: float = 1.333
    glass_index: float = 1.0
    glass_thickness_mm: float = 0.0
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RigCamera:
    """One camera of a rig: interior parameters and exterior orientation.

    ``interior`` holds f, x0, y0, A1, A2, A3, B1, B2, E1, E2 (``INTERIOR_NAMES``;
    pixels) for the polynomial of the measured point (``measured`` True: the
    paper's direction) or of the ideal point. ``sigma`` maps a parameter's name
    (also ``rx, ry, rz`` in rad, ``tx, ty, tz`` in mm) to its standard deviation;
    a rotation's is of the rotation vector applied on the left of cam_from_world.
    ``interface`` is the window through which the camera looks into a fluid, if any.
    """

    image_size_px: tuple[int, int]
    interior: FloatArray
    r0_px: float
    rotation: FloatArray
    translation_mm: FloatArray
    measured: bool = True
    sigma: Mapping[str, float] = field(default_factory=dict)
    interface: FlatInterface | None = None

    @property
    def centre_mm(self) -> FloatArray:
        """(3,) projection centre in the rig's frame: -R' t.

        Examples
        --------
        >>> turned = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
        >>> camera = RigCamera(
        ...     image_size_px=(640, 480), interior=np.zeros(10), r0_px=200.0,
        ...     rotation=turned, translation_mm=np.array([-2.0, 1, -3]),
        ... )
        >>> camera.centre_mm.tolist()
        [1.0, 2.0, 3.0]
        """
        return np.asarray(-self.rotation.T @ self.translation_mm)


@dataclass(frozen=True, kw_only=True)
class RigData:
    """The cameras of a rig with their covariance: what rig.json and rig.npz hold.

    Attributes
    ----------
    cameras : name -> RigCamera, in the project's order.
    reference : the frame's origin, in words ("camera left").
    cov : (P, P) covariance of the parameters in ``cov_names`` or None.
    cov_names : "camera/parameter" for each row of ``cov``.
    sigma_floor_px : camera -> standard deviation of an image coordinate that
        adds to what the edges of a target say (lens, flatness, synchronism),
        estimated by the calibration.
    volume_mm, volume_seen : (D, 3) points of the calibrated volume, in the
        rig's frame, and (D, C) which cameras saw each during the calibration;
        None where unknown. They tell where the calibration holds, and in which
        frame the covariance of a point is stated.
    how : method, options, input hashes, version, time, statistics.
    """

    cameras: Mapping[str, RigCamera]
    reference: str = ""
    cov: FloatArray | None = None
    cov_names: tuple[str, ...] = ()
    sigma_floor_px: Mapping[str, float] = field(default_factory=dict)
    volume_mm: FloatArray | None = None
    volume_seen: npt.NDArray[np.bool_] | None = None
    how: Mapping[str, Any] = field(default_factory=dict)
