"""Rendered pictures against OpenCV's projection, against recognition and against statistics."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from videogrammetry._core import rendering as core
from videogrammetry.recognition import RecognitionOptions, code_family, recognize
from videogrammetry.rendering import (
    VISIBILITY,
    Background,
    Illumination,
    Renderer,
    SceneTargets,
    Sensor,
    SpecularSpot,
    render_frames,
)
from videogrammetry.types import RigCamera

F_PX, DEPTH_MM = 2650.0, 12000.0
MM = DEPTH_MM / F_PX  # of a pixel, at that depth


def make_camera(size=(1024, 1024), **parameters):
    interior = np.zeros(10)
    interior[0] = F_PX
    names = ("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2")
    for name, value in parameters.items():
        interior[names.index(name)] = value
    return RigCamera(
        image_size_px=size,
        interior=interior,
        r0_px=400.0,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )


PAPER = {"x0": -40, "y0": 30, "A1": 1.2e-8, "A2": 3e-15, "A3": 1e-20} | {
    "B1": 2e-7,
    "B2": 3e-6,
    "E1": -0.0023,
    "E2": 3e-4,
}


def field(family, rng, *, count=42, pitch_px=130.0, radius_px=(4.5, 8.0), tilt=0.7):
    """Targets of a family on a grid, tilted, turned and off the grid at random."""
    k = np.arange(count)
    at = np.stack([(k % 7 - 3) * pitch_px + 40, (k // 7 - 2.5) * pitch_px - 30], axis=1)
    at += rng.uniform(-3, 3, at.shape)
    turn = Rotation.from_euler("zxz", rng.uniform([-3, 0, -3], [3, tilt, 3], (count, 3)))
    axes = turn.as_matrix()
    radius = rng.uniform(*radius_px, count) * MM
    coded = family is not None
    ids = rng.permutation(len(family))[:count] + 1 if coded else np.full(count, -1)
    return SceneTargets(
        centre_mm=np.c_[at * MM, np.full(count, DEPTH_MM)],
        normal=-axes[:, :, 2],
        x_axis=axes[:, :, 0],
        radius_mm=radius,
        id=ids,
        num_bits=family.bits if coded else 0,
        code=[family.codes[i - 1] for i in ids] if coded else 0,
        ring=family.ring if coded else (2.0, 3.0),
    )


def matched(targets, truth):
    gap = np.hypot(*np.moveaxis(truth.centre_px[:, None] - targets.centre_px[None], -1, 0))
    assert (gap.min(axis=1) < 1).all(), f"missed {np.flatnonzero(gap.min(axis=1) >= 1)}"
    return gap.argmin(axis=1)


@pytest.mark.parametrize("family", ["schneider-12", "schneider-14", "schneider-16", "metashape-14"])
def test_recognition_reads_what_was_rendered(family):
    codes, biases, worst = code_family(family), [], []
    for seed in (1, 2, 3):
        scene = field(codes, np.random.default_rng(seed))
        renderer = Renderer(
            make_camera(**PAPER),
            background=Background(level=0.3),
            sensor=Sensor(bit_depth=12, read_noise=8.0),
        )
        frame = renderer.render(scene, seed=seed)
        assert frame.truth.visible.all()
        targets = recognize(frame.image, RecognitionOptions(codes=family))
        order = matched(targets, frame.truth)
        np.testing.assert_array_equal(targets.id[order], frame.truth.id, err_msg=f"seed {seed}")
        error = targets.centre_px[order] - frame.truth.centre_px
        biases.append(error.mean(axis=0))
        worst.append(np.abs(error / targets.sigma_px[order]).max())
    # Contrast / noise 380, 126 dots of 9 ... 16 px: a mean's deviation is
    # 0.0015 / sqrt(126) = 0.00013 px, so that 0.002 is the method's bias and not chance.
    assert np.abs(np.mean(biases, axis=0)).max() < 0.002
    assert max(worst) < 25  # predicted from noise; the method's own errors at none are 0.01 px


def test_black_on_white():
    family = code_family("schneider-14")
    scene = field(family, np.random.default_rng(5), tilt=0.3)
    values = {f.name: getattr(scene, f.name) for f in fields(SceneTargets)}
    scene = SceneTargets(**values | {"white_on_black": False})
    frame = Renderer(make_camera(), sensor=Sensor(read_noise=1.0)).render(scene)
    targets = recognize(frame.image, RecognitionOptions(polarity="black-on-white"))
    order = matched(targets, frame.truth)
    np.testing.assert_array_equal(targets.id[order], frame.truth.id)


@pytest.mark.peer
@pytest.mark.parametrize("seed", [1, 2])
def test_truth_agrees_with_opencv(seed):
    cv2 = pytest.importorskip("cv2")
    k1, k2, p1, p2 = -0.12, 0.05, 8e-4, -5e-4
    # OpenCV's polynomial of the ideal point in ours: r0 = 0; its factor of the
    # radius is in units of f, p1 and p2 stand for B2 and B1.
    camera = make_camera(A1=k1 / F_PX**2, A2=k2 / F_PX**4, B1=p2 / F_PX, B2=p1 / F_PX)
    camera = RigCamera(
        image_size_px=camera.image_size_px,
        interior=camera.interior,
        r0_px=0.0,
        rotation=Rotation.from_rotvec([0.05, -0.1, 0.2]).as_matrix(),
        translation_mm=np.array([100.0, -50.0, 300.0]),
        measured=False,
    )
    scene = field(None, np.random.default_rng(seed))
    truth = Renderer(camera).truth(scene)
    seen = truth.visible
    assert seen.sum() > 20
    matrix = np.array([[F_PX, 0, 511.5], [0, F_PX, 511.5], [0, 0, 1]])
    coefficients = np.array([k1, k2, p1, p2])
    pose = cv2.Rodrigues(camera.rotation)[0], camera.translation_mm

    def project(points):
        return cv2.projectPoints(points, *pose, matrix, coefficients)[0].reshape(-1, 2)

    np.testing.assert_allclose(truth.circle_px[seen], project(scene.centre_mm)[seen], atol=1e-8)
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    for i in np.flatnonzero(seen):
        other = np.cross(scene.x_axis[i], scene.normal[i])
        rim = scene.centre_mm[i] + scene.radius_mm[i] * (
            np.cos(angle)[:, None] * scene.x_axis[i] + np.sin(angle)[:, None] * other
        )
        # Area and centroid of OpenCV's polygon; a chord of 1 degree takes 5e-5 of the area.
        x, y = (project(rim) - truth.centre_px[i]).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        area = cross.sum() / 2
        centroid = [((v + np.roll(v, -1)) * cross).sum() / (6 * area) for v in (x, y)]
        # What distortion bends off the ellipse moves a centroid by no more than itself.
        assert np.hypot(*centroid) < 1e-6 + truth.ellipse_error_px[i]
        ellipse = np.pi * truth.semi_axes_px[i].prod()
        assert abs(abs(area) / ellipse - 1) < 1e-4


@pytest.mark.peer
def test_pictures_agree_with_opencv_projection():
    """The centroid of a dot's light lies at OpenCV's picture of its rim."""
    cv2 = pytest.importorskip("cv2")
    camera = make_camera((96, 96))
    scene = SceneTargets(centre_mm=[[7.3 * MM, -4.1 * MM, DEPTH_MM]], radius_mm=8 * MM)
    scene = SceneTargets(
        centre_mm=scene.centre_mm,
        normal=[0, np.sin(0.6), -np.cos(0.6)],
        radius_mm=8 * MM,
        sticker_mm=14 * MM,
        black=0.1,
    )
    light = Renderer(camera, background=Background(level=0.1)).light(scene) - 0.1
    y, x = np.mgrid[:96, :96]
    centroid = np.array([(light * x).sum(), (light * y).sum()]) / light.sum()
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    other = np.cross(scene.x_axis[0], scene.normal[0])
    rim = scene.centre_mm[0] + 8 * MM * (
        np.cos(angle)[:, None] * scene.x_axis[0] + np.sin(angle)[:, None] * other
    )
    matrix = np.array([[F_PX, 0, 47.5], [0, F_PX, 47.5], [0, 0, 1]])
    pixels = cv2.projectPoints(rim, np.zeros(3), np.zeros(3), matrix, None)[0].reshape(-1, 2)
    (cx, cy), _, _ = cv2.fitEllipseDirect(pixels.astype(np.float32))
    # 5e-4 px of integration (tests/cpp/rendering) and single precision of fitEllipse.
    np.testing.assert_allclose(centroid, [cx, cy], atol=1e-3)


@pytest.mark.parametrize(("depth", "kind"), [(8, np.uint8), (10, np.uint16), (16, np.uint16)])
def test_bit_depths(depth, kind):
    renderer = Renderer(
        make_camera((64, 64)), background=Background(level=0.5), sensor=Sensor(bit_depth=depth)
    )
    image = renderer.render(SceneTargets(centre_mm=np.empty((0, 3)))).image
    assert image.dtype == kind
    assert abs(int(image[5, 5]) - 0.5 * (2**depth - 1)) <= 0.51
    bright = Renderer(
        make_camera((64, 64)), illumination=Illumination(level=9), sensor=Sensor(bit_depth=depth)
    )
    assert (bright.render(SceneTargets(centre_mm=np.empty((0, 3)))).image == 2**depth - 1).all()


def test_the_same_whatever_the_threads():
    renderer = Renderer(
        make_camera((256, 200)),
        background=Background(clutter=0.3, seed=4),
        sensor=Sensor(read_noise=3.0, shot_noise_gain=0.1),
    )
    rng = np.random.default_rng(1)
    jobs = []
    for k in range(6):
        scene = field(None, rng, count=20, pitch_px=25.0)
        jobs.append((renderer, scene, k))
    once = render_frames(jobs, num_threads=1)
    again = render_frames(jobs, num_threads=3)
    for a, b in zip(once, again, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
    noise = once[0].image.astype(int) - renderer.render(jobs[0][1], seed=99).image
    assert noise.std() > 1  # another seed, other noise


def test_visibility_and_motion_reach_python():
    scene = SceneTargets(
        centre_mm=[[0, 0, DEPTH_MM], [0, 0, -DEPTH_MM]],
        end_centre_mm=[[4 * MM, 0, DEPTH_MM], [0, 0, -DEPTH_MM]],
        radius_mm=6 * MM,
    )
    truth = Renderer(make_camera((64, 64))).truth(scene)
    assert [VISIBILITY[v] for v in truth.visibility] == ["visible", "behind"]
    np.testing.assert_allclose(truth.centre_px[0], [33.5, 31.5], atol=1e-9)
    assert np.isnan(truth.centre_px[1]).all()
    assert len(scene.select([1])) == 1


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"radius_mm": 0.0}, "radius_mm"),
        ({"radius_mm": [1.0, 2.0, 3.0]}, "radius_mm"),
        ({"normal": [0, 0, -2.0]}, "normal"),
        ({"x_axis": [0, 0, 1.0]}, "x_axis"),
        ({"num_bits": 1}, "num_bits"),
        ({"num_bits": 8, "code": 256}, "code"),
        ({"id": 1.5}, "id"),
        ({"white": 1.2}, "white"),
        ({"sticker_mm": 1.0}, "sticker_mm"),
        ({"centre_mm": [1.0, 2.0, 3.0]}, "centre_mm"),
        ({"centre_mm": [[np.nan, 0, 1], [0, 0, 1]]}, "centre_mm"),
    ],
)
def test_impossible_targets_are_named(change, word):
    with pytest.raises(ValueError, match=word):
        SceneTargets(**{"centre_mm": [[0, 0, 1000.0], [9, 0, 1000.0]]} | change)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"sensor": Sensor(read_noise=-1.0)}, "read_noise"),
        ({"sensor": Sensor(psf_sigma_px=-0.1)}, "psf_sigma_px"),
        ({"sensor": Sensor(bit_depth=11)}, "bit_depth"),
        ({"background": Background(clutter=2.0)}, "clutter"),
        ({"background": Background(spots=(SpecularSpot(sigma_px=0.0),))}, "sigma_px"),
        ({"illumination": Illumination(gradient=(1.5, 1.0))}, "gradient"),
    ],
)
def test_impossible_options_are_named(options, word):
    with pytest.raises(ValueError, match=word):
        Renderer(make_camera((64, 64)), **options)


@pytest.mark.parametrize("options", [Background, Illumination, Sensor, SpecularSpot])
def test_fields_and_defaults_equal_those_of_cpp(options):
    theirs = getattr(core, options.__name__)()
    names = {name for name in dir(theirs) if not name.startswith("_")}
    assert names == {f.name for f in fields(options)}
    for f in fields(options):
        value = getattr(theirs, f.name)
        assert (tuple(value) if isinstance(value, list) else value) == f.default, f.name
