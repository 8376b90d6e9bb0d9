"""Triangulation of n views with the covariance of image noise and calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from videogrammetry._core import reconstruction as _reconstruction
from videogrammetry.geometry import full_covariance, project_from_world, rig_model
from videogrammetry.types import StagePoints

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, IntArray, Matches, RigData, Targets

# A frame has six degrees of freedom: three points fix it, more make it typical.
_MIN_FRAME_POINTS = 3

#: Why a point could not be triangulated, by its status.
TRIANGULATION_STATUS = (
    "ok",
    "fewer than two rays",
    "parallel rays",
    "behind a camera",
    "not converged",
    "no normal",
)

#: What was done about a point's circle, by its ``circle``.
CIRCLE_STATUS = ("not asked", "normal given", "normal of the ellipses", "no normal")


@dataclass(frozen=True, kw_only=True)
class Circles:
    """Circles whose ellipses were measured: what :class:`Triangulator` takes beside the centres.

    Attributes
    ----------
    diameter_mm : (P,) or one number; None or NaN: centres are not corrected.
    ellipse : (M, 3) semi-major, semi-minor axis (px) and angle (rad); None: none.
    ellipse_cov : (M, 3, 3) their covariance.
    normal : (P, 3) known unit normals, NaN rows: from the ellipses; None: all so.
    normal_cov : (P, 3, 3) of the known normals; None: exact.
    thickness_mm : the circles' height over the object: points move by this much
        against the normal that faces the cameras; 0: they stay.
    """

    diameter_mm: npt.ArrayLike | None = None
    ellipse: npt.ArrayLike | None = None
    ellipse_cov: npt.ArrayLike | None = None
    normal: npt.ArrayLike | None = None
    normal_cov: npt.ArrayLike | None = None
    thickness_mm: float = 0.0

    def arguments(self, count: int) -> tuple[FloatArray | float, ...]:
        """As the extension takes them, for ``count`` points; empty arrays for what is not known."""
        diameter = np.empty(0)
        if self.diameter_mm is not None:
            diameter = np.broadcast_to(np.asarray(self.diameter_mm, dtype=float), count)
        others = (self.ellipse, self.ellipse_cov, self.normal, self.normal_cov)
        arrays = [np.empty(0) if a is None else np.asarray(a, dtype=float) for a in others]
        return (*(np.ascontiguousarray(a) for a in (diameter, *arrays)), float(self.thickness_mm))


class Triangulator:
    """Triangulation with a rig's orientation held, prepared once for many calls.

    Least squares of the residuals in the measured pictures, weighted with
    their covariance. Two covariances a point: the image noise's,
    (J^T W J)^-1, and the calibration's, G C G^T.

    The second depends on where the frame is thought to be fixed. A calibration
    determines the cameras relative to each other; that the frame lies on the
    first camera's axes is a definition, and stated in those axes every point
    carries the uncertainty of that camera's principal point and direction,
    although it moves all points alike. With ``frame="volume"`` the rigid motion
    that an error of the calibration shares over the calibrated volume is taken
    out (inner constraints over ``rig.volume_mm``): what is left harms
    distances, shapes and motions. ``frame="rig"`` states it in the rig's axes.

    Parameters
    ----------
    rig : the cameras, with their covariance if there is one.
    frame : "volume" (falls back to "rig" where the rig knows no volume) or "rig".
    num_threads : 0 = one a core.
    """

    def __init__(self, rig: RigData, *, frame: str = "volume", num_threads: int = 1) -> None:
        if frame not in ("volume", "rig"):
            raise ValueError(f"frame: expected 'volume' or 'rig', got {frame!r}")
        self.rig = rig
        self._model = rig_model(rig)
        self._cov = full_covariance(rig)
        #: (6, 16 K) shared rotation and translation by the parameters; empty: none taken out.
        self.frame_by_parameters = self._shared_motion() if frame == "volume" else np.empty((0, 0))
        self._num_threads = num_threads

    def __call__(
        self,
        offsets: npt.ArrayLike,
        camera: npt.ArrayLike,
        xy_px: npt.ArrayLike,
        cov_px2: npt.ArrayLike,
        circles: Circles | None = None,
    ) -> Mapping[str, FloatArray]:
        """Triangulate; arguments and result as :func:`triangulate`."""
        count = max(len(np.asarray(offsets)) - 1, 0)
        result: Mapping[str, FloatArray] = _reconstruction.triangulate(
            self._model,
            np.ascontiguousarray(offsets, dtype=np.int64),
            np.ascontiguousarray(camera, dtype=np.int32),
            np.ascontiguousarray(xy_px, dtype=np.float64),
            np.ascontiguousarray(cov_px2, dtype=np.float64),
            self._cov,
            self.frame_by_parameters,
            self._num_threads,
            *(circles or Circles()).arguments(count),
        )
        return result

    def derivatives(
        self,
        position_mm: npt.ArrayLike,
        cameras_used: npt.ArrayLike,
        sigma_px: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Derivatives of given points by the cameras' parameters.

        G = -(J^T W J)^-1 J^T W A, in the frame of this triangulator
        (``frame_by_parameters``). An error of the calibration is common to all
        points and stages, so that with C the parameters' covariance
        (``geometry.full_covariance``) two points have the covariance
        G_i C G_j^T, and G C G^T is a point's ``cov_rig_mm2``.

        Parameters
        ----------
        position_mm : (P, 3) where the points lie; NaN gives NaN.
        cameras_used : (P, C) bool: which cameras saw them.
        sigma_px : (P, C), or what broadcasts to it: standard deviation of an
            image coordinate, the weights of the rays; None: all alike.

        Returns
        -------
        (P, 3, 16 C), a camera's parameters as ``geometry.CAMERA_PARAMETERS``;
        NaN where fewer than two cameras see the point or its rays do not
        determine it.
        """
        position = np.ascontiguousarray(position_mm, dtype=np.float64)
        used = np.asarray(cameras_used, dtype=bool)
        if position.ndim != 2 or position.shape[1] != 3:
            raise ValueError(f"position_mm: expected (P, 3), got {position.shape}")
        if used.shape != (len(position), len(self.rig.cameras)):
            raise ValueError(
                f"cameras_used: expected ({len(position)}, {len(self.rig.cameras)}), "
                f"got {used.shape}"
            )
        sigma = np.broadcast_to(np.asarray(1.0 if sigma_px is None else sigma_px), used.shape)
        point, camera = np.nonzero(used)
        variance = np.asarray(sigma[point, camera], dtype=float) ** 2
        derivatives: FloatArray = _reconstruction.point_derivatives(
            self._model,
            np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.int64),
            camera.astype(np.int32),
            np.stack([variance, 0 * variance, variance], axis=1),
            position,
            self.frame_by_parameters,
            self._num_threads,
        )
        return derivatives

    def _shared_motion(self) -> FloatArray:
        rig = self.rig
        if rig.cov is None or rig.volume_mm is None or rig.volume_seen is None:
            return np.empty((0, 0))
        pixels = np.stack(
            [project_from_world(c, rig.volume_mm) for c in rig.cameras.values()],
            axis=1,
        )
        seen = rig.volume_seen & np.isfinite(pixels).all(axis=2)
        point, camera = np.nonzero(seen)
        if (seen.sum(axis=1) >= 2).sum() < _MIN_FRAME_POINTS:
            return np.empty((0, 0))
        motion: FloatArray = _reconstruction.shared_frame_motion(
            self._model,
            np.concatenate([[0], np.cumsum(seen.sum(axis=1))]),
            camera.astype(np.int32),
            np.ascontiguousarray(pixels[point, camera]),
            np.tile([1.0, 0.0, 1.0], (len(point), 1)),
        )
        return motion


def triangulate(
    rig: RigData,
    offsets: npt.ArrayLike,
    camera: npt.ArrayLike,
    xy_px: npt.ArrayLike,
    cov_px2: npt.ArrayLike,
    num_threads: int = 1,
    circles: Circles | None = None,
) -> Mapping[str, FloatArray]:
    """Triangulate points from flat arrays of sightings; see :class:`Triangulator`.

    Point i has the sightings ``offsets[i]:offsets[i + 1]``.

    Parameters
    ----------
    rig : the cameras.
    offsets : (P + 1,) ascending from 0 to M.
    camera : (M,) index of the camera in the rig.
    xy_px : (M, 2) measured image points.
    cov_px2 : (M, 3) covariance xx, xy, yy.
    num_threads : 0 = one a core.
    circles : of circles the ellipses, so that positions are those of the
        circles' centres, with what the normals' uncertainty adds in
        ``cov_image_mm2``; see :class:`Circles`.

    Returns
    -------
    dict of arrays
        ``position_mm (P, 3)``, ``cov_image_mm2`` and ``cov_rig_mm2 (P, 3, 3)``,
        ``chi2 (P,)``, ``convergence_rad (P,)``, ``residual_px (M, 2)``,
        ``status (P,)`` by ``TRIANGULATION_STATUS``; NaN where it failed. With
        ``circles`` also ``normal (P, 3)`` and ``cov_normal (P, 3, 3)``,
        ``offset_px (M, 2)`` from the circle's centre to the ellipse's and
        ``circle (P,)`` by ``CIRCLE_STATUS``.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera, RigData
    >>> lens = dict(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)], r0_px=40.0,
    ...             rotation=np.eye(3))
    >>> rig = RigData(cameras={"a": RigCamera(translation_mm=np.zeros(3), **lens),
    ...                        "b": RigCamera(translation_mm=np.array([-20.0, 0, 0]), **lens)})
    >>> points = triangulate(rig, [0, 2], [0, 1], [[60.0, 50.0], [40.0, 50.0]],
    ...                      [[0.01, 0, 0.01]] * 2)
    >>> points["position_mm"].round(6).tolist()
    [[10.0, 0.0, 1000.0]]
    """
    return Triangulator(rig, num_threads=num_threads)(offsets, camera, xy_px, cov_px2, circles)


def reconstruct_stage(
    triangulator: Triangulator,
    matches: Matches,
    xy_px: Sequence[FloatArray],
    cov_px2: Sequence[FloatArray],
    targets: Sequence[Targets] | None = None,
    diameter_mm: float | None = None,
    thickness_mm: float = 0.0,
) -> StagePoints:
    """The points of a stage's matches; one array (N, 2) and (N, 3) a camera.

    With ``diameter_mm`` or ``thickness_mm`` the ellipses of ``targets`` give the
    circles' normals, and points are the circles' centres, moved by the thickness
    against the normal. Matches that cannot be triangulated are left out, with a
    thickness also those without a normal.
    """
    target: IntArray = matches.target
    seen_by = target >= 0
    place = np.flatnonzero(seen_by)
    camera = (place % target.shape[1]).astype(np.int32)
    # Of all cameras' targets, one camera's after the other.
    first = np.concatenate([[0], np.cumsum([len(xy) for xy in xy_px])])
    index = target.reshape(-1)[place] + first[camera]
    offsets = np.concatenate([[0], np.cumsum(seen_by.sum(axis=1))])
    xy = np.concatenate(xy_px).take(index, axis=0)
    cov = np.concatenate(cov_px2).take(index, axis=0)
    circles = None
    if targets is not None and len(place) and (diameter_mm is not None or thickness_mm != 0):
        ellipse = [np.column_stack([t.semi_axes_px, t.angle_rad]) for t in targets]
        circles = Circles(
            diameter_mm=diameter_mm,
            ellipse=np.concatenate(ellipse)[index],
            ellipse_cov=np.concatenate([t.cov[:, 2:, 2:] for t in targets])[index],
            thickness_mm=thickness_mm,
        )
    result = triangulator(offsets, camera, xy, cov, circles)
    residual = np.full((*target.shape, 2), np.nan)
    residual.reshape(-1, 2)[place] = result["residual_px"]
    good = result["status"] == 0
    # A slice, which copies nothing, where all went well.
    ok: slice | npt.NDArray[np.bool_] = slice(None) if good.all() else good
    return StagePoints(
        id=matches.id[ok],
        target=target[ok],
        position_mm=result["position_mm"][ok],
        cov_image_mm2=result["cov_image_mm2"][ok],
        cov_rig_mm2=result["cov_rig_mm2"][ok],
        rms_px=_rms(result["residual_px"], offsets)[ok],
        chi2=result["chi2"][ok],
        convergence_rad=result["convergence_rad"][ok],
        residual_px=residual[ok],
        **({} if circles is None else _circle_fields(result, offsets, diameter_mm)),
    )


def _rms(residual_px: FloatArray, offsets: npt.NDArray[np.int64]) -> FloatArray:
    """(P,) RMS of the coordinates of every point's sightings, one at least."""
    if len(offsets) < 2:
        return np.empty(0)
    squares = np.einsum("nk,nk->n", residual_px, residual_px)
    rms: FloatArray = np.sqrt(np.add.reduceat(squares, offsets[:-1]) / (2 * np.diff(offsets)))
    return rms


def _circle_fields(
    result: Mapping[str, FloatArray], offsets: npt.NDArray[np.int64], diameter_mm: float | None
) -> dict[str, FloatArray]:
    """What is known of the circles of the points that were triangulated."""
    ok = result["status"] == 0
    # Every match has sightings, so that no part of reduceat is empty.
    largest = np.maximum.reduceat(np.linalg.norm(result["offset_px"], axis=1), offsets[:-1])
    corrected = np.isin(result["circle"], (1, 2)) & (diameter_mm is not None)
    return {
        "normal": result["normal"][ok],
        "cov_normal": result["cov_normal"][ok],
        "eccentricity_px": np.where(corrected, largest, np.nan)[ok],
    }
