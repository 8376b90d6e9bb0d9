"""What is learned of a camera: once, the same by any way, and handed on."""

import copy
import dataclasses
import json
import math
import pickle

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry.recognition import (
    CameraModel,
    RecognitionOptions,
    learn_camera,
    recognize,
    recognize_sequence,
)
from videogrammetry.recognition.camera_model import pool_models
from videogrammetry.types import Targets

FIELDS = [f.name for f in dataclasses.fields(Targets)]
FAST = RecognitionOptions(method="edge-pair", estimator="model", codes="none")
NUMBERS = {
    "gradient_threshold": 40,
    "blur_px": 0.8,
    "blur_sigma_px": 0.02,
    "noise_at_zero": 2.0,
    "noise_per_grey": 0.03,
    "noise_least": 0.5,
    "light_gradient": 0.01,
    "second_threshold": 0,
    "flare": 0.01,
}


def film(count=12, *, empty=(), psf=0.7, noise=1.5, dots=True):
    """Frames of 160 x 120 with six dots that move; those of ``empty`` have none."""
    frames = []
    for k in range(count):
        there = [
            scenes.Dot(30.0 + 45 * i + 0.3 * k, 35 + 45.0 * j + 0.2 * k, 7, 6, 0.5)
            for i in range(3)
            for j in range(2)
        ]
        shown = there if dots and k not in empty else []
        grey = scenes.render((120, 160), shown, psf=psf, noise=noise, seed=k)
        frames.append(scenes.quantise(grey))
    return np.stack(frames)


def assert_same(found, expected):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def test_it_is_what_was_rendered():
    # The blur of the lens and of the pixel's square; noise and rounding.
    psf, noise = 0.9, 3.0
    model = learn_camera(film(5, psf=psf, noise=noise), FAST)
    assert model.blur_px == pytest.approx(math.sqrt(psf**2 + 1 / 12), abs=4 * model.blur_sigma_px)
    # Plateaus of some hundred pixels in each of five pictures: the variance is known
    # to sqrt(2 / 100), and dots' edges come into it a little.
    for grey in (20, 200):
        assert model.noise_variance(grey) == pytest.approx(noise**2 + 1 / 12, rel=0.5)
    assert 0 < model.gradient_threshold < 60


def test_black_on_white_counts_the_negatives():
    frames = 255 - film(3)
    model = learn_camera(frames, dataclasses.replace(FAST, polarity="black-on-white"))
    assert model.noise_per_grey <= 0
    assert model.noise_variance(-55.0) > 0


def test_a_picture_measured_by_its_own_model_is_as_by_itself():
    # The start of each dot depends on the blur that is assumed: a little differs.
    frame = film(1)[0]
    alone, known = recognize(frame, FAST), recognize(frame, FAST, camera=learn_camera(frame, FAST))
    assert len(alone) == len(known) == 6
    np.testing.assert_allclose(alone.centre_px, known.centre_px, atol=1e-3)


@pytest.mark.parametrize("num_threads", [0, 1, 2, 5])
def test_learning_depends_on_the_frames_alone(num_threads):
    frames = film()
    model = learn_camera(frames, FAST)
    for kind in (frames, list(frames), Reader(frames)):
        found = recognize_sequence(kind, FAST, num_threads=num_threads)
        assert found.camera == model
        assert len(found.targets) == 72
        given = recognize_sequence(kind, FAST, camera=model, num_threads=num_threads)
        assert given.camera == model
        assert_same(given.targets, found.targets)
        for i, frame in enumerate(frames):
            assert_same(found[i], recognize(frame, FAST, camera=model))


class Reader:
    """A source that counts."""

    def __init__(self, frames, bad=()):
        self.frames, self.bad, self.reads = frames, bad, []

    def __len__(self):
        return len(self.frames)

    def read(self, index):
        self.reads.append(index)
        if index in self.bad:
            raise ValueError("damaged")
        return self.frames[index]


def test_parts_agree_if_they_are_given_the_model():
    frames = film()
    whole = recognize_sequence(frames, FAST)
    parts = [
        recognize_sequence(frames, FAST, camera=whole.camera, first=a, last=b)
        for a, b in ((0, 4), (5, 11))
    ]
    for name in FIELDS:
        joined = np.concatenate([getattr(part.targets, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole.targets, name), err_msg=name)
    assert learn_camera(frames, FAST, first=5, last=8) == learn_camera(frames[5:9], FAST)


def test_frames_are_spread_over_the_sequence():
    source = Reader(film(13))
    learn_camera(source, FAST)
    assert source.reads == [0, 3, 6, 9, 12]
    source.reads.clear()
    learn_camera(source, FAST, first=4, last=4)
    assert source.reads == [4]


def test_pictures_without_targets_teach_nothing():
    frames = film(13, empty=(0, 3, 6, 12))
    assert learn_camera(frames, FAST) == learn_camera(frames[9], FAST)
    # None of the five: the first of the others that has some.
    frames = film(13, empty=(0, 1, 3, 6, 9, 12))
    assert learn_camera(frames, FAST) == learn_camera(frames[2], FAST)
    blank = film(6, dots=False)
    assert learn_camera(blank, FAST) is None
    found = recognize_sequence(blank, FAST)
    assert found.camera is None
    assert len(found.targets) == 0
    assert learn_camera(np.zeros((0, 9, 9), np.uint8), FAST) is None


def test_a_long_sequence_of_nothing_is_not_searched_whole():
    source = Reader([np.zeros((30, 40), np.uint8)] * 500)
    assert learn_camera(source, FAST) is None
    assert len(source.reads) <= 5 + 32


def test_frames_that_cannot_be_read_teach_nothing():
    source = Reader(film(13), bad=(3, 6))
    frames = source.frames[[0, 9, 12]]
    assert learn_camera(source, FAST) == learn_camera(frames, FAST)


def test_the_paper_s_way_has_none():
    options = RecognitionOptions(method="local-canny")
    frames = film(3)
    assert learn_camera(frames, options) is None
    source = Reader(frames)
    found = recognize_sequence(source, options)
    assert found.camera is None
    assert sorted(source.reads) == [0, 1, 2]
    given = recognize_sequence(frames, options, camera=CameraModel(**NUMBERS))
    assert given.camera is None
    assert_same(given.targets, found.targets)


def test_each_for_itself():
    frames = film(4)
    found = recognize_sequence(frames, FAST, camera=None)
    assert found.camera is None
    for i, frame in enumerate(frames):
        assert_same(found[i], recognize(frame, FAST))


def test_frames_of_another_depth_say_for_themselves():
    eight = film(4)
    sixteen = eight.astype(np.uint16) * 200
    mixed = [eight[0], eight[1], sixteen[2], eight[3]]
    for kind in (mixed, Reader(mixed)):
        found = recognize_sequence(kind, FAST)
        assert found.camera == learn_camera(mixed, FAST)
        assert_same(found[2], recognize(mixed[2], FAST))
        assert_same(found[3], recognize(mixed[3], FAST, camera=found.camera))
        assert len(found.targets) == 24


def test_pooling_takes_medians_and_the_blur_s_spread():
    one = CameraModel(**NUMBERS)
    assert pool_models([]) is None
    assert pool_models([one]) is one
    same = pool_models([one] * 5)
    assert same.to_dict() == pytest.approx(one.to_dict(), rel=1e-15)
    blurs, thresholds = (0.7, 0.8, 1.5), (40, 50, 60)
    three = pool_models(
        [
            dataclasses.replace(one, blur_px=b, gradient_threshold=t)
            for b, t in zip(blurs, thresholds, strict=True)
        ]
    )
    assert (three.blur_px, three.gradient_threshold) == (0.8, 50)
    assert three.blur_sigma_px == pytest.approx(math.hypot(0.02, 1.4826 * 0.1))
    two = pool_models([one, dataclasses.replace(one, gradient_threshold=90)])
    assert two.gradient_threshold == 40
    # Textured dots need not be in every picture.
    some = pool_models([one, one, dataclasses.replace(one, second_threshold=120)])
    assert some.second_threshold == 120


def test_it_goes_through_files():
    model = learn_camera(film(2), FAST)
    values = model.to_dict()
    assert list(values) == list(NUMBERS)
    assert CameraModel.from_dict(json.loads(json.dumps(values))) == model
    # As attributes of HDF5 come back.
    stored = {name: np.asarray(value)[()] for name, value in values.items()}
    assert CameraModel.from_dict(stored) == model
    recognize(film(1)[0], FAST, camera=model)
    for copied in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert copied == model
    assert hash(model) == hash(CameraModel.from_dict(values))
    with pytest.raises(ValueError, match=r"camera model: .*missing: blur_px, unknown: blurr_px"):
        CameraModel.from_dict(
            {**{n: v for n, v in values.items() if n != "blur_px"}, "blurr_px": 1}
        )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gradient_threshold", 0),
        ("second_threshold", -1),
        ("second_threshold", 70000),
        ("gradient_threshold", 65536),
        ("gradient_threshold", 3.5),
        ("gradient_threshold", True),
        ("blur_px", 0.0),
        ("blur_px", math.nan),
        ("blur_px", "0.8"),
        ("blur_sigma_px", 0),
        ("blur_sigma_px", math.inf),
        ("noise_at_zero", math.inf),
        ("noise_at_zero", -math.inf),
        ("noise_per_grey", math.nan),
        ("noise_least", 0.0),
        ("noise_least", None),
        ("light_gradient", 0.0),
        ("light_gradient", 1.5),
        ("flare", 0.0),
    ],
)
def test_numbers_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=f"^{name}: expected .* got {value!r}"):
        CameraModel(**{**NUMBERS, name: value})


def test_wrong_arguments_are_named():
    frames = film(2)
    with pytest.raises(ValueError, match="camera: expected a CameraModel or None, got 'learn'"):
        recognize(frames[0], FAST, camera="learn")
    for camera in ("learned", 3, NUMBERS):
        with pytest.raises(ValueError, match="camera: expected a CameraModel"):
            recognize_sequence(frames, FAST, camera=camera)
    with pytest.raises(ValueError, match="first, last"):
        learn_camera(frames, FAST, first=2)
    with pytest.raises(ValueError, match="float64"):
        learn_camera(frames[0].astype(float), FAST)
    with pytest.raises(dataclasses.FrozenInstanceError):
        CameraModel(**NUMBERS).blur_px = 1.0
