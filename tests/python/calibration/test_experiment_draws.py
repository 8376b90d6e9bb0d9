"""The paper's calibration over a few draws: what docs/verification.md states must stay true."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

BENCH = Path(__file__).parents[3] / "bench" / "accuracy" / "experiment_draws.py"
DRAWS = 4


@pytest.fixture(scope="module")
def bench():
    spec = importlib.util.spec_from_file_location("experiment_draws", BENCH)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drawn(bench):
    setup = bench.Setup(8, bars=20)
    draws = [bench.draw(setup, seed, methods=("joint",)) for seed in range(DRAWS)]
    runs = [d["joint"] for d in draws]
    return runs, bench.summary(runs, [d["truth"] for d in draws], bench.bound(setup))


@pytest.mark.parametrize("place", ["1-2", "3-4", "across", "point"])
def test_joint_is_efficient(drawn, place):
    """At most 1.1 times the error of least squares that attains the bound, same observations.

    Against the bound itself few draws say little: at worst all bars of a draw
    share one error, so that ratio^2 is chi^2_D / D; 1e-4 is left out on either side.
    """
    row = drawn[1][place]
    assert row["paired"][0] <= 1.1
    low, high = np.sqrt(chi2.ppf([1e-4, 1 - 1e-4], DRAWS) / DRAWS)
    assert low < row["ratio"][0] < 1.1 * high


@pytest.mark.parametrize("place", ["1-2", "3-4", "across", "point"])
def test_runs_predict_the_bound(drawn, place):
    """Own predictions follow sigma0, whose scatter is 1 / sqrt(2 r) = 1.3 % a run."""
    runs, rows = drawn
    scatter = 1 / np.sqrt(2 * runs[0]["redundancy"])
    assert rows[place]["predicted_mm"] == pytest.approx(rows[place]["bound_mm"], rel=4 * scatter)


def test_sigma0_is_one(drawn):
    """Its mean over D runs has the standard deviation 1 / sqrt(2 r D)."""
    sigma0 = np.mean([run["sigma0"] for run in drawn[0]])
    assert sigma0 == pytest.approx(1.0, abs=4 / np.sqrt(2 * drawn[0][0]["redundancy"] * DRAWS))
