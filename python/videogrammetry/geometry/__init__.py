"""Camera model, rigid transforms: the ten-parameter camera in both directions."""

from videogrammetry.geometry.camera import (
    camera_model,
    default_r0_px,
    nearest_rotation,
    project,
    project_with_jacobians,
    rays_through_pixels,
    rotation_from_vector,
    vector_from_rotation,
)
from videogrammetry.geometry.circle import CircleNormals, ellipse_centres, estimate_normals
from videogrammetry.geometry.lens_model import LensModel, project_lens, rays_through_lens
from videogrammetry.geometry.refraction import (
    apparent_points,
    interface_model,
    oriented_model,
    project_from_world,
    project_from_world_with_jacobians,
    rays_from_pixels,
)
from videogrammetry.geometry.rig import (
    CAMERA_PARAMETERS,
    full_covariance,
    rig_model,
    select_cameras,
)
from videogrammetry.geometry.rigid_fit import fit_rigid, fit_similarity
from videogrammetry.geometry.undistort import (
    INTERPOLATIONS,
    KEEPS,
    Interpolation,
    Keep,
    Undistortion,
    ideal_camera,
    undistort_ellipses,
    undistort_points,
    undistortion_jacobian,
)
from videogrammetry.geometry.volume import (
    MeasuringVolume,
    inside_half_spaces,
    point_nearest_to_axes,
    rotation_looking_at,
)

__all__ = [
    "CAMERA_PARAMETERS",
    "INTERPOLATIONS",
    "KEEPS",
    "CircleNormals",
    "Interpolation",
    "Keep",
    "LensModel",
    "MeasuringVolume",
    "Undistortion",
    "apparent_points",
    "camera_model",
    "default_r0_px",
    "ellipse_centres",
    "estimate_normals",
    "fit_rigid",
    "fit_similarity",
    "full_covariance",
    "ideal_camera",
    "inside_half_spaces",
    "interface_model",
    "nearest_rotation",
    "oriented_model",
    "point_nearest_to_axes",
    "project",
    "project_from_world",
    "project_from_world_with_jacobians",
    "project_lens",
    "project_with_jacobians",
    "rays_from_pixels",
    "rays_through_lens",
    "rays_through_pixels",
    "rig_model",
    "rotation_from_vector",
    "rotation_looking_at",
    "select_cameras",
    "undistort_ellipses",
    "undistort_points",
    "undistortion_jacobian",
    "vector_from_rotation",
]
