"""Rig, laboratory and objects of the paper's experiments, against the paper and geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from videogrammetry.geometry import project
from videogrammetry.recognition import code_family
from videogrammetry.rendering import VISIBILITY, Renderer
from videogrammetry.rendering.scenes import (
    Scene,
    calibration_scene,
    cross_target,
    lab_frame,
    paper_rig,
    photos_scene,
    scale_bar_scene,
    tyre_scene,
)
from videogrammetry.rendering.scenes.base import Placement
from videogrammetry.rendering.scenes.calibration import VOLUME_MM

FAMILY = code_family("schneider-14")
SEEDS = (0, 1, 2)
SEEN, AWAY = VISIBILITY.index("visible"), VISIBILITY.index("facing away")
NUM_CODED, NUM_UNCODED = 16, 33

# The paper's section 4.1 and Table 1, in its axes: y up, z backward; y of a picture up.
R2 = [[0.89062, 0.02703, -0.45393], [-0.02712, 0.99961, 0.00630], [0.45393, 0.00669, 0.89101]]
T2 = [-5356.50, 86.47, -1236.87]
R3 = [[-0.99893, -0.04508, 0.01031], [-0.04474, 0.99849, 0.03166], [-0.01172, 0.03116, -0.99945]]
T3 = [826.97, 756.99, -22867.50]
R4 = [[0.88285, 0.08329, -0.46219], [-0.08496, 0.99623, 0.01725], [0.46188, 0.02405, 0.88661]]
T4 = [-5558.91, 157.14, -1284.78]
TO_OURS = np.diag([1.0, -1.0, -1.0])


def orthonormal(matrix):
    u, _, vt = np.linalg.svd(np.array(matrix))
    return u @ vt


def papers_camera_points(name, points):
    """Points of camera 1's frame in that of a camera, all in the paper's axes."""
    if name == "cam1":
        return points
    if name == "cam2":
        return points @ orthonormal(R2).T + T2
    third = points @ orthonormal(R3).T + T3
    return third if name == "cam3" else third @ orthonormal(R4).T + T4


def papers_picture(parameters, r0, points):
    """Eqs. (1)-(3): x - x0 + dx = -f Xc / Zc, for the measured point, by iteration."""
    f, x0, y0, a1, a2, a3, b1, b2, e1, e2 = parameters
    ideal = -f * points[:, :2] / points[:, 2:]
    measured = ideal.copy()
    for _ in range(200):
        x, y = measured.T
        r2 = x**2 + y**2
        radial = a1 * (r2 - r0**2) + a2 * (r2**2 - r0**4) + a3 * (r2**3 - r0**6)
        dx = x * radial + b1 * (r2 + 2 * x**2) + 2 * b2 * x * y + e1 * x + e2 * y
        dy = y * radial + b2 * (r2 + 2 * y**2) + 2 * b1 * x * y
        measured = ideal - np.column_stack([dx, dy])
    return measured + np.array([x0, y0])


# --- rig and laboratory -------------------------------------------------------------


def test_the_rig_has_the_papers_numbers():
    for name, camera in paper_rig().cameras.items():
        f, x0, y0, a1, a2, a3, b1, b2, e1, e2 = camera.interior
        assert 2627 <= f <= 2672, name
        assert -131 <= x0 <= -28, name
        assert 27.9 <= y0 <= 131, name  # the paper's are negative, y up
        assert 1e-8 < abs(a1) < 3e-8, name
        assert abs(a2) < 1e-14, name
        assert abs(a3) < 2e-19, name
        assert 1e-7 < abs(b1) < 1e-6, name
        assert 1e-6 < b2 < 1e-5, name
        assert -0.0245 < e1 < -0.0215, name
        assert -7.3e-3 <= e2 <= -3.3e-3, name
        assert camera.image_size_px == (1024, 1024)
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera.rotation) > 0
    assert np.allclose(paper_rig().cameras["cam1"].rotation, np.eye(3))


def test_the_pairs_look_at_one_point_of_the_axis():
    """R2 X + T2 and R4 X + T4 carry (0, 0, -12000) to within 100 mm of the axis."""
    cameras = paper_rig().cameras
    before = np.array([0.0, 0.0, 12000.0])
    for own, other in (("cam1", "cam2"), ("cam3", "cam4")):
        in_rig = cameras[own].rotation.T @ (before - cameras[own].translation_mm)
        x, y, z = cameras[other].rotation @ in_rig + cameras[other].translation_mm
        assert np.hypot(x, y) < 100
        assert 11000 < z < 13000


def test_projections_are_those_of_the_papers_equations():
    rig = paper_rig()
    lab = lab_frame(rig)
    in_lab = np.random.default_rng(1).uniform(-1500, 1500, (60, 3))
    points = in_lab @ lab.rotation.T + lab.origin_mm
    for name, camera in rig.cameras.items():
        ours = project(camera, points @ camera.rotation.T + camera.translation_mm)
        # As printed: y0, B2 and E2 with the signs of an upward y.
        printed = camera.interior * [1, 1, -1, 1, 1, 1, 1, -1, 1, -1]
        theirs = papers_picture(printed, camera.r0_px, papers_camera_points(name, points @ TO_OURS))
        in_pixels = 511.5 + theirs * [1, -1]
        inside = ((in_pixels > 0) & (in_pixels < 1023)).all(axis=1)
        assert inside.sum() > 30, name
        np.testing.assert_allclose(ours[inside], in_pixels[inside], atol=1e-6, err_msg=name)


def test_the_laboratory_stands_upright_between_the_pairs():
    rig = paper_rig()
    lab = lab_frame(rig)
    np.testing.assert_allclose(lab.rotation.T @ lab.rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(lab.rotation) == pytest.approx(1)
    np.testing.assert_allclose(lab.up, lab.rotation @ [0, 0, 1])
    for name, camera in rig.cameras.items():
        # Up is up in every picture; the cameras of a pair stand before and behind.
        assert (camera.rotation @ lab.up)[1] < -0.99, name
        x, y, z = (camera.centre_mm - lab.origin_mm) @ lab.rotation
        assert (y < -9000) == (name in ("cam1", "cam2")), name
        assert abs(y) > 9000, name
        assert abs(x) < 6000, name
        assert abs(z) < 1500, name


# --- the cross ----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["schneider-12", "schneider-14", "metashape-14"])
@pytest.mark.parametrize("span_mm", [700.0, 1400.0])
def test_the_cross(name, span_mm):
    family = code_family(name)
    cross = cross_target(family, span_mm=span_mm, dot_mm=40.0 * span_mm / 1400)
    assert sorted(cross.marks.id[cross.marks.id > 0]) == list(range(1, 2 * NUM_CODED + 1))
    assert len(set(cross.marks.point)) == 2 * (NUM_CODED + NUM_UNCODED)
    assert cross.marks.point[cross.marks.id < 0].min() > len(family)
    for side in (0, 1):
        rows = np.flatnonzero(cross.side == side)
        coded = cross.marks.id[rows] > 0
        assert (coded.sum(), (~coded).sum()) == (NUM_CODED, NUM_UNCODED)
        places, normals = cross.place.centre_mm[rows], cross.place.normal[rows]
        assert (np.sign(normals[:, 2]) == (1 if side else -1)).all()
        # Not in one plane: the third singular value is the scatter off the best plane.
        off_plane = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[2]
        assert off_plane / np.sqrt(len(rows)) > 0.02 * span_mm
        # Stickers are squares along one axis: apart along one axis of the two at least.
        xy, size = places[:, :2], cross.marks.sticker_mm[rows]
        apart = np.abs(xy[:, None] - xy[None]).max(axis=2) - (size[:, None] + size[None])
        assert apart[~np.eye(len(rows), dtype=bool)].min() > 0, side


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dot_mm": 41.0}, "dot: targets of 41 mm overlap on a cross of 1400 mm.*up to 40 mm"),
        ({"dot_mm": 0.0}, "dot: expected more than 0 mm"),
        ({"span_mm": -1.0}, "span: expected"),
        ({"span_mm": np.nan}, "span: expected"),
        ({"thickness_mm": 0.0}, "thickness"),
    ],
)
def test_impossible_crosses(options, message):
    with pytest.raises(ValueError, match=message):
        cross_target(FAMILY, **options)


# --- which pair sees what ------------------------------------------------------------


def visibility(scene: Scene, stages) -> np.ndarray:
    """(stages, cameras, targets)."""
    rows = scene.marks.is_target
    renderers = [Renderer(camera) for camera in scene.rig.cameras.values()]
    targets = [scene.targets(scene.time_s(stage)) for stage in stages]
    return np.array([[r.truth(t).visibility[rows] for r in renderers] for t in targets])


def check_pairs(scene, stages, front, *, least=1.0):
    """Front targets are seen by cameras 1-2 and from behind by 3-4; the others the reverse."""
    found = visibility(scene, stages)
    for pair, own in ((slice(0, 2), front), (slice(2, 4), ~front)):
        assert (found[:, pair][:, :, own] == SEEN).mean() >= least
        assert (found[:, pair][:, :, ~own] == AWAY).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_the_cross_is_seen_by_either_pair_from_its_side(seed):
    scene = calibration_scene(FAMILY, num_orientations=12, seed=seed)
    front = np.arange(98) < 49
    check_pairs(scene, range(1, 13), front, least=0.95)
    for camera in (0, 1, 2, 3):
        seen = visibility(scene, range(1, 13))[:, camera, front if camera < 2 else ~front]
        assert (seen == SEEN).mean(axis=1).min() >= 0.75, f"seed {seed}"


@pytest.mark.parametrize("cross_pair", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_bar_is_seen_by_both_pairs(cross_pair, seed):
    scene = scale_bar_scene(FAMILY, cross_pair=cross_pair, seed=seed)
    points = scene.marks.point[scene.marks.is_target]
    assert points.tolist() == ([1, 4] if cross_pair else [1, 2, 3, 4])
    check_pairs(scene, range(1, 45, 2), points <= 2)


@pytest.mark.parametrize("uncoded", [False, True])
def test_the_tyre_is_seen_from_both_sides(uncoded):
    scene = tyre_scene(FAMILY, uncoded=uncoded)
    points = scene.marks.point[scene.marks.is_target]
    assert points.tolist() == [*range(4, 12), *range(21, 31)]
    assert (scene.marks.id > 0).any() == (not uncoded)
    check_pairs(scene, range(1, 201, 7), points <= 11)


@pytest.mark.parametrize("num", [8, 16, 24])
@pytest.mark.parametrize("seed", SEEDS)
def test_orientations_fill_the_volume_and_the_pictures(num, seed):
    scene = calibration_scene(FAMILY, num_orientations=num, seed=seed)
    lab = lab_frame(scene.rig)
    middles, reached = [], [set() for _ in scene.rig.cameras]
    for stage in range(1, num + 1):
        place = scene.place(scene.time_s(stage))
        middles.append((place.centre_mm.mean(axis=0) - lab.origin_mm) @ lab.rotation)
        for k, camera in enumerate(scene.rig.cameras.values()):
            own = place.centre_mm[slice(0, 49) if k < 2 else slice(49, 98)]
            xy = project(camera, own @ camera.rotation.T + camera.translation_mm)
            inside = ((xy > 0) & (xy < 1023)).all(axis=1)
            reached[k] |= {tuple(cell) for cell in np.floor(xy[inside] / 256).astype(int)}
    # The R_d sequence's gaps in one dimension are 2 / n at most, either end: 1 - 2 / n of a
    # side of length 2; places drawn inwards take some more of it.
    extent = np.ptp(np.array(middles) / VOLUME_MM, axis=0)
    assert extent.min() > (1 - 2 / num) * 2 * 0.85, f"seed {seed}: {extent}"
    assert extent.max() <= 2
    # Of 16 cells of a picture the corners may stay empty with few orientations.
    assert min(map(len, reached)) >= (12 if num == 8 else 15), f"seed {seed}"


def test_impossible_calibrations():
    with pytest.raises(ValueError, match="orientations: expected 1 or more"):
        calibration_scene(FAMILY, num_orientations=0)
    with pytest.raises(ValueError, match="tilt"):
        calibration_scene(FAMILY, tilt_deg=float("nan"))
    with pytest.raises(ValueError, match="span: even in the middle .* smaller cross"):
        calibration_scene(FAMILY, cross=cross_target(FAMILY, span_mm=9000.0))


# --- the scale bar -------------------------------------------------------------------


@pytest.mark.parametrize("cross_pair", [False, True])
@pytest.mark.parametrize("length_mm", [900.0, 1100.057])
def test_the_bars_length_is_exact_at_all_times(cross_pair, length_mm):
    scene = scale_bar_scene(FAMILY, cross_pair=cross_pair, length_mm=length_mm, seed=3)
    last = scene.time_s(scene.num_stages)
    assert scene.facts["bars"] == ([(1, 4)] if cross_pair else [(1, 2), (3, 4)])
    for time in np.linspace(-1e-3, last + 1e-3, 101):
        place = scene.place(float(time)).centre_mm
        for a, b in scene.facts["bars"]:
            ends = [place[scene.marks.point == p][0] for p in (a, b)]
            # Coordinates of 12 m in double precision: 12000 * 2^-52 * a few.
            assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(length_mm, abs=1e-10)


def middle_of(scene: Scene, time: float) -> np.ndarray:
    return scene.place(time).centre_mm[scene.marks.is_target].mean(axis=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_bars_speeds_and_its_way(seed):
    speeds = [200.0, 500.0, 1000.0, 2000.0]
    scene = scale_bar_scene(FAMILY, speeds_mm_s=speeds, seed=seed, num_stages=60)
    last = scene.time_s(60)
    step = 1e-4
    times = np.linspace(0, last, 4000)
    way = np.array([middle_of(scene, t) for t in times])
    done = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    for part in (0.0, 0.2, 1 / 3, 0.5, 2 / 3, 0.9, 0.99):
        time = float(np.interp(part * done[-1], done, times))
        velocity = (middle_of(scene, time + step) - middle_of(scene, time - step)) / (2 * step)
        wanted = np.interp(part, np.linspace(0, 1, 4), speeds)
        # The curve is cut into 4000 pieces within which its parameter runs evenly: between the
        # pieces the speed differs by 1 / 4000 of the way's 6 bends or so, 2 pi 3 / 4000 = 0.5 %.
        assert np.linalg.norm(velocity) == pytest.approx(wanted, rel=0.01), f"seed {seed}"
    # The whole closed way is covered, but for what rounding the rate up to 0.001 Hz leaves.
    left = np.linalg.norm(way[-1] - way[0])
    assert left <= 2000.0 * 59 * 0.001 / scene.frame_rate_hz**2 * 1.01, f"seed {seed}"


@pytest.mark.parametrize("seed", SEEDS)
def test_the_bar_moves_on_beyond_both_ends(seed):
    scene = scale_bar_scene(FAMILY, seed=seed, num_stages=10)
    for time, speed in ((0.0, 200.0), (scene.time_s(10), 2000.0)):
        before, now, after = (scene.place(time + d).centre_mm for d in (-1e-4, 0.0, 1e-4))
        # Same velocity on both sides: no point is left behind, none jumps.
        change = np.abs((after - now) - (now - before)).max()
        assert change < 0.02 * speed * 1e-4, f"seed {seed} at {time}"
        assert np.abs(after - now).max() > 0.1 * speed * 1e-4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speeds_mm_s": []}, "speeds"),
        ({"speeds_mm_s": [100.0, 0.0]}, "speeds"),
        ({"speeds_mm_s": [np.inf]}, "speeds"),
        ({"num_stages": 1}, "stages: a moving bar needs 2"),
        ({"length_mm": 200.0}, "length: a bar of 200 mm is too short for dots of 40 mm"),
        ({"length_mm": 40.0, "dot_mm": 2.0, "cross_pair": True}, "length"),
        ({"dot_mm": 0.0}, "length"),
        ({"exposure_s": 3.0}, "exposure: 3 s is longer than a frame"),
        ({"exposure_s": np.nan}, "exposure: expected 0 s or more"),
        ({"tilt_deg": 90.0}, "tilt"),
    ],
)
def test_impossible_bars(options, message):
    with pytest.raises(ValueError, match=message):
        scale_bar_scene(FAMILY, **options)


def test_too_few_codes_are_said():
    with pytest.raises(ValueError, match="the family schneider-10 has the numbers 1 ... 42"):
        photos_scene(code_family("schneider-10"))
    with pytest.raises(ValueError, match="cross carries 32 coded targets, schneider-8 has only"):
        cross_target(code_family("schneider-8"))


# --- a scene ---------------------------------------------------------------------------


def test_an_exposure_goes_straight_through_the_true_place():
    still = tyre_scene(FAMILY, num_stages=3, exposure_s=0.0)
    scene = replace(still, exposure_s=1e-3)
    targets = scene.targets(0.2)
    middle = 0.5 * (targets.centre_mm + targets.end_centre_mm)
    np.testing.assert_allclose(middle, scene.place(0.2).centre_mm, atol=1e-9)
    way = np.linalg.norm(targets.end_centre_mm - targets.centre_mm, axis=1)
    np.testing.assert_allclose(way, 9806.65 * 0.2 * 1e-3, rtol=0.03)  # spin on top
    assert still.targets(0.2).end_centre_mm is None


def test_impossible_scenes():
    base = tyre_scene(FAMILY, num_stages=2)

    def place(time: float) -> Placement:
        return base.place(time)

    for change, message in (
        ({"num_stages": 0}, "stages"),
        ({"frame_rate_hz": 0.0}, "frame rate"),
        ({"frame_rate_hz": np.inf}, "frame rate"),
        ({"frame_rate_hz": np.nan}, "frame rate"),
        ({"exposure_s": -1e-6}, "exposure"),
        ({"exposure_s": 0.1}, "longer than a frame, which lasts 0.004 s at 250 Hz"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(base, place=place, **change)
