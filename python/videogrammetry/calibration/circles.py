"""The target's points as circles: whose normals are known, and which the ellipses tell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.bundle import Bundle
from videogrammetry.geometry import estimate_normals
from videogrammetry.types import FloatArray, PointSet, RigCamera

#: By how much the ellipses' diameter may differ from one that is stated for other targets.
_TOLERANCE = 0.15
#: A target whose third extent is below this share of its second is a plane.
_FLAT = 1e-3
#: A normal less sure than this, in rad, is not taken for known.
_SURE_RAD = 0.1


def complete_circles(
    bundle: Bundle, target: PointSet, diameter_mm: float | None
) -> tuple[bool, list[str]]:
    """Give the network the circles that it does not know yet, from its present poses.

    A point needs a diameter, of the target's table or else ``diameter_mm``, and a
    normal: of the table, else estimated from its ellipses in all pictures, else
    the plane's of a flat target. The normals are held in the adjustment that
    follows: errors of theirs are second to those of the pictures, for many
    pictures make them (a point whose normal stays unsure is not corrected).

    Returns
    -------
    changed : whether to adjust again. remarks : what is not corrected, and why.
    """
    n = len(target)
    diameter = np.full(n, np.nan) if target.diameter_mm is None else target.diameter_mm.copy()
    stated = np.isfinite(diameter)
    if diameter_mm is not None:
        diameter[~stated] = diameter_mm
    wanted = np.isfinite(diameter)
    known = wanted & np.isfinite(bundle.circle_normal).all(axis=1)
    missing = wanted & ~np.isfinite(bundle.circle_diameter_mm)
    if not missing.any():
        return False, []
    normal = bundle.circle_normal.copy()
    found, size = _from_ellipses(bundle, n)
    normal[~known] = found[~known]
    flat = _plane_normal(target.position_mm)
    if flat is not None:
        normal[np.isnan(normal).any(axis=1)] = flat
    remarks = []
    borrowed = ~stated & np.isfinite(size)
    if borrowed.any() and diameter_mm is not None:
        middle = float(np.median(size[borrowed]))
        if abs(middle / diameter_mm - 1) > _TOLERANCE:
            remarks.append(
                f"the calibration target's circles have {middle:.3g} mm, not the {diameter_mm:g} "
                "mm of [targets] diameter_mm: they are not corrected for eccentricity; give the "
                "target's table the columns nx, ny, nz, diameter_mm"
            )
            wanted &= stated
    # Without any ellipse nothing says that [targets] diameter_mm is the target's too.
    wanted &= stated | np.isfinite(size)
    use = wanted & np.isfinite(normal).all(axis=1)
    lacking = int((stated & ~use).sum())
    if lacking:
        remarks.append(
            f"{lacking} of the target's {n} points have a diameter but no normal, in the table or "
            "of their ellipses: they are not corrected for eccentricity"
        )
    changed = bool((use & missing).any())
    if changed:
        bundle.set_circles(normal, np.where(use, diameter, np.nan))
    return changed, remarks


def _from_ellipses(bundle: Bundle, count: int) -> tuple[FloatArray, FloatArray]:
    """Normals (N, 3) in the target's frame and diameters (N,); NaN where they are not sure."""
    normal, size = np.full((count, 3), np.nan), np.full(count, np.nan)
    used = bundle.network.used
    point, image = bundle.point_of, bundle.image_of
    ellipse = np.concatenate([p.ellipse for p in bundle.pictures])
    cov = np.concatenate([p.ellipse_cov for p in bundle.pictures])
    xy = np.concatenate([p.xy_px for p in bundle.pictures])
    seen = np.flatnonzero(used & np.isfinite(ellipse).all(axis=1))
    if not len(seen):
        return normal, size
    seen = seen[np.argsort(point[seen], kind="stable")]
    rows, first = np.unique(point[seen], return_index=True)
    estimate = estimate_normals(
        [_picture_camera(bundle, i) for i in range(len(bundle.pictures))],
        [*first, len(seen)],
        image[seen],
        np.column_stack([xy[seen], ellipse[seen]]),
        cov[seen],
        bundle.network.positions_mm[rows],
    )
    sure = np.trace(estimate.cov, axis1=1, axis2=2) < _SURE_RAD**2
    normal[rows[sure]] = estimate.normal[sure]
    size[rows] = estimate.diameter_mm
    return normal, size


def _picture_camera(bundle: Bundle, image: int) -> RigCamera:
    """The camera of a picture, oriented in the target's frame."""
    model = bundle.network.model(bundle.network_camera(image))
    rotation, translation_mm = bundle.cam_from_target(image)
    return RigCamera(
        image_size_px=(model.width_px, model.height_px),
        interior=np.array(model.interior),
        r0_px=model.r0_px,
        rotation=rotation,
        translation_mm=translation_mm,
        measured=model.measured,
    )


def _plane_normal(position_mm: FloatArray) -> FloatArray | None:
    """Normal of a flat target; None of one in space or on a line."""
    if len(position_mm) < 4:
        return None
    _, extent, axes = np.linalg.svd(position_mm - position_mm.mean(axis=0), full_matrices=False)
    if extent[1] < 1e-6 * extent[0] or extent[2] > _FLAT * extent[1]:
        return None
    plane: npt.NDArray[np.float64] = axes[2]
    return plane
