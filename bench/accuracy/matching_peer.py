"""OpenPTV's correspondences (optv), fed with the targets that ours are fed with.

Its camera looks along -z with y up; its flat coordinates are mm on the sensor.
"""

from __future__ import annotations

import time

import numpy as np

FLIP = np.diag([1.0, -1.0, -1.0])


def available():
    """Whether optv is installed; says so where it is not."""
    try:
        import optv.correspondences  # noqa: F401
    except ImportError as error:
        print(f"left out: OpenPTV ({error}); pip install optv")
        return False
    return True


def calibration(camera, pixel_mm):
    """optv's Calibration of a camera without distortion that looks through no window."""
    from optv.calibration import Calibration

    r = (FLIP @ camera.rotation).T
    f, x0, y0 = camera.interior[:3] * pixel_mm
    made = Calibration()
    made.set_pos(-camera.rotation.T @ camera.translation_mm)
    # R = Rx(omega) Ry(phi) Rz(kappa).
    made.set_angles(
        np.array([np.arctan2(-r[1, 2], r[2, 2]), np.arcsin(r[0, 2]), np.arctan2(-r[0, 1], r[0, 0])])
    )
    made.set_primary_point(np.array([x0, -y0, f]))
    made.set_radial_distortion(np.zeros(3))
    made.set_decentering(np.zeros(2))
    made.set_affine_trans(np.array([1.0, 0.0]))
    # A glass of air, behind everything.
    made.set_glass_vec(np.array([0.0, 0.0, -100000.0]))
    if np.abs(made.get_rotation_matrix() - r).max() > 1e-9:
        raise AssertionError("OpenPTV's rotation is not ours")
    return made


def control(cameras, size, pixel_mm, layers=None):
    """ControlParams; ``layers`` = (n1, n2, thickness, n3) of what the cameras look through."""
    from optv.parameters import ControlParams

    n1, n2, thickness, n3 = layers or (1.0, 1.0, 1.0, 1.0)
    return ControlParams(
        cameras,
        image_size=size,
        pixel_size=(pixel_mm, pixel_mm),
        cam_side_n=n1,
        wall_ns=[n2],
        wall_thicks=[thickness],
        object_side_n=n3,
    )


def volume(x_range, z_range, eps_mm, ratio=0.02, corrmin=33.0):
    """VolumeParams over a box; the ratios are those that its own example sets."""
    from optv.parameters import VolumeParams

    return VolumeParams(
        x_span=x_range,
        z_spans=[z_range, z_range],
        pixels_tot=ratio,
        pixels_x=ratio,
        pixels_y=ratio,
        ref_gray=ratio,
        epipolar_band=eps_mm,
        min_correlation=corrmin,
    )


def target_array(xy_px, pixels, grey):
    """TargetArray from centres (N, 2) in our pixels, counts (N, 3) n, nx, ny and grey sums."""
    from optv.tracking_framebuf import TargetArray

    array = TargetArray(len(xy_px))
    for i, target in enumerate(array):
        target.set_pos((xy_px[i, 0] + 0.5, xy_px[i, 1] + 0.5))
        target.set_pnr(i)
        target.set_tnr(-1)
        target.set_pixel_counts(*(int(v) for v in pixels[i]))
        target.set_sum_grey_value(int(grey[i]))
    return array


def match(arrays, calibrations, parameters, spans):
    """(P, C) indices into the arrays, and the time of the correspondences alone in s."""
    from optv.correspondences import MatchedCoords, correspondences

    flat = [
        MatchedCoords(array, parameters, calibration)
        for array, calibration in zip(arrays, calibrations, strict=True)
    ]
    start = time.perf_counter()
    _, numbers, _ = correspondences(arrays, flat, calibrations, spans, parameters)
    seconds = time.perf_counter() - start
    found = [np.asarray(group).reshape(len(arrays), -1).T for group in numbers]
    return np.concatenate(found) if found else np.empty((0, len(arrays)), int), seconds
