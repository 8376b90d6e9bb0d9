"""The demo in a size that a test can afford: every part runs, and the figures are right."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from videogrammetry.cli.demo_page import demo_page
from videogrammetry.cli.demo_run import ACROSS, BAR, TYRE, DemoOptions, DemoSize, run_demo
from videogrammetry.cli.demo_table import comparison_rows, losses, terminal_table
from videogrammetry.cli.main import main
from videogrammetry.rendering.disturbances import Conditions

TINY = DemoSize(orientations=8, stages=20, bar_stages=5)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "demo"
    conditions = Conditions(seed=1, missing=0.1)
    return run_demo(folder, DemoOptions(size=TINY, conditions=conditions))


def test_calibration_is_at_its_prediction(results):
    # 2900 or so observations: sigma0 is good to 1 / sqrt(2 * 2700) = 0.014; recognition's
    # covariances are right within some per cent.
    assert 0.93 < results.calibration.sigma0 < 1.07
    assert results.calibration.rms_px < 0.012


def test_errors_agree_with_their_prediction(results):
    for name in (TYRE, BAR, ACROSS):
        truth = results.scenes[name].verification.truth
        # The calibration's part is one draw of a few numbers, a third of the whole at most;
        # the 30 coordinates of a bar's ten positions scatter by 1 / sqrt(60) = 0.13.
        assert 0.6 < truth.total.ratio < 1.4
        assert not truth.wrong
    fall = results.scenes[TYRE].verification.free_fall
    assert abs(fall.fit.deviation_sigmas) < 3.5
    assert abs(fall.fit.deviation_percent) < 0.3
    assert abs(fall.regression.slope - 1) < 0.003


def test_the_project_s_diameter_reaches_the_measurement(results):
    for name in (TYRE, BAR, ACROSS):
        assert results.scenes[name].measurement.provenance["options"]["diameter_mm"] == 40


def test_bars_are_measured_within_and_across_the_pairs(results):
    within = results.scenes[BAR].verification.scale_bars
    across = results.scenes[ACROSS].verification.scale_bars
    assert {s.name for s in within.by_cameras} == {"cam1+cam2 | cam1+cam2", "cam3+cam4 | cam3+cam4"}
    assert {s.name for s in across.by_cameras} == {"cam1+cam2 | cam3+cam4"}
    for bars in (within, across):
        assert np.all(np.abs(bars.error_mm) < 6 * bars.sigma_mm)


def test_empty_pictures_are_named(results):
    said = " ".join(losses(results))
    lost = results.scenes[TYRE].simulated.missing
    assert len(lost) == 2
    for stage, camera in lost.items():
        assert f"{stage} ({camera})" in said
        assert re.search(rf"camera '{camera}': no target at all at \d of 20 stages", said)


def test_table_has_paper_run_and_truth(results):
    text = terminal_table(comparison_rows(results))
    for words in ("paper", "this run", "truth", "1.0188", "0.312 mm", "4-11, 21-30", "0.156 px"):
        assert words in text


class _Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.links, self.loaded = [], []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag == "a":
            self.links.append(given["href"])
        self.loaded += [v for k, v in attrs if k in ("src", "data", "xlink:href") and v]


def test_page_works_offline_and_its_links_lead_somewhere(results):
    page = demo_page(results, comparison_rows(results))
    parser = _Links()
    parser.feed(page)
    assert all(link.startswith(("data:", "#")) for link in parser.loaded)
    assert "@import" not in page
    missing = [link for link in parser.links if not (results.folder / link).exists()]
    assert missing == ["results.json"]  # written by the verb, with the table
    for title in ("Recognised targets", "Displacement in space", "Free fall", "Deformation"):
        assert title in page


def test_existing_folder_is_refused(tmp_path, capsys):
    assert main(["demo", str(tmp_path)]) == 1
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value"), [("--contrast-noise", "-1"), ("--occluded", "1.5"), ("--missing", "-0.1")]
)
def test_impossible_conditions_are_refused(tmp_path, capsys, option, value):
    assert main(["demo", str(tmp_path / "new"), option, value]) == 2
    assert "expected" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_demo_that_breaks_off_says_what_stays(tmp_path, capsys, monkeypatch):
    def broken(folder, options, say):
        folder.mkdir()
        raise OSError(28, "No space left on device", str(folder / "tyre"))

    monkeypatch.setattr("videogrammetry.cli.demo_run.run_demo", broken)
    assert main(["demo", str(tmp_path / "demo")]) == 1
    said = capsys.readouterr().err
    assert "without index.html" in said
    assert "No space left on device" in said
