"""Both methods on real pictures: what is found, which IDs, what lies elsewhere."""

import sys
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.recognition import RecognitionOptions, recognize

pytest.importorskip("cv2")
ACCURACY = Path(__file__).parents[3] / "bench" / "accuracy"
sys.path.insert(0, str(ACCURACY))
try:
    import recognition_methods as methods
finally:
    sys.path.remove(str(ACCURACY))

EDGE_PAIR = {"method": "edge-pair", "estimator": "model"}


def judged(pictures):
    rows = []
    for picture in pictures:
        targets = recognize(picture.image, RecognitionOptions(**picture.options, **EDGE_PAIR))
        rows.append(methods.judge(picture, targets))
    return rows


def folder_of(data, name):
    folder = data / methods.SETS[name][0]
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


@pytest.mark.data
@pytest.mark.slow
def test_the_marks_of_the_sheet_are_found(data):
    rows = judged(methods.sheet(folder_of(data, "camcal")))
    assert sum(len(r["hit"]) for r in rows) == 2074
    assert sum(r["hit"].sum() for r in rows) == 2074
    # The local Canny: 2068 marks, 0.079, 0.117 px, 40 elsewhere.
    sd = methods.robust_sd(np.concatenate([r["error"] for r in rows]))
    assert sd[0] < 0.08
    assert sd[1] < 0.13
    assert sum(len(r["elsewhere"]) for r in rows) <= 45


@pytest.mark.data
@pytest.mark.slow
def test_the_panel_is_read(data):
    rows = judged(methods.panel(folder_of(data, "aicon")))
    assert sum(r["wrong"] for r in rows) == 0
    assert sum(r["read"] for r in rows) >= 0.998 * sum(r["coded"] for r in rows)
    # The local Canny: 3662 of 3762 places, many behind hands; 23 elsewhere.
    assert sum(r["hit"].sum() for r in rows) >= 3662
    assert sum(len(r["elsewhere"]) for r in rows) <= 23


@pytest.mark.data
def test_spheres_with_highlights(data):
    rows = judged(methods.block(folder_of(data, "cavity")))
    # The local Canny: 108 of 232 bright spots, 18 elsewhere.
    assert sum(r["hit"].sum() for r in rows) >= 105
    assert sum(len(r["elsewhere"]) for r in rows) <= 25
