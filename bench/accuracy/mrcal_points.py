"""mrcal's calibration of one camera after the other, for calibration_peers.py.

Runs under the system's Python, where Debian installs mrcal: a request a line on stdin, an
answer a line on stdout, both JSON. The target's points are fixed in mrcal's reference frame;
every picture is a pose of its own.
"""

import json
import sys
import time

import mrcal
import numpy as np

FREE_K1_P1_P2 = "LENSMODEL_OPENCV4"


def start_pose(points, pixels, f, center):
    """A pose near enough: the direct linear transformation with known f."""
    rays = np.column_stack([(pixels - center) / f, np.ones(len(pixels))])
    homogeneous = np.column_stack([points - points.mean(axis=0), np.ones(len(points))])
    rows = []
    for h, r in zip(homogeneous, rays, strict=True):
        rows.append(np.concatenate([h, np.zeros(4), -r[0] * h]))
        rows.append(np.concatenate([np.zeros(4), h, -r[1] * h]))
    matrix = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 4)
    if (homogeneous @ matrix[2]).sum() < 0:
        matrix = -matrix
    u, s, vt = np.linalg.svd(matrix[:, :3])
    rotation = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    shift = matrix[:, 3] / s.mean()
    return np.concatenate([mrcal.r_from_R(rotation), shift - rotation @ points.mean(axis=0)])


def calibrate(camera):
    width, height = camera["size"]
    center = 0.5 * (np.array([width, height]) - 1)
    names, rows = {}, []
    views = list(zip(camera["points"], camera["pixels"], strict=True))
    for points, _ in views:
        for p in points:
            names.setdefault(tuple(p), len(names))
    points = np.array(list(names))
    poses, indices, observed = [], [], []
    for view, (own, xy) in enumerate(views):
        own, xy = np.array(own), np.array(xy)
        poses.append(start_pose(own, xy, camera["f"], center))
        for p, pixel in zip(own, xy, strict=True):
            indices.append([names[tuple(p)], 0, view])
            observed.append([*pixel, 1.0])
    rows = np.array(indices, dtype=np.int32)
    problem = {
        "intrinsics": np.array([[camera["f"], camera["f"], *center, 0.0, 0.0, 0.0, 0.0]]),
        "extrinsics_rt_fromref": np.array(poses),
        "frames_rt_toref": None,
        "points": points,
        "observations_board": None,
        "indices_frame_camintrinsics_camextrinsics": None,
        "observations_point": np.array(observed),
        "indices_point_camintrinsics_camextrinsics": rows,
        "lensmodel": FREE_K1_P1_P2,
        "imagersizes": np.array([[width, height]], dtype=np.int32),
        "Npoints_fixed": len(points),
        "point_min_range": 10.0,
        "point_max_range": 1e6,
        "do_optimize_intrinsics_core": True,
        "do_optimize_intrinsics_distortions": True,
        "do_optimize_extrinsics": True,
        "do_optimize_frames": False,
        "do_apply_outlier_rejection": False,
        "do_apply_regularization": False,
        "verbose": False,
    }
    mrcal.optimize(**problem)
    return {
        "intrinsics": problem["intrinsics"][0].tolist(),
        "poses": problem["extrinsics_rt_fromref"].tolist(),
    }


for line in sys.stdin:
    request = json.loads(line)
    began = time.perf_counter()
    cameras = [calibrate(camera) for camera in request["cameras"]]
    print(json.dumps({"cameras": cameras, "seconds": time.perf_counter() - began}), flush=True)
