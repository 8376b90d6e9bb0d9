"""Undistorted pictures and points: what an ideal camera would have taken."""

from __future__ import annotations

import dataclasses
import threading
import time

import cv2
import numpy as np
import pytest
from export.lens_rigs import points_seen_by, usual_rig

from videogrammetry.errors import VideogrammetryError
from videogrammetry.geometry import (
    INTERPOLATIONS,
    KEEPS,
    Undistortion,
    ideal_camera,
    project,
    rays_through_pixels,
    undistort_ellipses,
    undistort_points,
)
from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.rendering.scenes.paper_rig import paper_rig

PAPER = paper_rig().cameras
USUAL = usual_rig().cameras


def ideal_places(camera):
    """(H, W, 2) where each pixel of the real picture lies in the ideal one."""
    width, height = camera.image_size_px
    x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    rays = rays_through_pixels(camera, pixels)
    return project(ideal_camera(camera), rays).reshape(height, width, 2)


# --- pictures --------------------------------------------------------------------------

LINES = np.arange(60, 1000, 110.25)


def line_grid(camera):
    """Bright lines, straight in the ideal picture, as the real camera sees them (16 bit)."""
    places = ideal_places(camera)
    grey = np.full(places.shape[:2], 5000.0)  # room for what a kernel undershoots
    for at in LINES:
        for axis in (0, 1):
            grey += 40000 * np.exp(-0.5 * ((places[..., axis] - at) / 1.8) ** 2)
    return np.clip(grey, 0, 65535).astype(np.uint16)


def bends(picture, at, search=9):
    """Deviation of an upright line from the straight line through it, row by row.

    Rows that cross another line, and those that the camera has not seen, are left out.
    """
    grey = np.clip(picture.astype(float) - 5000, 0, None)
    height, width = grey.shape
    crossing = np.min(np.abs(np.arange(height)[:, None] - LINES[None]), axis=1) < 12
    window = grey[:, round(at) - search : round(at) + search + 1]
    rows = np.flatnonzero(~crossing & (window.sum(axis=1) > 100_000))[3:-3]
    centre, last = [], at
    for row in rows:
        for _ in range(3):  # the window follows the line
            x = np.arange(max(0, round(last) - search), min(width, round(last) + search + 1))
            last = float(np.average(x, weights=grey[row, x] + 1e-9))
        centre.append(last)
    fit = np.polyfit(rows, centre, 1)
    return np.array(centre) - np.polyval(fit, rows), np.array(centre)


@pytest.mark.parametrize("name", ["cam1", "cam3"])
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_straight_lines_become_straight(name, interpolation):
    camera = PAPER[name]
    crooked = line_grid(camera)
    straight = Undistortion(camera=camera, ideal=ideal_camera(camera), interpolation=interpolation)(
        crooked
    )
    # 2 x 2 samples err by t (1 - t) f'' / 2, t the place between two pixels, which runs across
    # the line with the scale's change s = E1: the centroid moves by s (1 - 2 t) / 2 int x^2 f''
    # = s (1 - 2 t) at most. The cubic holds parabolas, so that this moment is zero; Lanczos'
    # weights hold them to a share of that. What a window of whole pixels cuts off the line's
    # tails is below 0.005 px.
    scale = {"linear": abs(camera.interior[8]), "cubic": 0.0, "lanczos": 0.01}
    bound = 0.01 + scale[interpolation]
    for at in LINES[1:-1]:
        off, centre = bends(straight, at)
        assert np.abs(off).max() < bound, f"{name}, line at {at}"
        assert np.abs(centre - at).max() < bound, f"{name}, line at {at}"
    edge = max(np.ptp(bends(crooked, at + 10, 25)[0]) for at in (LINES[1],))
    assert edge > 0.5  # the real picture's line is bent


def dots(camera, centres, radius, width_px):
    """White discs, circles in the ideal picture, as the real camera sees them (8 bit)."""
    places = ideal_places(camera)
    grey = np.full(places.shape[:2], 30.0)
    for centre in centres:
        distance = np.hypot(*(places - centre).transpose(2, 0, 1))
        grey += 180 / (1 + np.exp(np.clip((distance - radius) / width_px, -40, 40)))
    return np.round(grey).astype(np.uint8)


CENTRES = np.array([[x, y] for x in (90.3, 480.7, 930.1) for y in (85.6, 510.2, 945.9)])


@pytest.mark.parametrize("name", ["cam2", "cam4"])
@pytest.mark.parametrize("keep", KEEPS)
@pytest.mark.parametrize("width_px", [0.35, 0.7])  # edges as of a Gaussian of 0.63 and 1.27 px
def test_targets_lie_where_the_pinhole_has_them(name, keep, width_px):
    camera = PAPER[name]
    ideal = ideal_camera(camera, keep)
    points = rays_through_pixels(ideal_camera(camera), CENTRES) * 12000
    picture = Undistortion(camera=camera, ideal=ideal)(dots(camera, CENTRES, 9.0, width_px))
    found = recognize(picture, RecognitionOptions(codes="none")).centre_px
    expected = project(ideal, points)
    assert len(found) == len(expected)
    for place in expected:
        assert np.hypot(*(found - place).T).min() < 0.02, place


@pytest.mark.parametrize("name", ["cam2", "cam4"])
def test_centres_of_targets_hold_the_lens_curve(name):
    camera = PAPER[name]
    targets = recognize(dots(camera, CENTRES, 9.0, 0.7), RecognitionOptions(codes="none"))
    xy, axes, _ = undistort_ellipses(
        camera, targets.centre_px, targets.semi_axes_px, targets.angle_rad
    )
    # The recognition's own error on such a picture without noise is 0.003 px and less.
    for place in CENTRES:
        assert np.hypot(*(xy - place).T).min() < 0.006, place
    # Circles again: the real picture's axes differ by E1 * 9 px = 0.2 px.
    assert (axes[:, 0] - axes[:, 1]).max() < 0.04
    plain, _ = undistort_points(camera, targets.centre_px)
    assert max(np.hypot(*(plain - p).T).min() for p in CENTRES) > 0.01


@pytest.mark.parametrize("name", list(PAPER))
def test_valid_has_only_what_was_seen_and_no_row_less(name):
    camera = PAPER[name]
    white = np.full((1024, 1024), 255, np.uint8)
    ideal = ideal_camera(camera, "valid")
    assert Undistortion(camera=camera, ideal=ideal)(white).min() == 255
    # A row or column more on any side holds something unseen.
    for left, top, right, bottom in np.eye(4, dtype=int):
        width, height = ideal.image_size_px
        size = (width + left + right, height + top + bottom)
        # The first pixel moves by left, top; the centre by half of what is added.
        interior = ideal.interior.copy()
        interior[1:3] += np.array([left - right, top - bottom]) / 2
        larger = dataclasses.replace(ideal, image_size_px=size, interior=interior)
        pixels = np.array([[-0.5, -0.5], [size[0] - 0.5, size[1] - 0.5]])
        rays = rays_through_pixels(larger, np.vstack([pixels, edges(size)]))
        places = project(camera, rays)
        assert (places < -0.5).any() or (places > 1023.5).any()


def edges(size):
    w, h = size
    t = np.linspace(-0.5, 1, 200)
    x, y = (t + 0.5) / 1.5 * w - 0.5, (t + 0.5) / 1.5 * h - 0.5
    sides = [(np.full_like(y, -0.5), y), (np.full_like(y, w - 0.5), y)]
    sides += [(x, np.full_like(x, -0.5)), (x, np.full_like(x, h - 0.5))]
    return np.concatenate([np.stack(side, axis=1) for side in sides])


@pytest.mark.parametrize("name", list(PAPER))
def test_all_has_every_pixel_of_the_real_picture(name):
    camera = PAPER[name]
    ideal = ideal_camera(camera, "all")
    width, height = ideal.image_size_px
    rng = np.random.default_rng(1)
    pixels = np.vstack([rng.uniform(-0.5, 1023.5, (2000, 2)), edges((1024, 1024))])
    places, _ = undistort_points(camera, pixels, ideal=ideal)
    assert places.min() > -0.501
    assert (places < [width - 0.499, height - 0.499]).all()
    # Tight: the outermost reach into the outermost rows and columns.
    assert places[:, 0].min() < 0.5
    assert places[:, 0].max() > width - 1.5


def test_unseen_pixels_have_the_fill():
    camera = PAPER["cam1"]
    undistort = Undistortion(camera=camera, ideal=ideal_camera(camera, "all"), fill=77)
    picture = undistort(np.full((1024, 1024), 200, np.uint8))
    outside = (undistort.map_px < -0.5).any(axis=2) | (undistort.map_px >= 1023.5).any(axis=2)
    assert outside.any()
    assert (picture[outside] == 77).all()
    assert (picture[~outside] == 200).all()


def test_without_distortion_nothing_changes():
    camera = dataclasses.replace(
        USUAL["cam1"], interior=np.array([2000.0, 3.3, -4.7, 0, 0, 0, 0, 0, 0, 0])
    )
    noise = np.random.default_rng(2).integers(0, 4096, (1024, 1024)).astype(np.uint16)
    for keep in KEEPS:
        ideal = ideal_camera(camera, keep)
        assert ideal.image_size_px == (1024, 1024)
        np.testing.assert_array_equal(ideal.interior, camera.interior)
        for interpolation in INTERPOLATIONS:
            same = Undistortion(camera=camera, ideal=ideal, interpolation=interpolation)(noise)
            # The map's places are whole to 1e-12 px, times 4095 grey levels.
            np.testing.assert_array_equal(same, noise)
            assert same.dtype == np.uint16


@pytest.mark.peer
def test_map_is_opencvs():
    f, k1, k2, p1, p2, k3 = 2600.0, -0.12, 0.3, 4e-4, -7e-4, -0.5
    camera = dataclasses.replace(
        USUAL["cam1"],
        interior=np.array([f, 12, -30, k1 / f**2, k2 / f**4, k3 / f**6, p2 / f, p1 / f, 0, 0]),
        r0_px=0.0,
        measured=False,
    )
    undistort = Undistortion(camera=camera, ideal=ideal_camera(camera))
    matrix = np.array([[f, 0, 511.5 + 12], [0, f, 511.5 - 30], [0, 0, 1]])
    x, y = cv2.initUndistortRectifyMap(
        matrix, np.array([k1, k2, p1, p2, k3]), None, matrix, (1024, 1024), cv2.CV_32FC1
    )
    # Theirs are single precision: 1024 * 2^-24.
    np.testing.assert_allclose(undistort.map_px, np.stack([x, y], axis=-1), rtol=0, atol=1e-4)
    noise = np.random.default_rng(3).integers(0, 65536, (1024, 1024)).astype(np.uint16)
    theirs = cv2.remap(noise, x, y, cv2.INTER_LINEAR).astype(float)
    ours = dataclasses.replace(undistort, interpolation="linear")(noise).astype(float)
    inner = (slice(30, -30),) * 2
    # Theirs rounds places to 1/32 px: of noise with a step of up to 65535 a pixel, RMS
    # 65536 / sqrt(6) * sqrt(2) directions / (32 sqrt(12)) = 340.
    assert np.sqrt(np.mean((ours - theirs)[inner] ** 2)) < 340


def test_other_sizes_types_and_names_are_refused():
    camera = USUAL["cam1"]
    undistort = Undistortion(camera=camera, ideal=ideal_camera(camera))
    for wrong in (np.zeros((10, 10), np.uint8), np.zeros((1024, 1024))):
        with pytest.raises(ValueError, match=r"image: expected \(1024, 1024\) uint8 or uint16"):
            undistort(wrong)
    with pytest.raises(ValueError, match="interpolation: expected one of linear"):
        Undistortion(camera=camera, ideal=camera, interpolation="nearest")
    with pytest.raises(ValueError, match="keep: expected one of size, all, valid"):
        ideal_camera(camera, "most")


@pytest.mark.parametrize("keep", ["all", "valid"])
def test_folding_distortion_is_refused(keep):
    camera = dataclasses.replace(
        USUAL["cam1"], interior=np.array([2000.0, 0, 0, -2e-6, 0, 0, 0, 0, 0, 0]), r0_px=0.0
    )
    with pytest.raises(VideogrammetryError, match="folds over within the picture"):
        ideal_camera(camera, keep)


def test_the_interpreter_runs_meanwhile():
    """The GIL is released: another thread counts on while a picture is made."""
    camera = USUAL["cam1"]
    undistort = Undistortion(
        camera=camera, ideal=ideal_camera(camera), interpolation="lanczos", num_threads=1
    )
    picture = np.zeros((1024, 1024), np.uint8)
    _ = undistort.map_px
    stamps, stop = [], threading.Event()

    def count():
        while not stop.is_set():
            stamps.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    began = time.perf_counter()
    for _ in range(3):
        undistort(picture)
    ended = time.perf_counter()
    stop.set()
    thread.join()
    # Held, there would be at most the stamps between the three calls.
    assert sum(began < stamp < ended for stamp in stamps) > 6


# --- points ----------------------------------------------------------------------------


@pytest.mark.parametrize("camera", [*PAPER.values(), *USUAL.values()])
def test_points_are_those_of_the_pinhole(camera):
    world, pixels = points_seen_by(camera, seed=4)
    in_cam = world @ camera.rotation.T + camera.translation_mm
    for keep in KEEPS:
        ideal = ideal_camera(camera, keep)
        found, _ = undistort_points(camera, pixels, ideal=ideal)
        # The measured direction is exact; 1e-9 for the world's coordinates of 1e4 mm.
        np.testing.assert_allclose(found, project(ideal, in_cam), rtol=0, atol=1e-8)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_covariance_by_monte_carlo(seed):
    camera = PAPER["cam1"]
    rng = np.random.default_rng(seed)
    at = rng.uniform(0, 1023, 2)
    root = rng.normal(0, 0.3, (2, 2))
    cov = root @ root.T + 0.01 * np.eye(2)
    _, found = undistort_points(camera, at[None], cov[None])
    draws = at + rng.multivariate_normal(np.zeros(2), cov, 250_000)
    places, _ = undistort_points(camera, draws)
    error = places - undistort_points(camera, at[None])[0]
    chi2 = np.einsum("ni,ij,nj->n", error, np.linalg.inv(found[0]), error)
    # Mean of chi-square with 2 degrees of freedom: 2 +- 2 / sqrt(250000); five sigmas.
    assert abs(chi2.mean() - 2) < 5 * 2 / 500, seed
    # It is not merely the covariance that went in: the lens changes areas by some per cent.
    ratio = np.linalg.det(found[0]) / np.linalg.det(cov)
    assert abs(ratio - 1) > 0.005
