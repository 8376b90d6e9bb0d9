"""The page of an adjustment holds its numbers, its pictures' pieces, and asks for nothing."""

from __future__ import annotations

import base64
import dataclasses
import io
import re

import numpy as np
import pytest
from calibration_fakes import fake_run
from network_fakes import SIZE, move_observation, simulate
from page_text import parsed
from PIL import Image

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_result import AdjustedBars, NetworkAdjustment
from videogrammetry.calibration.picture_coverage import picture_coverage
from videogrammetry.calibration.quality import Correlations
from videogrammetry.report import calibration_report
from videogrammetry.report.correlation_figure import correlation_grid, correlation_words
from videogrammetry.report.cutouts import MOST_CUTOUTS, Cutout, cutouts
from videogrammetry.report.network_report import network_report
from videogrammetry.report.picture_figures import arrows_note, coverage_map, residual_vectors

SECTIONS = (
    "What to do better next time", "Cameras", "Residuals over the picture",
    "Residuals, both coordinates", "Residuals over the radius",
    "Points used in each part of the picture", "Correlations of what was estimated",
    "Parameters", "Stations and points", "Reliability and weights", "Scale bars", "Rejected",
    "Pictures", "Points",
)  # fmt: skip
GROSS = 17


@pytest.fixture(scope="module")
def result() -> NetworkAdjustment:
    network = dataclasses.replace(
        simulate(seed=2, kind="free", bars=3, free=None).network, critical_value=4.0
    )
    return adjust_network(move_observation(network, GROSS, (4.0, -3.0)))


def picture_of(name: str) -> np.ndarray:
    return np.random.default_rng(len(name)).integers(0, 4000, SIZE[::-1], dtype=np.uint16)


def test_every_section_is_there_with_its_numbers(result: NetworkAdjustment) -> None:
    page = network_report(result, "Net <b>& more", picture_of)
    text = parsed(page)
    assert "Net <b>& more" in text
    for section in SECTIONS:
        assert section in text
    s = result.summary
    for number in (f"{s.rms_px:.4f}", f"{s.sigma0:.4f}", f"{s.sigma0_px:.4f}"):
        assert number in text
    bars = result.scale_bars
    for i in range(len(bars)):
        assert f"{bars.length_mm[i]:.4f}" in text
        assert f"{bars.length_mm[i] - bars.residual_mm[i]:.4f}" in text
        assert f"{bars.residual_mm[i]:+.4f}" in text
        assert f"{bars.normalised[i]:+.2f}" in text
    (camera,) = result.cameras
    assert camera.dropped, "the simulated lens has no A3, E1, E2"
    for d in camera.dropped:
        assert f"left out: {d.value:.3g} is" in text
    for name in camera.significance:
        assert name in text
    item = next(r for r in result.rejected if r.kind == "observation")
    for part in (item.image, item.point, item.test, item.reason, f"{item.value:.1f}"):
        assert part in text


def test_nothing_is_asked_of_others(result: NetworkAdjustment) -> None:
    for page in (network_report(result, "n", picture_of), calibration_report(fake_run(), "c")):
        assert not re.search(r"<(link|img|iframe)|url\((?!#)|@import|\bsrc=|fetch\(", page)
        assert set(re.findall(r"https?://[^\"' ]+", page)) == {"http://www.w3.org/2000/svg"}
        assert all(
            h.startswith("data:image/png;base64,") for h in re.findall(r'href="(.*?)"', page)
        )


def test_worst_observation_has_its_piece(result: NetworkAdjustment) -> None:
    page = network_report(result, "n", {result.images.name[i]: picture_of(result.images.name[i])
                                        for i in range(len(result.images))})  # fmt: skip
    seen = result.observations
    out = np.flatnonzero(~seen.used)
    assert GROSS in out
    assert page.count('href="data:image/png') == min(len(out), MOST_CUTOUTS)
    assert f"point {result.points.name[seen.point[GROSS]]}" in parsed(page)
    assert 'href="data:' not in network_report(result, "n")
    assert 'href="data:' not in network_report(result, "n", lambda name: None)


def test_a_piece_shows_its_pixels_and_marks() -> None:
    picture = np.full((300, 400), 100, np.uint8)
    picture[150, 200] = 200
    drawn = cutouts([Cutout(picture=picture, measured_px=(200.0, 150.0), expected_px=(210.0, 150.0),
                            title="a <b>", text="t")])  # fmt: skip
    data = re.search(r"base64,([^\"]+)", drawn)
    piece = np.array(Image.open(io.BytesIO(base64.b64decode(data[1]))))
    assert piece.shape == (49, 49)
    assert piece[24, 24] == piece.max()
    zoom = 160 / 49
    middle = 24.5 * zoom
    assert f"M{middle - 7:.1f} {middle - 7:.1f}l14 14" in drawn
    assert f'cx="{middle + 10 * zoom:.1f}" cy="{middle:.1f}"' in drawn
    assert "a &lt;b&gt;" in drawn


@pytest.mark.parametrize("at", [(0.0, 0.0), (399.0, 299.0), (-90.0, 150.0), (200.0, 1000.0)])
def test_pieces_at_and_beyond_the_edge(at: tuple[float, float]) -> None:
    picture = np.arange(300 * 400, dtype=float).reshape(300, 400).astype(np.uint16)
    drawn = cutouts([Cutout(picture=picture, measured_px=at, expected_px=(200.0, 150.0),
                            title="t", text="x")])  # fmt: skip
    parsed(drawn)
    away = np.hypot(at[0] - 200, at[1] - 150)
    assert f"{away:.0f} px" in drawn  # the expected place lies outside of the piece
    assert cutouts([]) == ""


def test_rejected_points_of_a_calibration_have_pieces() -> None:
    run = fake_run(cameras=2)
    asked = []

    def picture(camera: str, stage: int) -> np.ndarray:
        asked.append((camera, stage))
        return np.zeros((1024, 1024), np.uint8)

    page = calibration_report(run, "c", picture)
    out = int((~run.observations.used).sum())
    assert out > 0
    assert len(asked) == min(out, MOST_CUTOUTS)
    assert page.count('href="data:image/png') == len(asked)
    parsed(page)


def many(result: NetworkAdjustment, times: int) -> NetworkAdjustment:
    """The same observations again and again, a little elsewhere."""
    seen = result.observations
    rng = np.random.default_rng(1)
    fields = {
        name: np.concatenate([getattr(seen, name)] * times) for name in seen.__dataclass_fields__
    }
    fields["xy_px"] = np.clip(fields["xy_px"] + rng.normal(0, 60, fields["xy_px"].shape), 0, 1190)
    return dataclasses.replace(result, observations=dataclasses.replace(seen, **fields))


def test_very_many_observations_make_no_large_page(result: NetworkAdjustment) -> None:
    big = many(result, 300)
    assert len(big.observations) > 80_000
    page = network_report(big, "big", picture_of)
    assert len(page.encode()) < 3_000_000
    assert f"4000 of {int(big.observations.used.sum())} arrows" in parsed(page)


def test_known_lengths_and_delays_of_a_calibration_are_shown() -> None:
    run = fake_run(cameras=2)
    one = AdjustedBars(
        point_a=np.array([0, 2]), point_b=np.array([1, 3]), length_mm=np.array([1000.125, 900.0]),
        sigma_mm=np.full(2, 0.02), residual_mm=np.array([0.0625, -0.01]),
        normalised=np.array([3.41, -0.5]), redundancy=np.full(2, 0.7), used=np.ones(2, bool),
        certificate=("PTB <1>", ""),
    )  # fmt: skip
    how = {
        **run.rig.how,
        "time_offset_stages": {"cam1": 0.0, "cam2": 0.125},
        "sigma_time_offset_stages": {"cam1": 0.0, "cam2": 0.005},
    }
    run = dataclasses.replace(run, bars=one, rig=dataclasses.replace(run.rig, how=how))
    page = calibration_report(run, "c")
    text = parsed(page)
    for part in ("1000.1250", "1000.0625", "+0.0625", "+3.41", "PTB <1>", "1 - 2", "0.1250"):
        assert part in text
    assert "1 of 2 scale bars contradicts the rest" in text
    assert "estimated: how late the camera is" in text
    assert "the clock" in text
    assert "Scale bars" not in parsed(calibration_report(fake_run(cameras=2), "c"))


def test_very_many_cameras_make_no_large_page() -> None:
    run = fake_run(cameras=30, stages=10, points=300)
    assert len(run.observations) == 90_000
    page = calibration_report(run, "big", lambda camera, stage: None)
    assert len(page.encode()) < 3_000_000
    parsed(page)


def test_arrows_are_thinned_and_counted() -> None:
    rng = np.random.default_rng(3)
    xy, residual = rng.uniform(0, 1000, (5000, 2)), rng.normal(0, 0.1, (5000, 2))
    used = np.ones(5000, bool)
    drawn = residual_vectors((1000, 1000), xy, residual, used, [""] * 5000, most=900)
    assert len(re.findall(r"M[\d.]+ [\d.]+l", drawn)) == 900 + 1  # and the legend's cross
    assert (
        arrows_note(5000, 0, 900) == "Shown: 900 of 5000 arrows, thinned evenly over the picture."
    )
    assert arrows_note(800, 3, 900) == ""


def test_arrow_ends_where_its_residual_says() -> None:
    drawn = residual_vectors(
        (620, 620), np.array([[99.5, 199.5]]), np.array([[0.3, 0.4]]), np.ones(1, bool), ["a"]
    )
    # 0.5 px is the typical length: 4 % of the drawing, 24.8; three to four parts.
    assert "M100.0 200.0l14.9 19.8l" in drawn


def test_ninths_and_correlations_are_written() -> None:
    xy = np.array([[5.0, 5.0]] * 7 + [[895.0, 595.0]] * 3)
    coverage = picture_coverage((900, 600), xy)
    drawn = coverage_map(coverage, (900, 600))
    assert drawn.count("<rect") == 54
    assert {">7</text>", ">3</text>"} <= set(re.findall(r">\d+</text>", drawn))
    c = Correlations(
        names=("f", "x0", "B1"), matrix=np.array([[1, 0.1, 0.5], [0.1, 1, -0.96], [0.5, -0.96, 1]])
    )
    grid = correlation_grid(c)
    assert grid.count("<rect") == 6
    assert "x0, f: +0.100" in grid
    assert "\u2212.96" in grid
    assert "x0 and B1 -0.960" in correlation_words(c)
    assert "No correlation is above" in correlation_words(
        Correlations(names=("f",), matrix=np.ones((1, 1)))
    )


def test_a_network_without_bars_or_rejections(result: NetworkAdjustment) -> None:
    none = np.empty(0, int)
    bars = result.scale_bars
    empty = dataclasses.replace(
        bars, **{f: getattr(bars, f)[:0] for f in bars.__dataclass_fields__}
    )
    assert len(empty) == len(none)
    clean = dataclasses.replace(result, scale_bars=empty, rejected=(), warnings=())
    text = parsed(network_report(clean, "n"))
    assert "Nothing was rejected" in text
    assert "No scale bar gives the scale" in text
    assert "No warnings" in text
