"""The falling tyre against closed forms and numerical derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from videogrammetry.recognition import code_family
from videogrammetry.rendering.scenes import lab_frame, tyre_scene
from videogrammetry.rendering.scenes.drop import Drop
from videogrammetry.rendering.scenes.tyre import BACK_POINTS, FRONT_POINTS, Tyre

FAMILY = code_family("schneider-14")
G = 9806.65
DROPS = {
    "paper": {"height_mm": 1038.0},
    "thrown": {"height_mm": 400.0, "speed_mm_s": 1500.0},
    "drag": {"height_mm": 1038.0, "drag_per_mm": 2e-4},
    "moon": {"height_mm": 500.0, "gravity_mm_s2": 1625.0},
    "hard": {"height_mm": 1038.0, "contact_s": 0.01, "damping": 0.02},
    "soft": {"height_mm": 100.0, "contact_s": 0.1, "damping": 0.6},
}


def make(name):
    return Drop(**{"gravity_mm_s2": G, **DROPS[name]})


def changes(drop, end_s):
    """Times of touch and release until ``end_s``: where the sign of the height changes."""
    times = np.linspace(0, end_s, 20001)
    above = np.array([drop.height_mm(t) > 0 for t in times])
    found = []
    for k in np.flatnonzero(np.diff(above)):
        low, high = times[k], times[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if (drop.height_mm(middle) > 0) == above[k] else (low, middle)
            )
        found.append(high)
    return found


def test_free_fall_is_the_closed_form():
    drop, thrown = make("paper"), make("thrown")
    for t in np.linspace(-0.01, drop.touch_s * 0.999, 50):
        assert drop.height_mm(t) == pytest.approx(1038.0 - 0.5 * G * t**2, abs=1e-9)
    for t in np.linspace(-0.01, thrown.touch_s * 0.999, 50):
        assert thrown.height_mm(t) == pytest.approx(400 - 1500 * t - 0.5 * G * t**2, abs=1e-9)
    assert drop.touch_s == pytest.approx(math.sqrt(2 * 1038.0 / G))


@pytest.mark.parametrize("name", ["paper", "thrown", "drag", "moon"])
def test_the_second_derivative_is_gravity_less_drag(name):
    drop = make(name)
    g, k = DROPS[name].get("gravity_mm_s2", G), DROPS[name].get("drag_per_mm", 0.0)
    h = 1e-4
    for t in np.linspace(2 * h, drop.touch_s - 2 * h, 40):
        before, now, after = (drop.height_mm(t + d) for d in (-h, 0.0, h))
        velocity = (after - before) / (2 * h)
        # Rounding: 1000 mm * 2^-52 * 4 / h^2 = 9e-5 mm/s^2; truncation h^2/12 of s'''' is less.
        assert (after - 2 * now + before) / h**2 == pytest.approx(-(g - k * velocity**2), abs=2e-3)


@pytest.mark.parametrize("name", DROPS)
def test_height_and_velocity_are_continuous_and_energy_is_lost(name):
    drop = make(name)
    g = DROPS[name].get("gravity_mm_s2", G)
    times = changes(drop, 6 * drop.touch_s)
    assert times[0] == pytest.approx(drop.touch_s, abs=1e-9)
    assert len(times) >= 1
    speeds = []
    h = 1e-6
    for t in times:
        before = [drop.height_mm(t - d) for d in (h, 2 * h)]
        after = [drop.height_mm(t + d) for d in (h, 2 * h)]
        left, right = (before[0] - before[1]) / h, (after[1] - after[0]) / h
        speeds.append(0.5 * (left + right))
        assert abs(after[0] - before[0]) == pytest.approx(2 * h * abs(speeds[-1]), rel=0.01)
        # Half the difference of accelerations times 3 h, which a spring of some kg bounds:
        # w v = (pi / 0.01 s) * 5000 mm/s = 1.6e6 mm/s^2 -> 5 mm/s; rounding 1e-13 / 1e-6.
        assert left == pytest.approx(right, abs=5.0 + 1e-3 * abs(left))
    for touch, release in zip(speeds[::2], speeds[1::2], strict=False):
        assert touch < 0 < release < -touch
    for release, touch in zip(speeds[1::2], speeds[2::2], strict=False):
        assert touch == pytest.approx(-release, rel=1e-3, abs=0.1)
    # Between a touch and its release: energy of height and speed is what the spring lost.
    assert drop.height_mm(100 * drop.touch_s) == pytest.approx(
        -g / (math.pi / DROPS[name].get("contact_s", 0.032)) ** 2, rel=1e-3
    )


def test_a_drag_of_any_strength_is_no_overflow():
    drop = Drop(1038.0, gravity_mm_s2=G, drag_per_mm=5.0)
    terminal = math.sqrt(G / 5.0)
    # Falls with its terminal speed but for the start: ln(2) / k of the way.
    assert drop.touch_s == pytest.approx((1038.0 + math.log(2) / 5.0) / terminal, rel=1e-9)
    assert drop.height_mm(drop.touch_s - 1e-9) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"height_mm": 0.0}, "height"),
        ({"height_mm": math.nan}, "height"),
        ({"gravity_mm_s2": -1.0}, "gravity"),
        ({"gravity_mm_s2": math.inf}, "gravity"),
        ({"speed_mm_s": math.nan}, "speed and drag"),
        ({"speed_mm_s": 1.0, "drag_per_mm": 1e-4}, "from rest only"),
        ({"damping": 0.0}, "contact"),
        ({"contact_s": 0.0}, "contact"),
    ],
)
def test_impossible_drops(options, message):
    with pytest.raises(ValueError, match=message):
        Drop(**{"height_mm": 1000.0, "gravity_mm_s2": G, **options})


# --- the tyre on its way -------------------------------------------------------------


def outer(tyre, t, side=0.0):
    """The outer rim in the laboratory."""
    angle = np.linspace(0, 2 * np.pi, 721)
    radius = np.full(len(angle), tyre.radius_mm)
    return tyre.place(radius, angle, np.full(len(angle), side), t)


def times_of(tyre, num=900):
    return np.linspace(0.0, 6 * tyre.drop.touch_s, num)


@pytest.mark.parametrize("name", ["paper", "thrown", "hard", "soft"])
def test_the_tyre_stands_on_the_ground(name):
    tyre = Tyre(drop=make(name), spin_rad_s=0.3)
    for t in times_of(tyre):
        lowest = outer(tyre, t)[:, 2].min()
        pressed = tyre.drop.compression_mm(t)
        # What rings on from the bounce before, 0.25 v / w exp(-6 / s 2 v / g), is 0.4 mm at most
        # (at v = g / 12, w = 2 pi 30 Hz), that from earlier ones less.
        assert lowest >= -tyre.radius_mm - 0.8, t
        if pressed > 1:  # and near the ground, it does not float over it
            assert lowest < -tyre.radius_mm + 0.5 * pressed, t


def test_no_point_jumps():
    tyre = Tyre(drop=make("hard"), spin_rad_s=0.1)
    radius, angle = np.full(8, 255.0), np.arange(8) * np.pi / 4
    side = np.full(8, -1.0)
    times = changes(tyre.drop, 8 * tyre.drop.touch_s)
    assert len(times) > 4
    for t in times:
        before, after = (tyre.place(radius, angle, side, t + d) for d in (-1e-7, 1e-7))
        # At 5 m/s, 2e-7 s are 1e-3 mm; deformation adds a third at most.
        assert np.abs(after - before).max() < 1.4e-3, t
    for release in times[1::2]:  # above, the velocity is continuous, too
        h = 1e-6
        high = np.sin(angle + tyre.spin_rad_s * release) > 0.3
        at = [tyre.place(radius, angle, side, release + k * h) for k in (-2, -1, 1, 2)]
        jump = (at[3] - at[2]) / h - (at[1] - at[0]) / h
        # As for the middle, 5 mm/s; and what reaches there of the ground's push, which is
        # exp(-(1.87 / 0.6)^2) = 6e-5 of 5 m/s.
        assert high.sum() >= 3
        assert np.abs(jump[high]).max() < 7.0, release


@pytest.mark.parametrize("spin_deg_s", [0.0, 5.0, 90.0])
def test_the_centroid_of_each_side_falls_freely(spin_deg_s):
    scene = tyre_scene(FAMILY, spin_deg_s=spin_deg_s, speed_mm_s=300.0)
    up = np.array(scene.facts["up"])
    np.testing.assert_allclose(up, lab_frame(scene.rig).up)
    touch = scene.facts["touch_s"]
    first, last = scene.facts["free_fall_stages"]
    assert scene.time_s(last) <= touch < scene.time_s(last + 1)
    for points in (FRONT_POINTS, BACK_POINTS):
        rows = np.isin(scene.marks.point, points)
        start = scene.place(0.0).centre_mm[rows].mean(axis=0)
        for stage in (first, 20, 50, last):
            t = scene.time_s(stage)
            way = scene.place(t).centre_mm[rows].mean(axis=0) - start
            np.testing.assert_allclose(way, -up * (300 * t + 0.5 * G * t**2), atol=1e-8)


@pytest.mark.parametrize("time", [0.0, 0.3, 0.465, 0.475, 0.52, 0.7])
def test_normals_are_unit_and_face_their_cameras(time):
    scene = tyre_scene(FAMILY)
    rows = np.flatnonzero(scene.marks.is_target)
    place = scene.place(time)
    for vectors in (place.normal, place.x_axis):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-12)
    assert np.abs((place.normal * place.x_axis).sum(axis=1)).max() < 1e-12
    front = np.isin(scene.marks.point[rows], FRONT_POINTS)
    for name, camera in scene.rig.cameras.items():
        to = camera.centre_mm - place.centre_mm[rows]
        facing = (to * place.normal[rows]).sum(axis=1) / np.linalg.norm(to, axis=1)
        own = front if name in ("cam1", "cam2") else ~front
        assert facing[own].min() > 0.8, name
        assert facing[~own].max() < -0.8, name


def test_the_paper_figure_is_met():
    """Released at stage 1, free to stage 116 or so, most deformed at stage 120."""
    scene = tyre_scene(FAMILY)
    assert scene.facts["free_fall_stages"] == [1, 116]
    drop = Drop(1038.0, gravity_mm_s2=G)
    pressed = [drop.compression_mm(scene.time_s(s)) for s in range(1, 201)]
    assert 1 + int(np.argmax(pressed)) == 120


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dot_mm": 60.0}, "dot: 10 targets with dots of 60 mm do not fit"),
        ({"dot_mm": 0.0}, "dot: expected a diameter over 0 mm"),
        ({"dot_mm": math.nan}, "dot"),
        ({"height_mm": -1.0}, "height"),
        ({"spin_deg_s": math.nan}, "spin"),
        ({"frame_rate_hz": 0.0}, "frame rate"),
        ({"num_stages": 0}, "stages"),
        ({"gravity_m_s2": 0.0}, "gravity"),
    ],
)
def test_impossible_tyres(options, message):
    with pytest.raises(ValueError, match=message):
        tyre_scene(FAMILY, **options)
