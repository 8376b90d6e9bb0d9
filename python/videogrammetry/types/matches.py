"""Targets that show the same points, and these points: of a stage, and of many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.types.arrays import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class Matches:
    """Targets of all cameras of one stage that show the same points.

    Attributes
    ----------
    target : (P, C) index of the target in each camera's Targets, -1 = not seen.
    id : (P,) code number or -1. chi2 : (P,) of the rays, 2n - 3 degrees of freedom.
    log_odds : (P,) that all the match's targets show one point, against all else.
    status : a camera: (N,) index into ``matching.TARGET_STATUS``.
    false_probability : (P,) that a target of the match shows another point or none;
        0 of what the user has put together, None where it was not estimated.
    """

    target: IntArray
    id: IntArray
    chi2: FloatArray
    log_odds: FloatArray
    status: tuple[npt.NDArray[np.uint8], ...]
    false_probability: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)

    def with_targets(
        self, target: IntArray, id: IntArray, status: tuple[npt.NDArray[np.uint8], ...]
    ) -> Matches:
        """The same matches with other targets; those without any are left out."""
        keep = (target >= 0).any(axis=1)
        false = self.false_probability
        return Matches(
            target=target[keep],
            id=id[keep],
            chi2=self.chi2[keep],
            log_odds=self.log_odds[keep],
            status=status,
            false_probability=None if false is None else false[keep],
        )


@dataclass(frozen=True, kw_only=True)
class FlatTargets:
    """Targets of one camera over S stages, one after another.

    Attributes
    ----------
    offsets : (S + 1,) those of stage s are ``offsets[s]:offsets[s + 1]``.
    centre_px : (M, 2). cov_px2 : (M, 3) xx, xy, yy. id : (M,) code number or -1.
    semi_major_px : (M,) 0 where unknown.
    """

    offsets: npt.NDArray[np.int64]
    centre_px: FloatArray
    cov_px2: FloatArray
    id: IntArray
    semi_major_px: FloatArray


@dataclass(frozen=True, kw_only=True)
class StageMatches:
    """Matches over S stages, one after another.

    Attributes
    ----------
    offsets : (S + 1,) those of stage s are ``offsets[s]:offsets[s + 1]``.
    target : (P, C) index within the stage's and camera's targets, -1 = not seen.
    id, chi2, log_odds, false_probability : (P,) as in :class:`Matches`.
    status : a camera: (M,) index into ``matching.TARGET_STATUS`` of all its targets.
    """

    offsets: npt.NDArray[np.int64]
    target: IntArray
    id: IntArray
    chi2: FloatArray
    log_odds: FloatArray
    false_probability: FloatArray
    status: tuple[npt.NDArray[np.uint8], ...]

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, kw_only=True)
class StagePoints:
    """The points of one stage.

    Attributes
    ----------
    id : (P,) code number or -1. target : (P, C) as in :class:`Matches`.
    position_mm : (P, 3) in the rig's frame.
    cov_image_mm2, cov_rig_mm2 : (P, 3, 3) from the image noise and from the
        calibration; their sum is the point's covariance. The calibration's is
        stated in the frame of the calibrated volume (``Triangulator``).
    rms_px : (P,) RMS residual per coordinate. chi2 : (P,).
    convergence_rad : (P,) largest angle between two rays.
    residual_px : (P, C, 2) measured - adjusted, NaN where not seen.
    normal, cov_normal : (P, 3), (P, 3, 3) of the targets' circles, towards the
        cameras; None where nothing was asked of the circles.
    eccentricity_px : (P,) the largest distance, over the cameras, from the
        picture of the circle's centre to the ellipse's; NaN where the point is
        not corrected for it, None where nothing was asked.
    """

    id: IntArray
    target: IntArray
    position_mm: FloatArray
    cov_image_mm2: FloatArray
    cov_rig_mm2: FloatArray
    rms_px: FloatArray
    chi2: FloatArray
    convergence_rad: FloatArray
    residual_px: FloatArray
    normal: FloatArray | None = None
    cov_normal: FloatArray | None = None
    eccentricity_px: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)
