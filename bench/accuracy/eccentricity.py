"""What the eccentricity of circles' pictures does, and what is left of it once modelled.

    .venv/bin/python bench/accuracy/eccentricity.py [--draws 10]

Ellipses come from a path of their own: 180 points of every rim are projected and an
ellipse is fitted to them by least squared distances; the model's closed form has no
part in them.

1. Offsets in px: that path, the exact model, d^2 / (4 f) sin t cos t (the size on the
   axis, t the tilt against the picture's plane), and the conic without the lens' curve.
2. Calibration and points, with and without the correction, without noise and with 0.005 px.
3. The same from rendered pictures: recognised, matched, measured.
4. Time a point.
"""

from __future__ import annotations

import argparse
import dataclasses
import time

import numpy as np

from videogrammetry.calibration import (
    CalibrationOptions,
    CameraFrames,
    FrameTargets,
    calibrate,
)
from videogrammetry.geometry import ellipse_centres, project, rotation_from_vector
from videogrammetry.pipeline.chunk import CameraTargets, measure_targets
from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.reconstruction import Circles, Triangulator, triangulate
from videogrammetry.rendering import Renderer, SceneTargets, Sensor
from videogrammetry.types import INTERIOR_NAMES, PointSet, RigCamera, RigData

RIM = 180
NOISE_PX = 0.005
FREE = ("f", "x0", "y0", "A1", "B1", "B2")


def rim_ellipses(camera, centre_in_cam, normal_in_cam, diameter_mm):
    """(N, 2) centres and (N, 3) axes and angle of ellipses fitted to projected rims."""
    n = np.asarray(normal_in_cam)
    u = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    t = 2 * np.pi * np.arange(RIM) / RIM
    across = np.cos(t)[:, None, None] * u + np.sin(t)[:, None, None] * np.cross(n, u)
    rim = centre_in_cam + 0.5 * np.asarray(diameter_mm)[..., None] * across
    p = project(camera, rim.reshape(-1, 3)).reshape(RIM, -1, 2).transpose(1, 0, 2)
    centre = p.mean(axis=1)
    wave = np.stack([np.cos(t), np.sin(t)], axis=1)
    axes = 2 * np.einsum("nki,kj->nij", p, wave) / RIM
    for _ in range(12):
        inverse = np.linalg.inv(axes)
        q = np.einsum("nij,nkj->nki", inverse, p - centre[:, None])
        length = np.linalg.norm(q, axis=2)
        e = q / length[..., None]
        w = 1 / np.linalg.norm(np.einsum("nki,nij->nkj", e, inverse), axis=2)
        rows = np.stack([e[..., 0], e[..., 1], e[..., 0] ** 2, e[..., 0] * e[..., 1],
                         e[..., 1] ** 2], axis=2) * w[..., None]  # fmt: skip
        right = np.einsum("nki,nk->ni", rows, w * (length - 1))
        s = np.linalg.solve(rows.transpose(0, 2, 1) @ rows, right[..., None])[..., 0]
        centre = centre + np.einsum("nij,nj->ni", axes, s[:, :2])
        shape = np.stack([1 + s[:, 2], s[:, 3] / 2, s[:, 3] / 2, 1 + s[:, 4]], axis=1)
        axes = axes @ shape.reshape(-1, 2, 2)
    left, size, _ = np.linalg.svd(axes)
    angle = np.arctan2(left[:, 1, 0], left[:, 0, 0]) % np.pi
    return centre, np.column_stack([size, angle])


def ellipse_covariance(ellipse, sigma_px):
    """(N, 3, 3) of axes and angle, for edges of that many px at the centre."""
    a, b = ellipse[:, 0], ellipse[:, 1]
    turn = np.minimum(sigma_px * (a + b) / 2 / np.maximum(a**2 - b**2, 1e-9), 0.5)
    cov = np.zeros((len(a), 3, 3))
    cov[:, 0, 0] = cov[:, 1, 1] = sigma_px**2
    cov[:, 2, 2] = turn**2
    return cov


def lens(f_px, distorted=True):
    interior = np.r_[f_px, np.zeros(9)]
    if distorted:  # of the size of the paper's Table 1
        interior[1:8] = -40, 30, 1.2e-8, 0, 0, 2e-7, -7e-7
    return RigCamera(
        image_size_px=(1024, 1024),
        interior=interior,
        r0_px=400.0,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )


def offsets():
    print("1. Offset of the ellipse's centre, px (the tilt turns away from the picture's middle)")
    print(f"{'rig':24} {'field':>5} {'tilt':>5} {'rims':>9} {'model':>9} {'d2/4f':>9} {'error':>7} "
          f"{'model-rims':>10} {'no curve':>9}")  # fmt: skip
    worst = 0.0
    # The paper's picture ends at 11 degrees on its sides and at 15.5 in its corners.
    rigs = (
        ("12 m, 2650 px, 60 mm", 2650.0, 12000.0, 60.0),
        ("1 m, 1900 px, 16 mm", 1900.0, 1000.0, 16.0),
        ("0.5 m, 1300 px, 20 mm", 1300.0, 500.0, 20.0),
    )
    for name, f, z, d in rigs:
        camera = lens(f)
        for field in (0, 5, 11, 15):
            for tilt in (0, 30, 45, 60):
                r = z * np.tan(np.radians(field)) / np.sqrt(2)
                t = np.radians(tilt)
                away = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
                normal = np.sin(t) * away - np.cos(t) * np.array([0, 0, 1.0])
                centre = np.array([[r, r, z]])
                point = project(camera, centre)[0]
                rims = rim_ellipses(camera, centre, normal[None], [d])[0][0]
                model = ellipse_centres(camera, centre, normal[None], d)[0]
                axis = np.array([0, 0, 1.0])
                conic = project(camera, centre - (d**2 / 4 / z) * (axis - normal[2] * normal))[0]
                size = (d * f / z) ** 2 / (4 * f) * np.sin(t) * np.cos(t)
                off = np.linalg.norm(rims - point)
                gap = np.linalg.norm(model - rims)
                worst = max(worst, gap)
                share = f"{size / off - 1:7.0%}" if tilt else f"{'':7}"
                found = np.linalg.norm(model - point)
                curve = np.linalg.norm(conic - rims)
                print(
                    f"{name:24} {field:5} {tilt:5} {off:9.5f} {found:9.5f} {size:9.5f} {share} "
                    f"{gap:10.6f} {curve:9.5f}"
                )
    print(f"largest difference of model and rims: {worst:.6f} px\n")


@dataclasses.dataclass(frozen=True)
class Scene:
    """A pair of cameras, a curved target with circles and check circles in the volume."""

    name: str
    f_px: float
    range_mm: float
    angle_rad: float
    span_mm: float
    diameter_mm: float

    def rig(self):
        cameras = {}
        aim = np.array([0.0, 0, self.range_mm])
        for name, turn in (("left", 0.0), ("right", self.angle_rad)):
            rotation = rotation_from_vector([0, turn, 0])
            cameras[name] = dataclasses.replace(
                lens(self.f_px), rotation=rotation, translation_mm=aim - rotation @ aim
            )
        return RigData(cameras=cameras)

    def target(self):
        x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(-0.5, 0.5, 7) * self.span_mm] * 2))
        bend = 0.5 / self.span_mm
        normal = np.column_stack([2 * bend * x, -2 * bend * y, -np.ones(len(x))])
        return PointSet(
            id=np.arange(1, 50, dtype=np.int32),
            position_mm=np.column_stack([x, y, bend * (x**2 - y**2)]),
            normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
            diameter_mm=np.full(len(x), self.diameter_mm),
        )


SCENES = (
    Scene("12 m, 2650 px, 100 mm", 2650.0, 12000.0, np.radians(30), 1400.0, 100.0),
    Scene("1 m, 1900 px, 16 mm", 1900.0, 1000.0, np.radians(40), 250.0, 16.0),
)


def see(camera, centre, normal, diameter, noise_px, rng):
    """Noisy ellipses: centre, axes and angle, covariance of the latter."""
    centre_in_cam = centre @ camera.rotation.T + camera.translation_mm
    xy, ellipse = rim_ellipses(camera, centre_in_cam, normal @ camera.rotation.T, diameter)
    cov = ellipse_covariance(ellipse, max(np.sqrt(2) * noise_px, 1e-4))
    if noise_px:
        xy = xy + rng.normal(0, noise_px, xy.shape)
        ellipse = ellipse + rng.normal(size=ellipse.shape) * np.sqrt(
            np.diagonal(cov, axis1=1, axis2=2)
        )
    return xy, ellipse, cov


def simulate(scene, noise_px, seed, stages=12):
    """The pair's pictures of the target, and the target as a table gives it."""
    rng = np.random.default_rng(seed)
    rig, target = scene.rig(), scene.target()
    frames = {name: [] for name in rig.cameras}
    reach, half = 0.1 * scene.range_mm, [0, 0.5 * scene.angle_rad, 0]
    for stage in range(1, stages + 1):
        turn = rotation_from_vector(np.subtract(rng.uniform(-0.6, 0.6, 3), half))
        place = np.array([0, 0, scene.range_mm]) + rng.uniform(-1, 1, 3) * [reach, reach, reach]
        centre, normal = target.position_mm @ turn.T + place, target.normal @ turn.T
        for name, camera in rig.cameras.items():
            xy, ellipse, cov = see(camera, centre, normal, target.diameter_mm, noise_px, rng)
            sight = centre @ camera.rotation.T + camera.translation_mm
            facing = -np.sum(sight * (normal @ camera.rotation.T), axis=1)
            ok = (facing > 0.35 * np.linalg.norm(sight, axis=1)) & np.isfinite(xy).all(axis=1)
            ok &= ((xy > 20) & (xy < 1003)).all(axis=1)
            sigma = max(noise_px, 1e-4)
            frames[name].append(
                FrameTargets(
                    stage=stage,
                    image=f"{name}{stage}",
                    id=target.id[ok],
                    xy_px=xy[ok],
                    cov_px2=np.tile([sigma**2, 0, sigma**2], (ok.sum(), 1)),
                    ellipse=ellipse[ok],
                    ellipse_cov=cov[ok],
                )  # fmt: skip
            )
    cameras = [
        CameraFrames(name=name, image_size_px=(1024, 1024), frames=f, free=FREE, r0_px=400.0)
        for name, f in frames.items()
    ]
    sigma_mm = 1e-6 * scene.span_mm if not noise_px else 1e-5 * scene.span_mm
    given = target.position_mm + (rng.normal(0, sigma_mm, (49, 3)) if noise_px else 0.0)
    return rig, cameras, dataclasses.replace(target, position_mm=given), sigma_mm


def parameter_errors(run, rig):
    """Normalised squared error of all estimated camera parameters over their number."""
    error, places = [], []
    for i, name in enumerate(run.rig.cov_names):
        camera, parameter = name.split("/")
        if run.rig.cov[i, i] <= 0:
            continue
        found, true = run.rig.cameras[camera], rig.cameras[camera]
        if parameter in INTERIOR_NAMES:
            k = INTERIOR_NAMES.index(parameter)
            error.append(found.interior[k] - true.interior[k])
        elif parameter[0] == "r":
            turn = found.rotation @ true.rotation.T
            vector = 0.5 * np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            )
            error.append(vector["xyz".index(parameter[1])])
        else:
            error.append((found.translation_mm - true.translation_mm)["xyz".index(parameter[1])])
        places.append(i)
    error = np.array(error)
    cov = run.rig.cov[np.ix_(places, places)]
    scale = 1 / np.sqrt(np.diag(cov))
    return float(
        (scale * error) @ np.linalg.solve(scale[:, None] * cov * scale, scale * error) / len(error)
    )


def check_points(scene, noise_px, seed, count=300):
    """Circles in the volume, any normal both cameras see at 65 degrees or less."""
    rng = np.random.default_rng(1000 + seed)
    rig = scene.rig()
    reach = 0.12 * scene.range_mm
    centre = np.array([0, 0, scene.range_mm]) + rng.uniform(-reach, reach, (6 * count, 3))
    tilt, azimuth = rng.uniform(0, 1.1, 6 * count), rng.uniform(0, 2 * np.pi, 6 * count)
    normal = (
        np.column_stack(
            [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
        )
        @ rotation_from_vector([0, -0.5 * scene.angle_rad, 0]).T
    )
    ok = np.ones(len(centre), bool)
    for camera in rig.cameras.values():
        sight = centre + camera.rotation.T @ camera.translation_mm
        ok &= -np.sum(sight * normal, axis=1) > 0.42 * np.linalg.norm(sight, axis=1)
    centre, normal = centre[ok][:count], normal[ok][:count]
    diameter = np.full(len(centre), scene.diameter_mm)
    seen = [see(c, centre, normal, diameter, noise_px, rng) for c in rig.cameras.values()]
    xy, ellipse, cov = (np.stack(part, axis=1).reshape(2 * len(centre), *part[0].shape[1:])
                        for part in zip(*seen, strict=True))  # fmt: skip
    return centre, normal, diameter, xy, ellipse, cov


def triangulated(rig, points, noise_px, how):
    centre, normal, diameter, xy, ellipse, cov = points
    circles = {
        "none": None,
        "known": Circles(diameter_mm=diameter, normal=normal),
        "estimated": Circles(diameter_mm=diameter, ellipse=ellipse, ellipse_cov=cov),
    }[how]
    sigma = max(noise_px, 1e-4)
    return triangulate(
        rig, 2 * np.arange(len(centre) + 1), np.tile([0, 1], len(centre)), xy,
        np.tile([sigma**2, 0, sigma**2], (len(xy), 1)), circles=circles,
    )  # fmt: skip


def aligned_rms(found, true):
    """RMS length of the differences after the best rigid motion."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = (u * [1, 1, np.sign(np.linalg.det(u @ v))]) @ v
    return float(np.sqrt(np.mean(np.sum((a @ turn - b) ** 2, axis=1))))


def calibrations(draws):
    print("2. Calibration (12 stages, 49 circles) and check circles; all without snooping")
    print("   e2: normalised squared errors, 1 = as predicted, of the cameras' parameters and of")
    print("   points with the true rig; df: error of the left f; mm: RMS error of points with the")
    print("   true rig, and with the calibrated one after the best rigid motion. Without noise")
    print("   points are weighted as of 1e-4 px")
    print(f"{'rig':22} {'noise':>6} {'normals':>10} {'RMS px':>9} {'floor px':>8} {'e2 cam':>8} "
          f"{'df px':>8} {'mm true':>9} {'e2 pts':>9} {'mm calib':>9}")  # fmt: skip
    for scene in SCENES:
        for noise in (0.0, NOISE_PX):
            for how in ("none", "known", "estimated"):
                figures = []
                for seed in range(draws if noise else 1):
                    rig, cameras, target, sigma_mm = simulate(scene, noise, seed)
                    if how == "estimated":
                        target = dataclasses.replace(target, normal=None)
                    options = CalibrationOptions(
                        sigma_mm=sigma_mm, critical_value=0.0, eccentricity=how != "none"
                    )
                    run = calibrate(cameras, target, options)
                    points = check_points(scene, noise, seed)
                    plain = triangulated(rig, points, noise, how)
                    error = plain["position_mm"] - points[0]
                    squares = np.einsum(
                        "ni,nij,nj->n", error, np.linalg.inv(plain["cov_image_mm2"]), error
                    )
                    there = triangulated(run.rig, points, noise, how)["position_mm"]
                    figures.append(
                        [
                            run.rms_px,
                            max(run.rig.sigma_floor_px.values()),
                            parameter_errors(run, rig),
                            run.rig.cameras["left"].interior[0] - rig.cameras["left"].interior[0],
                            np.sqrt(np.mean(np.sum(error**2, axis=1))),
                            squares.mean() / 3,
                            aligned_rms(there, points[0]),
                        ]
                    )
                f = np.array(figures)
                mean = f.mean(axis=0)
                mean[[3, 4, 6]] = np.sqrt((f[:, [3, 4, 6]] ** 2).mean(axis=0))
                cam, pts = (f"{mean[2]:8.2f}", f"{mean[5]:9.2f}") if noise else (" " * 8, " " * 9)
                print(
                    f"{scene.name:22} {noise:6.3f} {how:>10} {mean[0]:9.6f} {mean[1]:8.5f} {cam} "
                    f"{mean[3]:8.4f} {mean[4]:9.6f} {pts} {mean[6]:9.6f}",
                    flush=True,
                )


def rendered(pictures=12):
    """Dots of any normal, rendered, recognised by the model fit, matched and measured."""
    print("\n3. Rendered pictures (1 m, 1900 px, dots of 16 mm), RMS error of positions in mm,")
    print("   the mean of its part along the normal, and e2 as above")
    scene = SCENES[1]
    rig = scene.rig()
    triangulator = Triangulator(rig)
    options = RecognitionOptions(estimator="model", diameter_px=(10.0, 100.0))
    found = {None: [], scene.diameter_mm: []}
    for seed in range(pictures):
        rng = np.random.default_rng(seed)
        x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(-160, 160, 5)] * 2))
        centre = np.column_stack([x, y, 1000 + rng.uniform(-60, 60, 25)])
        tilt, azimuth = rng.uniform(0, 0.8, 25), rng.uniform(0, 2 * np.pi, 25)
        normal = np.column_stack(
            [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
        ) @ rotation_from_vector([0, -0.5 * scene.angle_rad, 0]).T  # fmt: skip
        axis = np.cross(normal, [0, 1.0, 0])
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        dots = SceneTargets(
            centre_mm=centre, normal=normal, x_axis=axis, radius_mm=0.5 * scene.diameter_mm
        )
        sensor = Sensor(psf_sigma_px=0.7, read_noise=4.0, bit_depth=12)
        targets = [
            recognize(Renderer(c, sensor=sensor).render(dots, seed=seed).image, options)
            for c in rig.cameras.values()
        ]
        cameras = [CameraTargets.of_stages([t]) for t in targets]
        for diameter, rows in found.items():
            points = measure_targets(triangulator, cameras, diameter_mm=diameter).points
            apart = np.linalg.norm(points.position_mm[:, None] - centre, axis=2)
            near = apart.argmin(axis=1)
            keep = apart.min(axis=1) < 2.0
            off = (points.position_mm - centre[near])[keep]
            inverse = np.linalg.inv(points.cov_image_mm2[keep])
            squares = np.einsum("ni,nij,nj->n", off, inverse, off)
            along = np.sum(off * normal[near[keep]], axis=1)
            rows.append(np.column_stack([np.sum(off**2, axis=1), along, squares / 3]))
    for diameter, rows in found.items():
        f = np.concatenate(rows)
        name = "with" if diameter else "without"
        print(
            f"   {name:8} {len(f):4} points {np.sqrt(f[:, 0].mean()):9.6f} mm  along the normal "
            f"{f[:, 1].mean():9.6f} mm  e2 {f[:, 2].mean():8.2f} (median {np.median(f[:, 2]):.2f})"
        )


def times():
    scene = SCENES[1]
    points = check_points(scene, NOISE_PX, 0)
    rig = scene.rig()
    print("\n4. Time a point of two cameras, one thread")
    for how in ("none", "known", "estimated"):
        best = min(_timed(rig, points, how) for _ in range(20))
        print(f"   {how:10} {1e6 * best / len(points[0]):6.2f} us")


def _timed(rig, points, how):
    began = time.perf_counter()
    triangulated(rig, points, NOISE_PX, how)
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=10, help="noisy calibrations a line")
    draws = parser.parse_args().draws
    offsets()
    calibrations(draws)
    rendered()
    times()


if __name__ == "__main__":
    main()
