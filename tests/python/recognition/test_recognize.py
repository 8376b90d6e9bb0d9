import dataclasses
import threading
import time

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry._core import recognition as core
from videogrammetry.cli import recognize as cli_recognize
from videogrammetry.project import schema
from videogrammetry.recognition import (
    CODE_FAMILIES,
    RING_STATUS,
    CodeFamily,
    RecognitionOptions,
    code_family,
    recognize,
)


def sheet(family_name="schneider-14", *, radius=9.0, mirror=False):
    """Nine codes of a family, one picture, and their IDs."""
    family = code_family(family_name)
    chosen = np.linspace(0, len(family) - 1, 9).astype(int)
    pitch = int(2 * radius * family.ring[1] + 14)
    dots = []
    for k, index in enumerate(chosen):
        bits = scenes.code_bits(family.codes[index], family.bits)
        dots.append(
            scenes.Dot(
                x=pitch * (k % 3 + 0.6) + 0.3 * k,
                y=pitch * (k // 3 + 0.6) + 0.17 * k,
                a=radius,
                b=radius * (1 - 0.03 * k),
                angle=0.3 * k,
                bits=bits[::-1] if mirror else bits,
                ring=family.ring,
                turn=0.7 * k,
            )
        )
    size = int(pitch * 3.2)
    return scenes.render((size, size), dots), dots, [int(i) + 1 for i in chosen]


def by_place(targets, dots):
    gap = np.hypot(
        *np.moveaxis(np.array([[d.x, d.y] for d in dots])[:, None] - targets.centre_px, -1, 0)
    )
    assert (gap.min(axis=1) < 0.5).all()
    return gap.argmin(axis=1)


@pytest.mark.parametrize("name", [n for n in CODE_FAMILIES if n != "none"])
def test_every_family_is_read(name):
    grey, dots, ids = sheet(name, radius=12.0)
    targets = recognize(scenes.quantise(grey), RecognitionOptions(codes=name))
    assert targets.id[by_place(targets, dots)].tolist() == ids
    assert len(targets) == len(dots)  # no piece of a ring is a target


def test_reading_direction():
    grey, dots, ids = sheet(mirror=True)
    image = scenes.quantise(grey)
    there = recognize(image, RecognitionOptions(direction="counter-clockwise"))
    assert there.id[by_place(there, dots)].tolist() == ids


def test_mirrored_pictures_are_flagged():
    code = next(c for c in code_family("schneider-14").codes if _is_chiral(c, 14))
    family = CodeFamily(name="one", bits=14, ring=(2.0, 3.0), codes=(code,))
    bits = scenes.code_bits(code, 14)[::-1]
    grey = scenes.render((90, 90), [scenes.Dot(44.3, 45.1, 10, 9, 0.4, bits)])
    targets = recognize(scenes.quantise(grey), family=family)
    assert targets.id.tolist() == [-1]
    assert RING_STATUS[targets.ring_status[0]] == "mirrored"


def _is_chiral(code, n):
    rotations = {((code << i) | (code >> (n - i))) & ((1 << n) - 1) for i in range(n)}
    return int(f"{code:0{n}b}"[::-1], 2) not in rotations


def test_polarity_and_types_agree():
    grey, dots, ids = sheet()
    white = recognize(scenes.quantise(grey))
    black = recognize(scenes.quantise(255 - grey), RecognitionOptions(polarity="black-on-white"))
    deep = recognize(scenes.quantise(16 * grey, np.uint16))
    for targets in (white, black, deep):
        assert targets.id[by_place(targets, dots)].tolist() == ids
    order = by_place(black, dots)
    np.testing.assert_allclose(
        white.centre_px[by_place(white, dots)], black.centre_px[order], atol=0.01
    )
    # 8 bit: rounding of 1/sqrt(12) grey levels on a contrast of 180, over the
    # 20 independent edge points of the smallest dots: 5 sigma.
    bound_px = 5 * (1 / np.sqrt(12) / 180) * 1.9 * np.sqrt(2 / 20)
    np.testing.assert_allclose(
        white.centre_px[by_place(white, dots)], deep.centre_px[by_place(deep, dots)], atol=bound_px
    )


def test_views_pass_without_a_copy_and_strides_are_honoured():
    grey, _, _ = sheet()
    image = scenes.quantise(grey, np.uint16)
    large = np.full((image.shape[0] + 7, image.shape[1] + 33), 65535, np.uint16)
    large[3:-4, 20:-13] = image
    part = recognize(large[3:-4, 20:-13])
    whole = recognize(image)
    assert len(whole) == 9
    np.testing.assert_array_equal(part.centre_px, whole.centre_px)
    for other in (np.asfortranarray(image), image[:, ::-1][:, ::-1], image.astype(">u2")):
        np.testing.assert_array_equal(recognize(other).centre_px, whole.centre_px)
    upside_down = recognize(image[::-1])
    assert len(upside_down) == 9


def test_result_is_complete_and_typed():
    grey, _, _ = sheet()
    targets = recognize(scenes.quantise(grey))
    n = len(targets)
    assert targets.centre_px.shape == targets.semi_axes_px.shape == (n, 2)
    assert targets.cov.shape == (n, 5, 5)
    assert targets.id.dtype == np.int32
    assert targets.ring_status.dtype == np.uint8
    assert (targets.semi_axes_px[:, 0] >= targets.semi_axes_px[:, 1]).all()
    assert ((targets.angle_rad >= 0) & (targets.angle_rad < np.pi)).all()
    np.testing.assert_array_equal(targets.cov, targets.cov.transpose(0, 2, 1))
    assert (np.linalg.eigvalsh(targets.cov) > 0).all()
    np.testing.assert_allclose(targets.contrast, 180, rtol=0.03)


def test_options_equal_those_of_the_core():
    ours, theirs = RecognitionOptions(), core.RecognitionOptions()
    for field in dataclasses.fields(ours):
        value = getattr(theirs, field.name)
        value = tuple(value) if isinstance(value, list) else value
        assert value == getattr(ours, field.name), field.name
    names = {n for n in dir(theirs) if not n.startswith("_")}
    assert names == {f.name for f in dataclasses.fields(ours)}


def test_every_estimator_is_known_everywhere():
    names = ("auto", "mean-gradient", "dual-conic", "model")
    assert names == schema.ESTIMATORS == cli_recognize.ESTIMATORS
    for name in names:
        assert core.RecognitionOptions(estimator=name).estimator == name
        assert len(recognize(np.zeros((9, 9), np.uint8), RecognitionOptions(estimator=name))) == 0
    with pytest.raises(ValueError, match="estimator: expected 'auto'"):
        core.RecognitionOptions(estimator="guess")


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 4, 3), np.uint8), "2 dimensions"),
        (np.zeros(4, np.uint8), "2 dimensions"),
        (np.zeros((4, 4), np.float32), "float32"),
        (np.zeros((4, 4), np.int16), "int16"),
        (np.zeros((4, 4), bool), "bool"),
    ],
)
def test_wrong_arrays_are_refused(image, message):
    with pytest.raises(ValueError, match=message):
        recognize(image)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"polarity": "white"}, "polarity"),
        ({"direction": "left"}, "direction"),
        ({"method": "magic"}, "method"),
        ({"estimator": "guess"}, "estimator"),
        ({"codes": "qr"}, "codes"),
        ({"diameter_px": (20, 5)}, "diameter_px"),
        ({"diameter_px": (1, 5)}, "diameter_px"),
        ({"diameter_px": (5, float("nan"))}, "diameter_px"),
        ({"diameter_px": 5}, "diameter_px"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        recognize(np.zeros((20, 20), np.uint8), RecognitionOptions(**options))


def _awkward():
    random = np.random.default_rng(1)
    y, x = np.mgrid[:600, :800]
    yield "empty", np.zeros((0, 0), np.uint8)
    yield "no rows", np.zeros((0, 50), np.uint16)
    yield "no columns", np.zeros((50, 0), np.uint16)
    yield "one row", random.integers(0, 255, (1, 3000)).astype(np.uint8)
    yield "one column", random.integers(0, 255, (3000, 1)).astype(np.uint8)
    yield "one pixel", np.ones((1, 1), np.uint8)
    yield "constant", np.full((600, 800), 7, np.uint8)
    yield "saturated", np.full((600, 800), 65535, np.uint16)
    yield "noise", random.integers(0, 255, (600, 800)).astype(np.uint8)
    yield "deep noise", random.integers(0, 65535, (600, 800)).astype(np.uint16)
    yield "faint noise", random.integers(100, 103, (600, 800)).astype(np.uint8)
    yield "checkerboard", (255 * ((x // 9 + y // 9) % 2)).astype(np.uint8)
    yield "stripes", (255 * (x // 4 % 2)).astype(np.uint8)
    yield "ramp", (x * 80).astype(np.uint16)
    yield "half black", (65535 * (x > 400)).astype(np.uint16)


@pytest.mark.parametrize(
    ("name", "image"), list(_awkward()), ids=lambda v: v if isinstance(v, str) else ""
)
def test_pictures_without_targets_end_soon_and_empty(name, image):
    for polarity in ("white-on-black", "black-on-white"):
        begin = time.perf_counter()
        targets = recognize(image, RecognitionOptions(polarity=polarity))
        assert time.perf_counter() - begin < 5.0
        assert (targets.id == -1).all()
        assert len(targets) <= (3 if "noise" in name else 0)


def test_dots_at_the_border_are_not_measured():
    for x in (-3.0, 0.0, 5.0, 9.0):
        image = scenes.quantise(scenes.render((80, 80), [scenes.Dot(x, 40.2, 10, 10)]))
        assert len(recognize(image)) == 0, x
    image = scenes.quantise(scenes.render((80, 80), [scenes.Dot(14.0, 40.2, 10, 10)]))
    assert len(recognize(image)) == 1


def test_dark_rim_on_a_bright_background():
    dots = [scenes.Dot(40.3, 41.7, 9, 8, 0.5)]
    rim = scenes.render((80, 80), [scenes.Dot(40.3, 41.7, 12, 11, 0.5)], white=1.0, black=0.0)
    grey = 240 * (1 - rim) + scenes.render((80, 80), dots, white=110, black=10) * rim
    targets = recognize(scenes.quantise(grey))
    assert len(targets) == 1
    # The rim's plateau is two blurred pixels wide: levels to a percent.
    np.testing.assert_allclose(targets.centre_px[0], [40.3, 41.7], atol=0.02)


def test_partly_covered_dots_are_refused():
    dot = scenes.Dot(40.3, 41.7, 12, 11, 0.5)
    for cover in (44, 48):
        grey = scenes.render((80, 80), [dot])
        grey[:, cover:] = 20
        assert len(recognize(scenes.quantise(grey))) == 0, cover


def test_partly_covered_rings_lose_their_id():
    family = code_family("schneider-14")
    bits = scenes.code_bits(family.codes[123], 14)
    for cover in range(52, 74, 2):
        grey = scenes.render((110, 110), [scenes.Dot(45.3, 51.7, 10, 9.5, 0.5, bits, turn=0.4)])
        grey[:, cover + 10 :] = 20
        targets = recognize(scenes.quantise(grey))
        assert set(targets.id.tolist()) <= {-1, 124}, cover


def test_the_same_id_twice_is_flagged():
    bits = scenes.code_bits(code_family("schneider-14").codes[50], 14)
    dots = [scenes.Dot(40 + 75 * k, 42.3, 10, 9, 0.3, bits, turn=0.9 * k) for k in range(2)]
    targets = recognize(scenes.quantise(scenes.render((90, 160), dots)))
    assert targets.id.tolist() == [51, 51]
    assert targets.unique_id.tolist() == [-1, -1]
    assert [RING_STATUS[s] for s in targets.ring_status] == ["duplicate"] * 2


def test_threads_give_the_same_result():
    grey, _, _ = sheet()
    image = scenes.quantise(grey)
    expected = recognize(image).centre_px
    results = [None] * 4

    def work(k):
        results[k] = recognize(image).centre_px

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for result in results:
        np.testing.assert_array_equal(result, expected)


# A print's edge is as wide as the blur, a reflection's fades with its size; one
# that is clipped and small (below 8 px here) does so as fast as a print.
@pytest.mark.parametrize(
    ("sigma", "amplitude"),
    [(5.0, 180.0), *((s, a) for s in (8.0, 12.0, 20.0, 30.0) for a in (180.0, 600.0))],
)
def test_a_hot_spot_is_no_target(sigma, amplitude):
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:240, :240]
    spot = amplitude * np.exp(-((x - 120.3) ** 2 + (y - 118.6) ** 2) / (2 * sigma**2))
    grey = np.clip(20 + spot + rng.normal(0, 1.5, spot.shape), 0, 255)
    assert len(recognize(grey.astype(np.uint8))) == 0
