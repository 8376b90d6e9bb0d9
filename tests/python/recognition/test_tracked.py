"""Targets followed from frame to frame: what whole frames give, where windows look."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
import pytest
import recognition_scenes as scenes
from scipy.ndimage import gaussian_filter

from videogrammetry._core import recognition as core
from videogrammetry.errors import SequenceError
from videogrammetry.recognition import (
    PackedFrame,
    RecognitionOptions,
    TrackedOptions,
    code_family,
    learn_camera,
    recognize_sequence,
)
from videogrammetry.sequence import create_sequence, open_sequence
from videogrammetry.sequence.packing import pack_12bit
from videogrammetry.types import Targets

FIELDS = [f.name for f in dataclasses.fields(Targets)]
FAST = RecognitionOptions(method="edge-pair", estimator="model")
TRACK = TrackedOptions()
CODES = code_family("schneider-14").codes
COUNT = 20
#: Of the 12 targets, the one that is hidden, from and to which frame, and one that
#: comes between the windows of the others.
HIDDEN, NEW = 7, 6


def dots_at(frame):
    """Twelve targets on circles of 8 px, every third with a code: steps of 1.2 px."""
    for i in range(12):
        t = 0.15 * frame + i
        yield scenes.Dot(
            50.0 + 70.0 * (i % 4) + 8 * math.cos(t),
            50.0 + 70.0 * (i // 4) + 8 * math.sin(t),
            6.0 + 0.2 * i,
            5.0 + 0.2 * i,
            0.2 * i,
            scenes.code_bits(CODES[40 + i], 14) if i % 3 == 0 else None,
        )


@lru_cache
def film(dtype=np.uint8, *, hidden=(), comes=0, count=COUNT):
    """Frames of 310 x 240; target HIDDEN is not there in ``hidden``, NEW before ``comes``."""
    frames = []
    for k in range(count):
        gone = {HIDDEN} if k in hidden else set()
        gone |= {NEW} if k < comes else set()
        dots = [dot for i, dot in enumerate(dots_at(k)) if i not in gone]
        grey = scenes.render((240, 310), dots, noise=1.5, seed=k)
        if dtype == np.uint16:
            grey = np.clip(16 * grey, 0, 4095)
        frames.append(scenes.quantise(grey, dtype))
    stack = np.stack(frames)
    stack.flags.writeable = False
    return stack


def packed(frames):
    return [PackedFrame(pack_12bit(frame), frame.shape) for frame in frames]


def assert_same(found, expected, names=FIELDS):
    for name in names:
        a, b = getattr(found, name), getattr(expected, name)
        assert (a.dtype, a.shape) == (b.dtype, b.shape), name
        np.testing.assert_array_equal(a, b, err_msg=name)


def assert_alike(found, expected):
    """The same targets, to what is left of where their fits began: a part of the sigma that
    adds less than three hundredths to it, sqrt(1 + 0.25^2) - 1."""
    assert_same(found, expected, ["id", "ring_status"])
    sigma = np.sqrt(np.diagonal(expected.cov, axis1=1, axis2=2))
    assert (np.abs(found.centre_px - expected.centre_px) <= 0.25 * sigma[:, :2]).all()
    assert (np.abs(found.semi_axes_px - expected.semi_axes_px) <= 0.25 * sigma[:, 2:4]).all()
    np.testing.assert_allclose(found.contrast, expected.contrast, rtol=0.01)
    np.testing.assert_allclose(found.id_confidence, expected.id_confidence, atol=1e-3)


class Source:
    """A source that counts what it reads."""

    def __init__(self, frames, bad=None):
        self.frames, self.bad, self.reads = frames, bad, []

    def __len__(self):
        return len(self.frames)

    def name(self, index):
        return f"pic_{index:03}.tif"

    def read(self, index):
        self.reads.append(index)
        if index == self.bad:
            raise OSError("gone")
        return self.frames[index]


def test_options_equal_those_of_the_core():
    ours, theirs = TrackedOptions(), core.TrackedOptions()
    fields = {f.name: getattr(ours, f.name) for f in dataclasses.fields(ours)}
    assert {n: getattr(theirs, n) for n in dir(theirs) if not n.startswith("_")} == fields
    with pytest.raises(dataclasses.FrozenInstanceError):
        ours.full_every = 3
    with pytest.raises(TypeError):
        TrackedOptions(3)


@pytest.mark.parametrize("estimator", ["mean-gradient", "dual-conic", "model"])
@pytest.mark.parametrize("kind", [np.asarray, list, Source, packed])
def test_equals_the_search_of_whole_frames(kind, estimator):
    options = RecognitionOptions(method="edge-pair", estimator=estimator)
    for dtype in (np.uint16,) if kind is packed else (np.uint8, np.uint16):
        frames = film(dtype)
        expected = recognize_sequence(frames, options)
        assert expected.full is expected.lost is None
        found = recognize_sequence(kind(frames), options, track=TRACK)
        assert np.diff(found.offsets).tolist() == [12] * COUNT
        assert_same(found, expected, ["offsets", "frame"])
        if estimator == "model":  # measured from where the frame before had them
            assert_alike(found.targets, expected.targets)
        else:
            assert_same(found.targets, expected.targets)
        assert (found.targets.id > 0).sum() == 4 * COUNT
        assert found.camera == expected.camera
        assert (found.full.dtype, found.lost.dtype) == (bool, np.int32)
        assert found.full.tolist() == [True] + [False] * (COUNT - 1)
        assert found.lost.tolist() == [0] * COUNT


def with_clutter(frames, seed):
    """The frames on a ground of patches, which the targets' whereabouts are free of."""
    random = np.random.default_rng(seed)
    ground = np.zeros(frames.shape[1:])
    for _ in range(300):
        x, y, w, h = random.integers(0, 300), random.integers(0, 230), *random.integers(2, 25, 2)
        ground[y : y + h, x : x + w] = random.uniform(0, 150)
    y, x = np.mgrid[: ground.shape[0], : ground.shape[1]]
    for i, dot in enumerate(dots_at(0)):
        middle = 50.0 + 70.0 * (i % 4), 50.0 + 70.0 * (i // 4)
        free = 8 + dot.a * (3.4 if dot.bits else 1.5) + 3
        ground[np.hypot(x - middle[0], y - middle[1]) < free] = 0
    return scenes.quantise(frames + gaussian_filter(ground, 0.7))


@pytest.mark.parametrize("estimator", ["mean-gradient", "dual-conic", "model"])
def test_clutter_moves_no_target_by_what_would_count(estimator):
    """Where clutter or another window lets a dot's area begin at another chord, its fit
    begins elsewhere and ends where it has converged: within a part of the sigma that
    adds less than two hundredths to it, sqrt(1 + 0.2^2) - 1."""
    options = RecognitionOptions(method="edge-pair", estimator=estimator)
    for seed in range(4):
        frames = with_clutter(film(), seed)
        found = recognize_sequence(frames, options, track=TRACK)
        expected = recognize_sequence(frames, options)
        for k in range(COUNT):
            whole, ours = expected[k], found[k]
            for dot in dots_at(k):
                place = (dot.x, dot.y)
                (i,) = np.flatnonzero(np.hypot(*(whole.centre_px - place).T) < 1)
                (j,) = np.flatnonzero(np.hypot(*(ours.centre_px - place).T) < 1)
                sigma_px = np.sqrt(np.diag(whole.cov[i])[:2])
                off = np.abs(whole.centre_px[i] - ours.centre_px[j])
                assert (off <= 0.2 * sigma_px).all(), f"seed {seed}, frame {k}, {place}"
                assert whole.id[i] == ours.id[j]


def test_a_model_given_is_used():
    frames = film()
    model = learn_camera(frames[3], FAST)
    found = recognize_sequence(frames, FAST, camera=model, track=TRACK)
    expected = recognize_sequence(frames, FAST, camera=model)
    assert found.camera == expected.camera == model
    assert found.camera != recognize_sequence(frames, FAST, track=TRACK).camera
    assert_alike(found.targets, expected.targets)


@pytest.mark.parametrize("kind", [np.asarray, Source])
def test_a_part_is_followed_from_its_first_frame(kind):
    frames = film()
    found = recognize_sequence(kind(frames), FAST, track=TRACK, first=4, last=9)
    assert found.frame.tolist() == [4, 5, 6, 7, 8, 9]
    assert found.full.tolist() == [True] + [False] * 5
    assert_alike(found.targets, recognize_sequence(frames, FAST, first=4, last=9).targets)


@pytest.mark.parametrize("full_every", [1, 7, 10])
def test_whole_frames_take_their_turn(full_every):
    track = TrackedOptions(full_every=full_every)
    found = recognize_sequence(film(), FAST, track=track)
    assert found.full.tolist() == [k % full_every == 0 for k in range(COUNT)]


def test_a_target_that_is_lost_is_found_again():
    frames = film(hidden=tuple(range(4, 13)))
    found = recognize_sequence(frames, FAST, track=TrackedOptions(full_every=8))
    expected = recognize_sequence(frames, FAST)
    assert found.lost.tolist() == [int(k == 4) for k in range(COUNT)]
    # Where it is lost, and by turn; the latter sees what is back since frame 13.
    assert np.flatnonzero(found.full).tolist() == [0, 4, 8, 16]
    for k in range(COUNT):
        assert len(expected[k]) == (11 if 4 <= k < 13 else 12)
        if 13 <= k < 16:
            assert len(found[k]) == 11
            apart = found[k].centre_px[:, None] - expected[k].centre_px
            assert (np.hypot(*apart.T).min(axis=0) < 0.1).all()
        else:
            assert_alike(found[k], expected[k])


def test_what_is_new_between_windows_waits_for_a_whole_frame():
    frames = film(comes=5)
    found = recognize_sequence(frames, FAST, track=TrackedOptions(full_every=10, margin_px=2))
    assert np.diff(found.offsets).tolist() == [11] * 10 + [12] * 10
    assert found.lost.tolist() == [0] * COUNT


def test_a_recording_is_read_where_it_stands(tmp_path, monkeypatch):
    frames = film(np.uint16)
    with create_sequence(
        tmp_path / "run",
        format="mraw",
        image_size_px=frames.shape[:0:-1],
        num_frames=COUNT,
        bit_depth=12,
    ) as writer:
        for frame in frames:
            writer.append(frame)
    joined = open_sequence(tmp_path / "run.cihx")
    (source,) = joined.sources
    monkeypatch.setattr(type(source), "read", lambda *_: pytest.fail("a frame was unpacked"))
    found = recognize_sequence(joined, FAST, track=TRACK)
    assert found.full.sum() == 1
    assert_alike(found.targets, recognize_sequence(frames, FAST).targets)


@pytest.mark.parametrize("num_threads", [0, 1, 5])
def test_threads_change_nothing(num_threads):
    source = Source(film())
    found = recognize_sequence(source, FAST, track=TRACK, num_threads=num_threads)
    assert source.reads[-COUNT:] == list(range(COUNT))
    assert_alike(found.targets, recognize_sequence(film(), FAST).targets)


def test_cameras_side_by_side():
    films = [film(), film(hidden=tuple(range(4, 13))), film(np.uint16)] * 2

    def follow(frames):
        return recognize_sequence(frames, FAST, track=TRACK)

    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(follow, films))
    for found, frames in zip(together, films, strict=True):
        alone = follow(frames)
        assert_same(found.targets, alone.targets)
        assert_same(found, alone, ["full", "lost", "offsets"])


@pytest.mark.parametrize("kind", [np.asarray, Source])
def test_progress_is_told_of_every_frame_and_may_stop(kind, monkeypatch):
    monkeypatch.setattr(
        "videogrammetry.recognition.sequence._HELD_BYTES", 0
    )  # large frames: one at a time
    told = []
    recognize_sequence(kind(film()), FAST, track=TRACK, progress=lambda *a: told.append(a))
    assert told == [(k + 1, COUNT) for k in range(COUNT)]

    def interrupt(done, total):
        if done == 3:
            raise KeyboardInterrupt

    frames = kind(film())
    with pytest.raises(KeyboardInterrupt):
        recognize_sequence(
            frames, FAST, track=TRACK, progress=interrupt, camera=learn_camera(film(), FAST)
        )
    if kind is Source:
        assert frames.reads == [0, 1, 2]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"options": RecognitionOptions(method="local-canny")},
            "method: .*'edge-pair' alone, got 'local-canny'",
        ),
        ({"camera": None}, "camera: expected a CameraModel or 'learn' with track, got None"),
        ({"camera": "lern"}, "camera: expected a CameraModel, 'learn' or None, got 'lern'"),
        ({"track": TrackedOptions(full_every=0)}, "full_every: expected 1 or more, got 0"),
        ({"track": TrackedOptions(full_every=2.5)}, "full_every: expected a whole .* got 2.5"),
        ({"track": TrackedOptions(full_every=1 << 40)}, "full_every: expected 1 to 2147483647"),
        ({"track": TrackedOptions(margin_px=0.5)}, "margin_px: expected 1 ... 1000, got 0.5"),
        ({"track": TrackedOptions(margin_px=math.nan)}, "margin_px: expected 1 ... 1000, got nan"),
        ({"track": TrackedOptions(margin_px="4px")}, "margin_px: expected a number, got '4px'"),
        ({"track": True}, "track: expected TrackedOptions or None, got True"),
        ({"num_threads": -1}, "num_threads"),
    ],
)
def test_what_is_wrong_is_refused_before_a_frame_is_read(given, message):
    source = Source(film())
    arguments = {"options": FAST, "track": TRACK} | given
    with pytest.raises(ValueError, match=message):
        recognize_sequence(source, **arguments)
    assert source.reads == []


def test_a_bad_frame_is_named():
    with pytest.raises(SequenceError, match=r"^pic_004\.tif: gone$"):
        recognize_sequence(Source(film(), bad=4), FAST, track=TRACK)
    frames = list(film())
    frames[2] = frames[2].astype(float)
    with pytest.raises(ValueError, match="frame 3: .*float64"):
        recognize_sequence(frames, FAST, track=TRACK)


@pytest.mark.parametrize("frames", [np.zeros((0, 40, 60), np.uint8), [], Source([])])
def test_a_sequence_without_frames(frames):
    found = recognize_sequence(frames, FAST, track=TRACK)
    assert len(found) == len(found.targets) == len(found.full) == len(found.lost) == 0
    assert (found.full.dtype, found.lost.dtype) == (bool, np.int32)
    assert found.camera is None


def test_frames_of_other_size_and_depth():
    """Of another depth they say for themselves, as without following."""
    eight, deep = film(), film(np.uint16)
    frames = [eight[0], eight[1], deep[2], eight[3], eight[4][:150, :200], np.zeros((0, 0), "u1")]
    frames += [eight[5], eight[6]]
    found = recognize_sequence(frames, FAST, track=TRACK)
    expected = recognize_sequence(frames, FAST)
    assert found.camera == expected.camera
    assert len(found[2]) == 12
    assert found.full[2]
    for k in (0, 1, 2, 3, 5, 6, 7):
        assert_alike(found[k], expected[k])
    # The smaller frame has lost the targets that lie beyond it, the next one all.
    assert np.flatnonzero(found.full).tolist() == [0, 2, 4, 5, 6]
    assert np.flatnonzero(found.lost).tolist() == [4, 5]


def test_where_nothing_is_learned_the_first_target_gives_the_model():
    frames = np.full((120, 240, 310), 20, np.uint8)
    # Beside the frames that are looked at beforehand, of which none shows a target.
    looked = {i * 119 // 4 for i in range(5)} | {i * 119 // 31 for i in range(32)}
    shown = [k for k in range(50, 70) if k not in looked]
    frames[shown] = film()[: len(shown)]
    assert recognize_sequence(frames, FAST).camera is None
    found = recognize_sequence(frames, FAST, track=TRACK)
    assert found.camera == learn_camera(frames[shown[0]], FAST)
    given = recognize_sequence(frames, FAST, camera=found.camera)
    assert np.diff(given.offsets)[shown].tolist() == [12] * len(shown)
    assert_alike(found.targets, given.targets)


def test_frames_that_no_model_comes_of_say_for_themselves():
    y, x = np.mgrid[:60, :80]
    far = np.stack([np.hypot(x - 40 - shift, y - 30.5) for shift in range(3)])
    frames = np.uint8(20 + 200 * np.clip(10.5 - far, 0, 1))  # edges of one pixel
    found = recognize_sequence(frames, FAST, track=TRACK)
    assert found.camera is None
    assert found.full.all()
    assert len(found.targets) == 3
    assert_alike(found.targets, recognize_sequence(frames, FAST).targets)


def test_after_frames_without_light_all_is_found_again():
    frames = film().copy()
    frames[5:9] = 20
    found = recognize_sequence(frames, FAST, track=TRACK)
    assert found.lost.tolist() == [12 * (k == 5) for k in range(COUNT)]
    assert np.flatnonzero(found.full).tolist() == [0, 5, 6, 7, 8, 9]
    assert_alike(found.targets, recognize_sequence(frames, FAST).targets)


def test_the_core_takes_frames_one_by_one():
    frames = film(np.uint16)
    tracker = core.TrackedRecognizer(
        core.RecognitionOptions(method="edge-pair"), core.named_code_family("schneider-14"), 5, 4.0
    )
    assert tracker.camera is None
    for k, frame in enumerate([frames[0], *(f.core for f in packed(frames[1:4])), *frames[4:7]]):
        found = tracker.next(frame)
        assert set(found) == {*FIELDS, "full", "lost"}
        assert (len(found["id"]), found["full"], found["lost"]) == (12, k % 5 == 0, 0)
    several = tracker.follow(list(frames[7:11]))
    assert several["offsets"].tolist() == [0, 12, 24, 36, 48]
    assert (several["full"].tolist(), several["lost"].tolist()) == ([0, 0, 0, 1], [0] * 4)
    assert tracker.camera.blur_px > 0
    with pytest.raises(ValueError, match="uint8 or uint16"):
        tracker.next(frames[0].astype(float))
    with pytest.raises(ValueError, match="full_every"):
        core.TrackedRecognizer(core.RecognitionOptions(), core.named_code_family("none"), 0)


def test_pictures_that_have_little_in_common_are_searched_whole():
    """Stages far apart: what stands by chance where something is expected hides no loss."""
    frames = film().copy()
    frames[3] = frames[3, ::-1]
    frames[4] = frames[4, :, ::-1]
    found = recognize_sequence(frames[:6], FAST, track=TRACK)
    expected = recognize_sequence(frames[:6], FAST)
    assert np.diff(found.offsets).tolist() == np.diff(expected.offsets).tolist() == [12] * 6
    assert found.full.tolist() == [True, False, False, True, True, True]
