"""Recognition errs on our pictures as on those of a renderer that shares nothing with us."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[3] / "bench" / "accuracy" / "rendering_against_another.py"


@pytest.mark.data
@pytest.mark.peer
@pytest.mark.slow
def test_error_statistics_agree_with_another_renderer(data):
    pytest.importorskip("cv2")
    spec = importlib.util.spec_from_file_location("rendering_against_another", BENCH)
    bench = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bench)
    table = bench.compare(data / "rendered-targets", scenes=3)
    for noise, (other, ours) in table.items():
        assert ours["n"] > 400, noise
        assert ours["wrong"] == 0, noise
        # RMS of 147 and of 441 targets: 4 % and 2 % by chance alone.
        assert 0.8 < ours["rms"] / other["rms"] < 1.2, (noise, ours, other)
        assert 0.8 < ours["sigma"] / other["sigma"] < 1.2, (noise, ours, other)
        assert 0.8 < ours["chi"] / other["chi"] < 1.2, (noise, ours, other)
        assert ours["bias"] < 0.002, noise
