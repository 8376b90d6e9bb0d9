"""The panel's dots with the codes withheld: never a wrong match over two cameras."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.data


def test_no_match_is_wrong(data, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "bench" / "accuracy"))
    bench = importlib.import_module("matching_panel")
    rows = bench.judge(data)
    for name in ("matching_panel", "panel"):
        sys.modules.pop(name, None)
    assert len(rows) == 5
    for row in rows:
        assert row["wrong"] == 0, row
        # What geometry and surface do not decide is left, not guessed: a few dots.
        assert row["right"] >= 0.95 * row["seen by both"], row
        assert row["un-coded of them"] > 100, row
