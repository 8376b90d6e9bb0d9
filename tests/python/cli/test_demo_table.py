"""The demo's table where something could not be measured."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from two_pairs import NAMES, falling, measurement_of

from videogrammetry.accuracy import CalibrationPart, check_free_fall, compare_with_truth
from videogrammetry.cli.demo_run import ACROSS, BAR, SMALL, TYRE, DemoOptions
from videogrammetry.cli.demo_table import comparison_rows, losses, terminal_table
from videogrammetry.pipeline.verify import true_points
from videogrammetry.project import TrajectoryTable
from videogrammetry.recognition import code_family
from videogrammetry.rendering.scenes import tyre_scene


@pytest.fixture(scope="module")
def results():
    """The results of a demo whose bars were never seen; the parts that the table reads."""
    scene = falling(3, stages=20)
    table = scene.table
    stages, points = scene.position.shape[:2]
    truth = true_points(
        TrajectoryTable(
            stage=np.repeat(table.stage, points),
            time_s=np.repeat(table.time_s, points),
            point=tuple(str(i) for i in np.tile(table.point_id, stages)),
            position_mm=scene.position.reshape(-1, 3),
            sigma_mm=np.full((stages * points, 3), np.nan),
            cameras=tuple(
                tuple(np.array(NAMES, dtype=object)[u]) for u in np.tile(scene.used, (stages, 1))
            ),
        ),
        NAMES,
    )
    measurement = measurement_of(table, np.random.default_rng(1))
    check = compare_with_truth(
        table, scene.rig, scene.truth, truth, motion=measurement.motion, first_free_id=517
    )
    fall = check_free_fall(table, 1, 20, CalibrationPart(scene.rig))
    tyre = SimpleNamespace(
        verification=SimpleNamespace(
            truth=check, free_fall=fall, scale_bars=None, scale_bar_rig_error_mm=None
        ),
        measurement=measurement,
        simulated=SimpleNamespace(num_hidden=0, missing={}),
        measure_s=1.0,
    )
    residual = np.random.default_rng(2).normal(0, 0.01, (500, 2))
    return SimpleNamespace(
        calibration=SimpleNamespace(
            observations=SimpleNamespace(used=np.ones(500, dtype=bool), residual_px=residual),
            redundancy=900, rig=scene.rig, sigma0=1.0,
        ),
        truth_rig=scene.truth,
        scenes={TYRE: tyre, BAR: tyre, ACROSS: tyre},
        tyre=tyre_scene(code_family("schneider-14"), num_stages=4),
        bar_error_paper_mm={},
        options=DemoOptions(size=SMALL),
        seconds={"calibrate": 1.0},
    )  # fmt: skip


def changed(results, **verification):
    """The results with another verification of the tyre."""
    tyre = results.scenes[TYRE]
    check = SimpleNamespace(**{**vars(tyre.verification), **verification})
    scenes = {**results.scenes, TYRE: SimpleNamespace(**{**vars(tyre), "verification": check})}
    return SimpleNamespace(**{**vars(results), "scenes": scenes})


def quantities(results):
    return [row.quantity.strip() for row in comparison_rows(results)]


def test_bars_never_seen_are_said_to_be(results):
    rows = {row.quantity: row for row in comparison_rows(results)}
    for kind in ("within a pair", "across the pairs"):
        assert rows[f"scale bar {kind}"].run == "no length measured"
    assert not any("RMS from the calibration alone" in q for q in rows)


def test_no_free_fall_leaves_its_rows_out(results):
    with_fall = quantities(results)
    without = quantities(changed(results, free_fall=None))
    assert "free fall: slope of the line" in with_fall
    assert set(with_fall) - set(without) == {
        "free fall: slope of the line", "offset", "measured falls short by", "acceleration",
    }  # fmt: skip


def test_no_velocity_of_the_centroid_leaves_its_row_out(results):
    truth = dataclasses.replace(results.scenes[TYRE].verification.truth, centroid=None)
    assert "centroid's velocity, RMS error" in quantities(results)
    assert "centroid's velocity, RMS error" not in quantities(changed(results, truth=truth))


def test_every_row_is_in_the_text_with_its_whole_note(results):
    rows = comparison_rows(results)
    text = terminal_table(rows)
    together = " ".join(text.split())
    for row in rows:
        assert row.quantity in text
        for word in row.note.split():
            assert word in together
    assert "nan" not in text


def test_what_was_lost_is_said(results):
    said = losses(results)
    lost = results.scenes[TYRE].verification.truth
    assert lost.measured < lost.visible
    assert sum("were not measured" in line for line in said) == 3
    quiet = changed(results, truth=None)
    assert not any(line.startswith(f"{TYRE}:") for line in losses(quiet))
