"""Pictures that nobody meant to measure: each with a clear answer, by every method.

Wrong arrays are refused by a ValueError that names what was expected; pictures
without dots give no targets; what memory holds otherwise than in rows gives the
same targets as the same picture in rows. No time is asserted: work that grows
with more than the picture is caught by the size of what is found and by memory.
"""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.recognition import recognize as _function
from videogrammetry.types import Targets

#: Every method and estimator that the options take; new ones join by themselves.
_module = sys.modules[_function.__module__]
METHODS = tuple(_module._METHODS)
ESTIMATORS = tuple(_module._ESTIMATORS)
POLARITIES = tuple(_module._POLARITIES)

every_method = pytest.mark.parametrize("method", METHODS)
every_estimator = pytest.mark.parametrize("estimator", ESTIMATORS)


def sheet(dtype=np.uint8):
    """A picture of 3 x 4 dots, and the dots."""
    dots = scenes.grid_of_dots(3, 4, 40, a=8, seed=3)
    scale = 1 if dtype == np.uint8 else 16
    grey = scale * scenes.render((160, 200), dots, noise=1.0, seed=4)
    return scenes.quantise(grey, dtype), dots


def same(a: Targets, b: Targets) -> bool:
    fields = [f.name for f in dataclasses.fields(Targets)]
    return all(np.array_equal(getattr(a, f), getattr(b, f), equal_nan=True) for f in fields)


def _plain():
    y, x = np.mgrid[:240, :320]
    yield "black", np.zeros((240, 320), np.uint8)
    yield "black, 16 bit", np.zeros((240, 320), np.uint16)
    yield "saturated", np.full((240, 320), 255, np.uint8)
    yield "saturated, 16 bit", np.full((240, 320), 65535, np.uint16)
    yield "constant", np.full((240, 320), 2047, np.uint16)
    yield "checkerboard of 1 px", np.uint8(255 * ((x + y) % 2))
    yield "checkerboard of 1 px, 16 bit", np.uint16(65535 * ((x + y) % 2))
    yield "checkerboard of 8 px", np.uint8(255 * ((x // 8 + y // 8) % 2))
    yield "columns of 1 px", np.uint8(255 * (x % 2))
    yield "rows of 1 px", np.uint8(255 * (y % 2))
    yield "one bright pixel", np.uint8(255 * ((x == 100) & (y == 100)))
    for shape in ((0, 0), (0, 50), (50, 0), (1, 1), (1, 5000), (5000, 1), (2, 2), (3, 5000)):
        random = np.random.default_rng(shape[1])
        yield f"noise of {shape}", random.integers(0, 256, shape).astype(np.uint8)
        yield f"noise of {shape}, 16 bit", random.integers(0, 65536, shape).astype(np.uint16)


@every_method
@pytest.mark.parametrize(
    ("name", "image"), list(_plain()), ids=lambda v: v if type(v) is str else ""
)
def test_pictures_without_dots_give_no_targets(method, name, image):
    for polarity in POLARITIES:
        for estimator in ESTIMATORS:
            options = RecognitionOptions(method=method, polarity=polarity, estimator=estimator)
            targets = recognize(image, options)
            assert len(targets) == 0, (polarity, estimator)
            assert targets.centre_px.shape == (0, 2)
            assert targets.cov.shape == (0, 5, 5)


def _noise():
    for seed in (1, 2):
        random = np.random.default_rng(seed)
        shape = (600, 800)
        yield f"uniform {seed}", random.integers(0, 256, shape).astype(np.uint8)
        yield f"uniform, 16 bit {seed}", random.integers(0, 65536, shape).astype(np.uint16)
        yield f"normal, 12 bit {seed}", random.normal(800, 40, shape).astype(np.uint16)
        for share in (0.001, 0.1, 0.5):
            salt = 255 * (random.uniform(size=shape) < share)
            yield f"salt {share} {seed}", salt.astype(np.uint8)
            pepper = 100 + 155 * np.sign(random.uniform(-1, 1, shape)) * (salt > 0)
            yield f"salt and pepper {share} {seed}", np.clip(pepper, 0, 255).astype(np.uint8)


@every_method
@pytest.mark.parametrize(
    ("name", "image"), list(_noise()), ids=lambda v: v if type(v) is str else ""
)
def test_noise_gives_hardly_a_target_and_no_id(method, name, image):
    for polarity in POLARITIES:
        targets = recognize(image, RecognitionOptions(method=method, polarity=polarity))
        assert (targets.id == -1).all()
        # Noise holds round spots by chance; more than a few would be a test left out.
        assert len(targets) <= 3, polarity


@every_method
@every_estimator
def test_a_dot_that_is_saturated_is_found(method, estimator):
    grey = scenes.render((80, 80), [scenes.Dot(40.3, 39.6, 9, 8, 0.4)], white=600, noise=1.0)
    targets = recognize(
        scenes.quantise(grey), RecognitionOptions(method=method, estimator=estimator)
    )
    assert len(targets) == 1
    # Clipping at 255 moves the edge outward all around, not the centre.
    np.testing.assert_allclose(targets.centre_px[0], [40.3, 39.6], atol=0.05)


def _layouts():
    """The same samples in other places of memory."""
    yield "columns first", np.asfortranarray
    yield "transposed twice", lambda image: np.ascontiguousarray(image.T).T
    yield "every second column", lambda image: np.repeat(image, 2, axis=1)[:, ::2]
    yield "every second row", lambda image: np.repeat(image, 2, axis=0)[::2]
    yield "upwards", lambda image: np.ascontiguousarray(image[::-1])[::-1]
    yield "from the right", lambda image: np.ascontiguousarray(image[:, ::-1])[:, ::-1]
    yield "both", lambda image: np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1]
    yield "a window", lambda image: np.pad(image, 9)[9:-9, 9:-9]
    yield "one plane of three", lambda image: np.stack([image] * 3, axis=2)[:, :, 1]
    yield "not aligned", _unaligned
    yield "big-endian", lambda image: image.astype(image.dtype.newbyteorder(">"))
    yield "read-only", _read_only


def _unaligned(image):
    raw = np.zeros(image.nbytes + 1, np.uint8)
    raw[1:] = np.frombuffer(image.tobytes(), np.uint8)
    return raw[1:].view(image.dtype).reshape(image.shape)


def _read_only(image):
    image = image.copy()
    image.setflags(write=False)
    return image


@every_method
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    ("name", "layout"), list(_layouts()), ids=lambda v: v if type(v) is str else ""
)
def test_layout_in_memory_changes_nothing(method, dtype, name, layout):
    image, dots = sheet(dtype)
    options = RecognitionOptions(method=method)
    expected = recognize(image, options)
    assert len(expected) == len(dots)
    laid_out = layout(image)
    before = laid_out.tobytes()
    assert same(recognize(laid_out, options), expected)
    assert laid_out.tobytes() == before


@every_method
def test_views_of_other_pictures_are_measured_as_what_they_show(method):
    image, dots = sheet()
    options = RecognitionOptions(method=method)
    for view in (image.T, image[::-1], image[:, ::-1]):
        assert same(recognize(view, options), recognize(np.ascontiguousarray(view), options))
        assert len(recognize(view, options)) == len(dots)
    # Rows that lie upon each other: one row seen many times.
    assert len(recognize(np.broadcast_to(image[40], (200, 200)), options)) == 0


_WRONG = [
    (np.zeros((9, 9), np.float32), "float32"),
    (np.full((9, 9), np.nan), "float64"),
    (np.zeros((9, 9), np.int32), "int32"),
    (np.zeros((9, 9), np.int8), "int8"),
    (np.zeros((9, 9), np.uint32), "uint32"),
    (np.zeros((9, 9), bool), "bool"),
    (np.zeros((9, 9), complex), "complex"),
    (np.zeros((9, 9), object), "object"),
    (np.zeros((9, 9), "S1"), "S1"),
    (np.zeros((9, 9, 3), np.uint8), "2 dimensions"),
    (np.zeros((1, 9, 9), np.uint16), "2 dimensions"),
    (np.zeros(81, np.uint8), "2 dimensions"),
    (np.uint8(3), "2 dimensions"),
    (None, "2 dimensions"),
    (np.zeros((1, 70000), np.uint8), "65536"),
]


@every_method
@pytest.mark.parametrize(("image", "message"), _WRONG, ids=lambda v: v if type(v) is str else "")
def test_wrong_arrays_are_refused(method, image, message):
    with pytest.raises(ValueError, match=message):
        recognize(image, RecognitionOptions(method=method))


_OPTIONS = [
    ({"method": ""}, "method"),
    ({"method": None}, "method"),
    ({"method": "LOCAL-CANNY"}, "method"),
    ({"estimator": ""}, "estimator"),
    ({"estimator": 1}, "estimator"),
    ({"polarity": True}, "polarity"),
    ({"diameter_px": (5, 5)}, "diameter_px"),
    ({"diameter_px": (5, float("inf"))}, "diameter_px"),
    ({"diameter_px": (-5, 50)}, "diameter_px"),
    ({"diameter_px": ("a", "b")}, "diameter_px"),
    ({"diameter_px": ()}, "diameter_px"),
]


@pytest.mark.parametrize(("options", "message"), _OPTIONS)
def test_wrong_options_are_refused_by_name(options, message):
    with pytest.raises(ValueError, match=f"{message}: expected"):
        recognize(np.zeros((9, 9), np.uint8), RecognitionOptions(**options))


def crowd(count_y, count_x, pitch):
    """Equal dots at sub-pixel places that repeat, painted as one tile: cheap to make."""
    tile = scenes.render(
        (3 * pitch, 3 * pitch),
        [
            scenes.Dot(
                pitch * (i + 0.5) + 0.11 * i, pitch * (j + 0.5) - 0.17 * j, 3.6, 3.3, 0.3 * i
            )
            for i in range(3)
            for j in range(3)
        ],
    )
    return scenes.quantise(np.tile(tile, (count_y // 3, count_x // 3)))


@every_method
def test_fifty_thousand_dots_are_all_found(method):
    image = crowd(213, 240, 14)
    targets = recognize(image, RecognitionOptions(method=method, codes="none"))
    assert len(targets) == 213 * 240  # 51 120
    # Each in a cell of its own.
    cells = np.floor(targets.centre_px / 14).astype(int)
    assert len(np.unique(cells, axis=0)) == len(targets)


_LARGE = """
import json, resource, sys
import numpy as np
from videogrammetry.recognition import RecognitionOptions, recognize

def peak():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

method, pattern = sys.argv[1:]
options = RecognitionOptions(method=method, codes="none")
recognize(np.zeros((64, 64), np.uint8), options)
n = 20_000
image = np.zeros((n, n), np.uint8)
if pattern == "dot":
    y, x = np.mgrid[:60, :60]
    spot = np.clip(10.5 - np.hypot(x - 30.3, y - 29.6), 0, 1)
    for at in (0, n // 2, n - 60):
        image[at : at + 60, at : at + 60] = np.uint8(20 + 200 * spot)
if pattern == "checkerboard":
    row = np.uint8(255 * (np.arange(n) // 8 % 2))
    for at in range(0, n, 8):
        image[at : at + 8] = row if at // 8 % 2 else 255 - row
int(image[:: 4096 // n + 1, ::4096].sum())
image[:] += 0 if pattern != "black" else 1  # every page in memory
before = peak()
targets = recognize(image, options)
print(json.dumps({
    "centre": targets.centre_px.round(1).tolist(), "growth": peak() - before,
}))
"""


@every_method
@pytest.mark.parametrize("pattern", ["black", "dot", "checkerboard"])
def test_a_picture_of_400_million_pixels_takes_little_more_memory(method, pattern):
    done = subprocess.run(
        [sys.executable, "-c", _LARGE, method, pattern],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    expected = [[at + 30.3, at + 29.6] for at in (0, 10_000, 19_940)] if pattern == "dot" else []
    assert found["centre"] == expected
    # No second copy of the picture's 400 MB; chords of the search may stand in memory.
    assert found["growth"] < 400e6
