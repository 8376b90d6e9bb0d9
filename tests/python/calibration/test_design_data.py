"""The design's covariance beside what other programs predict for the simulated rig."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.calibration import (
    CalibrationOptions,
    DesignOptions,
    calibrate,
    design_at_positions,
    design_calibration,
)

BENCH = Path(__file__).resolve().parents[3] / "bench" / "accuracy"
#: Bound of the RMS error of 1100.057 mm bars from the calibration alone, mm, and from 0.02 px.
BOUND_MM = {8: 0.225, 16: 0.108, 24: 0.076}
IMAGE_MM = 0.254
WHOLE = {"sigma_px": 0.02, "target_sigma_mm": 0.1, "whole": True}


@pytest.fixture(scope="module")
def paper():
    """bench/accuracy/plan_paper.py, where the shared data is present."""
    import sys

    sys.path.insert(0, str(BENCH))
    try:
        spec = importlib.util.spec_from_file_location("plan_paper", BENCH / "plan_paper.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(BENCH))
    if not (module.data_folder() / "rig-simulated").is_dir():
        pytest.skip(f"no data in {module.data_folder()} ({os.environ.get('VIDEOGRAMMETRY_DATA')})")
    return module


@pytest.mark.data
@pytest.mark.parametrize("kind", ["mild", "table1"])
def test_its_own_positions_give_what_the_reference_bundle_predicts(paper, kind):
    """Same rig, positions, weights and unknowns.

    The positions are those of our own adjustment and the target's coordinates the measured
    ones: they differ from the true by 1e-4 of the size of the target, and so does the geometry.
    """
    cameras, target, truth = paper.rig_simulated(kind)
    run = calibrate(cameras, target, CalibrationOptions(sigma_mm=0.1, critical_value=0.0))
    options = DesignOptions(**WHOLE, free=tuple(truth["reference_joint_bundle"]["free"]))
    poses = [run.rig_from_target[s] for s in sorted(run.rig_from_target)]
    design = design_at_positions(paper.true_rig(truth), paper.with_normals(target), poses, options)
    assert (design.points_seen == 49).all()
    for pair, theirs in truth["reference_joint_bundle"]["bar_predicted_mm"].items():
        bars = [paper.bar_ends(kind, pair)]
        assert paper.rms_sigma(design.rig, bars)[0] == pytest.approx(theirs, rel=0.02)


@pytest.mark.data
@pytest.mark.parametrize("count", [8, 16, 24])
def test_random_positions_give_the_bound(paper, count):
    _, target, truth = paper.rig_simulated("mild")
    rig = paper.true_rig(truth)
    bars, rng = paper.random_bars(rig), np.random.default_rng(count)
    options = DesignOptions(**WHOLE, free=paper.SEVEN)
    crossed = paper.with_normals(target)
    draws = []
    for _ in range(12):
        poses = paper.random_positions(rig, crossed, count, rng)
        design = design_at_positions(rig, crossed, poses, options)
        draws.append(paper.rms_sigma(design.rig, bars)[0])
    # The bound is itself a mean of draws that scatter from 0.5 to 1.6 of it, over positions of
    # which only the rule is known; the mean of twelve is good to 0.3 / sqrt(12) = 9 %, theirs to
    # as much, and what the rule leaves open (tilt, roll, reach) moves it by as much again.
    assert np.mean(draws) == pytest.approx(BOUND_MM[count], rel=0.27)
    assert paper.rms_sigma(rig, bars)[1] == pytest.approx(IMAGE_MM, rel=0.03)


@pytest.mark.data
def test_positions_over_all_of_the_volume_are_better_than_random_ones(paper):
    _, target, truth = paper.rig_simulated("mild")
    rig = paper.true_rig(truth)
    options = DesignOptions(**{**WHOLE, "whole": False}, free=paper.SEVEN, count=16)
    volume, bars = paper.volume_of(rig), paper.random_bars(rig)
    even = design_calibration(rig, paper.with_normals(target), volume, options)
    near = design_calibration(
        rig, paper.with_normals(target), volume, dataclasses.replace(options, part=0.3)
    )
    ours, theirs = (paper.rms_sigma(d.rig, bars)[0] for d in (even, near))
    assert ours < 0.6 * BOUND_MM[16]
    assert theirs > 1.3 * ours
