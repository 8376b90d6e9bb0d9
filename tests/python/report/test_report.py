"""The report shows what is in the run, stands alone, and lets no text become markup."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from calibration_fakes import fake_run
from page_text import parsed

from videogrammetry.report import calibration_report
from videogrammetry.report.picture_figures import residual_vectors
from videogrammetry.report.svg import histogram, round_down


def test_the_page_is_whole_and_asks_for_nothing() -> None:
    run = fake_run()
    page = calibration_report(run, "Rig <b>& more")
    text = parsed(page)
    assert "Rig <b>& more" in text
    assert "cam2 <left>: only 12 pictures" in text
    # No request leaves the page: no link, script, image or style from elsewhere.
    assert not re.search(r"<(link|img|iframe)|url\((?!#)|@import|\bsrc=", page)
    assert set(re.findall(r"https?://[^\"' ]+", page)) == {"http://www.w3.org/2000/svg"}
    for name in run.camera_names:
        assert name in text
    for part in (
        "What to do better next time", "Parameters", "Residuals over the radius",
        "Correlations of what was estimated", "Where the target was", "Where the cameras stand",
        "Reliability and weights", "Pictures", "Rejected",
    ):  # fmt: skip
        assert part in text
    assert f"{run.rms_px:.4f}" in text
    assert "left out: A2 is 0.7 of its standard deviation" in text
    assert "only 3 targets of known number" in text
    assert "ab" * 32 in text
    rejected = int((~run.observations.used).sum())
    assert f"{rejected} observations" in text


def test_a_clean_run_is_called_so() -> None:
    run = fake_run()
    clean = dataclasses.replace(
        run,
        rejected=(),
        warnings=(),
        observations=dataclasses.replace(
            run.observations, used=np.ones(len(run.observations), bool)
        ),
    )
    text = parsed(calibration_report(clean))
    assert "Nothing stands out" in text
    assert "Nothing was rejected" in text


def test_bad_cameras_are_pointed_out() -> None:
    run = fake_run(stages=5)
    rms = {**run.camera_rms_px, "cam3": 0.2}
    text = parsed(calibration_report(dataclasses.replace(run, camera_rms_px=rms)))
    assert "camera cam3: residuals" in text
    assert "Camera cam1: only 5 pictures" in text


@pytest.mark.parametrize("cameras", [1, 2, 12])
def test_any_number_of_cameras(cameras: int) -> None:
    parsed(calibration_report(fake_run(cameras=cameras, stages=3, points=9)))


def test_vectors_show_each_observation_once() -> None:
    xy = np.array([[10.0, 20.0], [50.0, 60.0], [70.0, 80.0]])
    residual = np.array([[0.03, 0.0], [0.0, -0.04], [1.0, 1.0]])
    used = np.array([True, True, False])
    drawn = residual_vectors((100, 100), xy, residual, used, ["a", "b", "c"])
    assert drawn.count("<title>") == 3
    assert drawn.count("<circle") == 2 + 1  # and the legend's
    # The rejected vector is cut to six typical lengths: 6 * 4 % of 620 px.
    tip = re.search(r"M[\d.]+ [\d.]+l([\d.]+) ([\d.]+)[^>]*><title>c", drawn)
    assert np.hypot(float(tip[1]), float(tip[2])) == pytest.approx(148.8, abs=0.5)


def test_no_observation_used_is_drawn_all_the_same() -> None:
    nothing = np.zeros(2, bool)
    assert "no observation used" in histogram(np.ones((2, 2)), nothing)
    assert "<svg" in residual_vectors((100, 50), np.ones((2, 2)), np.ones((2, 2)), nothing, "ab")


def test_histogram_counts_every_coordinate() -> None:
    rng = np.random.default_rng(1)
    residual = rng.normal(0, 0.03, (500, 2))
    residual[0] = 9.0  # beyond the axis: counted in the last bar
    drawn = histogram(residual, np.ones(500, bool))
    assert sum(int(n) for n in re.findall(r"px: (\d+)</title>", drawn)) == 1000


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, 1.0), (1.99, 1.0), (0.0, 1.0), (5.5e-3, 5e-3)]
)
def test_round_down(value: float, expected: float) -> None:
    assert round_down(value) == pytest.approx(expected)
