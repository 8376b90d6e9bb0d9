"""Overlays: outlines where the targets are, IDs off the dots, nothing lost at the border."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from videogrammetry.report import draw_overlay, write_overlay
from videogrammetry.report.overlay import COLOURS
from videogrammetry.types import Targets


def targets(xy: list, ids: list[int], status: list[int], axis: float = 9.0) -> Targets:
    n = len(ids)
    return Targets(
        centre_px=np.array(xy, dtype=float).reshape(n, 2),
        semi_axes_px=np.full((n, 2), axis),
        angle_rad=np.zeros(n),
        id=np.array(ids, dtype=np.int32),
        cov=np.zeros((n, 5, 5)),
        edge_rms_px=np.zeros(n),
        contrast=np.zeros(n),
        ring_status=np.array(status, dtype=np.uint8),
    )


def coloured(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.abs(picture.astype(int) - colour).sum(axis=-1) < 60


def test_outline_lies_on_the_ellipse_to_a_twentieth_of_a_pixel() -> None:
    frame = np.zeros((300, 1400), np.uint16)
    centre = (700.3, 150.6)
    picture = np.asarray(draw_overlay(frame, targets([centre], [-1], [1], axis=40.0)))[:300]
    weight = np.abs(picture.astype(float) - picture[0, 0]).sum(axis=-1)
    y, x = np.indices(weight.shape)
    # Pixel centres have whole coordinates; outline and cross are symmetric about the target's
    # centre, so that it is their centre of gravity. Each of the outline's 2 pi 40 * 1.6 = 400
    # pixels is blended in to 1/255 and their shares follow a first-order distance: far below
    # 0.05 px in the mean.
    assert np.average(x, weights=weight) == pytest.approx(centre[0], abs=0.05)
    assert np.average(y, weights=weight) == pytest.approx(centre[1], abs=0.05)


def test_ids_stand_beside_the_dot_and_within_the_picture() -> None:
    frame = np.zeros((400, 1500), np.uint8)
    places = [[15.0, 15.0], [1485.0, 385.0], [700.0, 200.0], [740.0, 200.0]]
    picture = np.asarray(draw_overlay(frame, targets(places, [7, 123, 45, 46], [0] * 4)))[:400]
    green = coloured(picture, COLOURS["coded"])
    y, x = np.indices(green.shape)
    for place in places:
        distance = np.hypot(x - place[0], y - place[1])
        inside = green & (distance < 7.0)
        # Nothing but the cross (two lines of one pixel) is within the dot.
        assert inside.sum() < 40
        assert (green & (distance < 70)).sum() > inside.sum() + 60  # outline and ID


def test_colours_and_legend() -> None:
    frame = np.full((200, 300), 1000, np.uint16)
    some = targets([[50, 50], [150, 50], [250, 50]], [5, -1, -1], [0, 1, 7])
    picture = draw_overlay(frame, some, "a name")
    assert picture.width == 300 * 4  # small pictures are enlarged by a whole factor, at most 4
    assert picture.height > 200 * 4
    pixels = np.asarray(picture)
    for colour in COLOURS.values():
        assert coloured(pixels[:800], colour).any()
        assert coloured(pixels[800:], colour).any()


def test_a_picture_carries_its_provenance(tmp_path: Path) -> None:
    origin = {"program": "videogrammetry", "inputs_sha256": {"Prüfling.tif": "ab" * 32}}
    frame = np.zeros((20, 30), np.uint8)
    write_overlay(tmp_path / "o.png", frame, targets([], [], []), origin=origin)
    with Image.open(tmp_path / "o.png") as image:
        assert json.loads(image.text["provenance"]) == origin


def test_empty_flat_and_outside(tmp_path: Path) -> None:
    frame = np.zeros((20, 30), np.uint8)
    write_overlay(tmp_path / "o.png", frame, targets([], [], []))
    with Image.open(tmp_path / "o.png") as image:
        assert image.size[0] == 120
    draw_overlay(frame, targets([[-50.0, 300.0], [0.0, 0.0]], [3, 4], [0, 0]))
    assert [p.name for p in tmp_path.iterdir()] == ["o.png"]
