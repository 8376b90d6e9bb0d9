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

__all__ = [
    "camera_model",
    "default_r0_px",
    "nearest_rotation",
    "project",
    "project_with_jacobians",
    "rays_through_pixels",
    "rotation_from_vector",
    "vector_from_rotation",
]
