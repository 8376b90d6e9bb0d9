import dataclasses
import itertools
import threading
import time
import weakref

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry.errors import SequenceError
from videogrammetry.recognition import (
    RecognitionOptions,
    TargetSequence,
    code_family,
    recognize,
    recognize_sequence,
)
from videogrammetry.sequence import as_source
from videogrammetry.types import Targets

FIELDS = [f.name for f in dataclasses.fields(Targets)]
THREADS = (0, 1, 2, 5)


def film(count=11, dtype=np.uint8):
    """Frames of 160 x 120 with a code and 0 to 2 dots each; every fourth is empty."""
    bits = scenes.code_bits(code_family("schneider-14").codes[50], 14)
    frames = []
    for k in range(count):
        dots = [scenes.Dot(45.0 + 0.7 * k, 50.3, 9, 8, 0.3, bits, turn=0.2 * k)]
        dots += [scenes.Dot(110.0 + 0.3 * k, 30 + 45.0 * j, 7, 6, 0.5) for j in range(k % 3)]
        grey = scenes.render((120, 160), dots if k % 4 else [], noise=1.5, seed=k)
        frames.append(scenes.quantise(grey * (1 if dtype == np.uint8 else 16), dtype))
    return np.stack(frames)


class Source:
    """Frames with names, whose reading is watched."""

    def __init__(self, frames, bad=(), pause_s=0.0):
        self.frames, self.bad, self.pause_s = frames, dict(bad), pause_s
        self.alive = self.most = self.reads = 0
        self.lock = threading.Lock()

    def __len__(self):
        return len(self.frames)

    def name(self, index):
        return f"pic_{index:03}.tif"

    def read(self, index):
        if index in self.bad:
            raise self.bad[index]
        frame = np.array(self.frames[index])
        with self.lock:
            self.reads += 1
            self.alive += 1
            self.most = max(self.most, self.alive)
        weakref.finalize(frame, self._gone)
        time.sleep(self.pause_s)
        return frame

    def _gone(self):
        with self.lock:
            self.alive -= 1


def check_equal(found, frames, options=None):
    """``found`` is recognize() of each frame, bit for bit and type for type."""
    single = [recognize(frame, options, camera=found.camera) for frame in frames]
    assert len(found) == len(single)
    assert found.offsets.tolist() == [0, *itertools.accumulate(map(len, single))]
    assert found.offsets.dtype == found.frame.dtype == np.int64
    assert len(found.targets) == found.offsets[-1]
    for ours, theirs in zip(found, single, strict=True):
        for name in FIELDS:
            a, b = getattr(ours, name), getattr(theirs, name)
            assert (a.dtype, a.shape) == (b.dtype, b.shape), name
            np.testing.assert_array_equal(a, b, err_msg=name)


@pytest.mark.parametrize("num_threads", THREADS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("kind", [np.asarray, list, Source, as_source])
def test_equals_recognize_frame_by_frame(kind, dtype, num_threads):
    frames = film(dtype=dtype)
    found = recognize_sequence(kind(frames), num_threads=num_threads)
    check_equal(found, frames)
    counts = [len(targets) for targets in found]
    assert counts == [0 if k % 4 == 0 else 1 + k % 3 for k in range(11)]
    assert (found.targets.id == 51).sum() == 8
    assert found.frame.tolist() == list(range(11))


def test_options_are_used():
    frames = 255 - film(5)
    options = RecognitionOptions(polarity="black-on-white", codes="none")
    for kind in (np.asarray, Source):
        found = recognize_sequence(kind(frames), options)
        check_equal(found, frames, options)
        assert len(found.targets)


def test_runs_of_many_small_frames_join():
    # More frames than one run has: 2^20 / (40 * 40) = 655.
    small = film(3)[1:, 30:70, 25:65]
    frames = np.concatenate([small] * 400)
    told = []
    found = recognize_sequence(frames, num_threads=1, progress=lambda *a: told.append(a))
    assert told == [(655, 800), (800, 800)]
    check_equal(found, frames)
    assert len(found.targets)


def test_views_are_no_copies():
    found = recognize_sequence(film())
    assert isinstance(found, TargetSequence)
    for name in FIELDS:
        assert np.shares_memory(getattr(found[5], name), getattr(found.targets, name)), name
    np.testing.assert_array_equal(found[-1].centre_px, found[10].centre_px)
    np.testing.assert_array_equal(found[np.int64(3)].centre_px, found[3].centre_px)
    for index in (11, -12):
        with pytest.raises(IndexError, match=f"{index} of 11"):
            found[index]
    with pytest.raises(TypeError):
        found["1"]
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.offsets = None


def test_a_part_of_the_sequence():
    frames = film()
    for kind in (np.asarray, Source):
        source = kind(frames)
        found = recognize_sequence(source, first=3, last=6)
        check_equal(found, frames[3:7])
        assert found.frame.tolist() == [3, 4, 5, 6]
        assert recognize_sequence(source, first=9).frame.tolist() == [9, 10]
        assert recognize_sequence(source, last=0).frame.tolist() == [0]
        for first, last in ((-1, None), (0, 11), (5, 4), (11, None)):
            with pytest.raises(ValueError, match=f"first, last: .*10.*{first} and {last}"):
                recognize_sequence(source, first=first, last=last)


@pytest.mark.parametrize("frames", [np.zeros((0, 40, 60), np.uint8), [], Source([])])
def test_a_sequence_without_frames(frames):
    found = recognize_sequence(frames)
    assert len(found) == 0
    assert list(found) == []
    assert found.offsets.tolist() == [0]
    blank = recognize(np.zeros((9, 9), np.uint8))
    for name in FIELDS:
        a, b = getattr(found.targets, name), getattr(blank, name)
        assert (a.dtype, a.shape) == (b.dtype, b.shape), name


@pytest.mark.parametrize("shape", [(3, 0, 0), (3, 0, 50), (3, 50, 0), (3, 1, 500), (3, 500, 1)])
@pytest.mark.parametrize("kind", [np.asarray, list, Source])
def test_frames_of_no_extent(kind, shape):
    found = recognize_sequence(kind(np.ones(shape, np.uint16)))
    assert found.offsets.tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("num_threads", THREADS)
def test_strides_and_byte_orders_are_honoured(num_threads):
    frames = film(dtype=np.uint16)
    wide = np.full((11, 130, 190), 65535, np.uint16)
    wide[:, 4:124, 20:180] = frames
    other = [
        wide[:, 4:124, 20:180],
        np.asfortranarray(frames),
        frames[::-1][::-1],
        frames[:, :, ::-1].copy()[:, :, ::-1],
        frames.astype(">u2"),
    ]
    for stack in other:
        check_equal(recognize_sequence(stack, num_threads=num_threads), frames)
        check_equal(recognize_sequence(Source(stack), num_threads=num_threads), frames)
    readonly = frames.copy()
    readonly.flags.writeable = False
    check_equal(recognize_sequence(readonly, num_threads=num_threads), frames)


def test_frames_of_different_size_and_depth():
    frames = [*film(3), *film(3, np.uint16), film(2)[1][:90, :100]]
    for kind in (list, Source):
        check_equal(recognize_sequence(kind(frames), camera=None, num_threads=2), frames)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros((4, 4), np.uint8), "3 dimensions"),
        (np.zeros((2, 4, 4, 3), np.uint8), "3 dimensions"),
        (np.zeros((2, 4, 4), np.float32), "float32"),
        (np.zeros((2, 4, 4), np.int16), "int16"),
        (np.zeros((0, 4, 4), bool), "bool"),
        ([np.zeros((4, 4), np.uint8), np.zeros((4, 4))], "frame 2: .*float64"),
        ([np.zeros((4, 4), np.uint8), np.zeros(4, np.uint8)], "frame 2: .*2 dimensions"),
    ],
)
def test_wrong_arrays_are_refused(frames, message):
    with pytest.raises(ValueError, match=message):
        recognize_sequence(frames)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"polarity": "white"}, "polarity"), ({"codes": "qr"}, "codes"), ({"diameter_px": 5}, "diam")],
)
def test_wrong_options_are_refused_before_a_frame_is_read(options, message):
    source = Source(film(3))
    with pytest.raises(ValueError, match=message):
        recognize_sequence(source, RecognitionOptions(**options))
    with pytest.raises(ValueError, match="num_threads"):
        recognize_sequence(source, num_threads=-1)
    assert source.reads == 0


@pytest.mark.parametrize("num_threads", THREADS)
@pytest.mark.parametrize(
    "error", [SequenceError("cut short"), ValueError("not a picture"), OSError("gone")]
)
def test_the_first_bad_frame_is_named(error, num_threads):
    source = Source(film(), bad={4: error, 5: type(error)("later"), 9: error})
    with pytest.raises(SequenceError, match=rf"^pic_004\.tif: {error}$"):
        recognize_sequence(source, num_threads=num_threads)
    assert source.alive == 0


def test_a_name_is_not_said_twice_and_other_errors_keep_their_kind():
    said = SequenceError("/data/pic_002.tif: cut short")
    with pytest.raises(SequenceError) as caught:
        recognize_sequence(Source(film(4), bad={2: said}))
    assert caught.value is said
    with pytest.raises(ZeroDivisionError) as caught:
        recognize_sequence(Source(film(4), bad={2: ZeroDivisionError()}))
    assert "frame 3" in caught.value.__notes__[0]


def test_a_frame_that_is_no_picture_is_named():
    frames = list(film(5))
    frames[3] = frames[3].astype(float)
    with pytest.raises(SequenceError, match=r"pic_003\.tif: .*float64"):
        recognize_sequence(Source(frames))


@pytest.mark.parametrize("num_threads", [1, 2, 5])
def test_a_thread_holds_one_frame(num_threads):
    source = Source(film(40), pause_s=0.001)
    found = recognize_sequence(source, camera=None, num_threads=num_threads)
    assert source.reads == len(found) == 40
    assert 1 <= source.most <= num_threads
    assert source.alive == 0


def test_of_arrays_made_on_demand_one_run_is_held():
    source = Source(np.zeros((20, 1100, 1000), np.uint8))

    class OnDemand:
        def __len__(self):
            return len(source)

        def __getitem__(self, index):
            return source.read(index)

    assert len(recognize_sequence(OnDemand(), num_threads=2)) == 20
    assert 1 < source.most <= 2 * 4  # four large frames a thread are a run
    assert source.alive == 0


@pytest.mark.parametrize("kind", [Source, np.asarray, list])
def test_progress_ends_at_the_total(kind):
    told = []
    recognize_sequence(kind(film()), num_threads=2, progress=lambda *a: told.append(a))
    assert told[-1] == (11, 11)
    assert [d for d, _ in told] == sorted({d for d, _ in told})
    if kind is Source:
        assert len(told) == 11


@pytest.mark.parametrize("num_threads", [1, 2, 5])
def test_an_interrupt_in_progress_stops(num_threads):
    def interrupt(done, total):
        if done == 3:
            raise KeyboardInterrupt

    source = Source([np.zeros((40, 40), np.uint8)] * 2000, pause_s=0.002)
    threads = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        recognize_sequence(source, camera=None, num_threads=num_threads, progress=interrupt)
    # Each thread finishes its own; while the caller is told of the third frame
    # the others go on, far from the 2000.
    assert 3 <= source.reads < 500
    assert threading.active_count() == threads
    assert source.alive == 0


def test_an_interrupt_between_runs_of_arrays_stops():
    told = []

    def interrupt(done, total):
        told.append(done)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recognize_sequence(np.zeros((3000, 64, 64), np.uint8), num_threads=1, progress=interrupt)
    assert told == [2**20 // 64**2]


def test_the_interpreter_is_free_meanwhile():
    frames = np.random.default_rng(3).integers(0, 255, (4, 500, 500)).astype(np.uint8)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.perf_counter()
    recognize_sequence(frames, num_threads=1)
    end = time.perf_counter()
    done.set()
    thread.join()
    # All four frames are one call of the core: no tick would fall into it.
    assert sum(begin < t < end for t in ticks) >= 3


def _bad_pictures(size=1024):
    random = np.random.default_rng(7)
    y, x = np.mgrid[:size, :size]
    yield "one row", np.full((1, size), 90, np.uint8)
    yield "nothing", np.zeros((0, 0), np.uint8)
    for dtype in (np.uint8, np.uint16):
        top = int(np.iinfo(dtype).max)
        yield "black", np.zeros((size, size), dtype)
        yield "constant", np.full((size, size), top // 3, dtype)
        yield "saturated", np.full((size, size), top, dtype)
        for square in (1, 2, 7, 32):
            yield (
                f"checkerboard {square}",
                (top * ((x // square + y // square) % 2)).astype(dtype),
            )
        yield "noise", random.integers(0, top, (size, size), endpoint=True).astype(dtype)
        yield "two grey levels", (top * random.integers(0, 2, (size, size))).astype(dtype)
        yield "dead pixels", (top * (random.random((size, size)) < 1e-3)).astype(dtype)


@pytest.mark.parametrize(
    ("name", "image"),
    [pytest.param(n, i, id=f"{n}-{i.dtype}") for n, i in _bad_pictures()],
)
def test_bad_pictures_have_no_targets_and_end(name, image, record_property):
    """The time is reported (junit), not asserted but for what nobody would wait for."""
    begin = time.perf_counter()
    found = recognize_sequence([image, image], num_threads=1)
    record_property("ms_a_frame", round(500 * (time.perf_counter() - begin), 1))
    assert time.perf_counter() - begin < 60
    assert (found.targets.id == -1).all()
    # Chance makes few round groups of bright pixels in a million, each seen twice.
    assert len(found.targets) <= (2 * 10 if name in ("noise", "two grey levels") else 0)
