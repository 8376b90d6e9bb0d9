"""Packed 12-bit frames: recognised where they stand, as the samples unpacked."""

import dataclasses
import mmap
import pickle
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry.errors import SequenceError
from videogrammetry.pipeline.frames import read_and_recognize
from videogrammetry.recognition import (
    PackedFrame,
    RecognitionOptions,
    code_family,
    read_frame,
    recognize,
    recognize_sequence,
)
from videogrammetry.sequence import create_sequence, open_sequence
from videogrammetry.sequence.packing import pack_12bit, unpack_12bit
from videogrammetry.types import FrameSource, Targets

FIELDS = [f.name for f in dataclasses.fields(Targets)]
METHODS = ("edge-pair", "local-canny")
ESTIMATORS = ("mean-gradient", "dual-conic", "model")
IN_PLACE = RecognitionOptions(method="edge-pair", estimator="model")
SIZE = (160, 120)


def film(count=6):
    """12-bit frames of 160 x 120 with a code and three dots, of which all move."""
    bits = scenes.code_bits(code_family("schneider-14").codes[50], 14)
    frames = []
    for k in range(count):
        dots = [scenes.Dot(45.0 + 0.7 * k, 50.3, 9, 8, 0.3, bits, turn=0.2 * k)]
        dots += [scenes.Dot(112.0 + 0.3 * k, 25 + 35.0 * j, 7, 6, 0.5) for j in range(3)]
        grey = 16 * scenes.render(SIZE[::-1], dots, noise=1.5, seed=k)
        frames.append(np.clip(np.rint(grey), 0, 4095).astype(np.uint16))
    return np.stack(frames)


def packed(frame, order="high-first"):
    samples = np.ascontiguousarray(frame)
    return PackedFrame(pack_12bit(samples, high_first=order == "high-first"), frame.shape, order)


def assert_same(found, expected):
    for name in FIELDS:
        a, b = getattr(found, name), getattr(expected, name)
        assert (a.dtype, a.shape) == (b.dtype, b.shape), name
        np.testing.assert_array_equal(a, b, err_msg=name)


@dataclasses.dataclass
class Duck:
    """What a source may give: no class of ours, but its attributes."""

    data: np.ndarray
    shape: tuple
    order: str


class PackedSource:
    """Frames that stand in memory; counts who asks for a copy."""

    def __init__(self, frames):
        self.frames = frames
        self.data = [pack_12bit(f) for f in frames]
        self.reads = self.asked = 0
        self.lock = threading.Lock()

    def __len__(self):
        return len(self.frames)

    def read(self, index):
        with self.lock:
            self.reads += 1
        return self.frames[index]

    def packed(self, index):
        with self.lock:
            self.asked += 1
        return Duck(self.data[index], self.frames[index].shape, "high-first")


@pytest.mark.parametrize("order", ["high-first", "low-first"])
@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("method", METHODS)
def test_targets_are_those_of_the_unpacked_frame(method, estimator, order):
    options = RecognitionOptions(method=method, estimator=estimator)
    for frame in film(3):
        expected = recognize(frame, options)
        assert sorted(expected.id.tolist()) == [-1, -1, -1, 51]
        assert_same(recognize(packed(frame, order), options), expected)


def test_black_on_white():
    options = RecognitionOptions(method="edge-pair", estimator="model", polarity="black-on-white")
    frame = 4095 - film(1)[0]
    expected = recognize(frame, options)
    assert len(expected) == 4
    assert_same(recognize(packed(frame), options), expected)


@pytest.mark.parametrize("num_threads", [1, 2, 5])
@pytest.mark.parametrize("method", METHODS)
def test_a_sequence_of_packed_frames(method, num_threads):
    frames = film()
    options = RecognitionOptions(method=method, estimator="model")
    expected = recognize_sequence(frames, options, num_threads=num_threads)
    assert len(expected.targets) == 24
    for kind in ([packed(f) for f in frames], PackedSource(frames)):
        found = recognize_sequence(kind, options, num_threads=num_threads)
        assert found.camera == expected.camera
        assert found.offsets.tolist() == expected.offsets.tolist()
        assert_same(found.targets, expected.targets)


def test_packed_and_other_frames_mix():
    frames = film(4)
    mixed = [frames[0], packed(frames[1]), (frames[2] >> 4).astype(np.uint8), packed(frames[3])]
    found = recognize_sequence(mixed, IN_PLACE, camera=None)
    for targets, frame in zip(found, mixed, strict=True):
        assert_same(targets, recognize(np.asarray(frame), IN_PLACE))


def test_a_source_is_not_read_where_its_frames_stand_packed():
    source = PackedSource(film())
    recognize_sequence(source, IN_PLACE, camera=None)
    assert (source.reads, source.asked) == (0, 6)
    # The paper's way has to unpack, which the source does best.
    recognize_sequence(source, RecognitionOptions(method="local-canny"))
    assert (source.reads, source.asked) == (6, 6)


def test_the_pipeline_takes_frames_where_they_stand():
    source = PackedSource(film(1))
    for options, reads in ((IN_PLACE, 0), (RecognitionOptions(method="local-canny"), 1)):
        found = read_and_recognize(source, 0, options)
        assert_same(found, recognize(source.frames[0], options))
        assert (source.reads, source.asked) == (reads, 1)


def test_a_source_may_have_no_packed_frame():
    source = PackedSource(film())
    source.packed = lambda index: None
    recognize_sequence(source, IN_PLACE, camera=None)
    assert source.reads == 6


def test_bytes_are_taken_where_they_stand(tmp_path: Path):
    frame = film(1)[0]
    array = pack_12bit(frame)
    path = tmp_path / "frame.raw"
    path.write_bytes(b"header" + array.tobytes())
    expected = recognize(frame, IN_PLACE)
    with path.open("rb") as file:
        mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    assert_same(recognize(PackedFrame(memoryview(mapping)[6:], frame.shape), IN_PLACE), expected)
    mapping.close()  # which would raise were it still in use
    mapped = np.memmap(path, np.uint8, mode="r", offset=6)
    for data in (array, mapped, array.reshape(120, 240), array.tobytes(), bytearray(array)):
        given = PackedFrame(data, frame.shape)
        assert_same(recognize(given, IN_PLACE), expected)
        if isinstance(data, np.ndarray):
            assert np.shares_memory(given.data, data)


def test_the_bytes_are_kept_alive():
    frame = film(1)[0]
    given = PackedFrame(pack_12bit(frame).tobytes(), frame.shape)
    core = given.core
    del given
    np.testing.assert_array_equal(core.unpack(), frame)


def test_it_goes_to_other_processes():
    frame = film(1)[0]
    given = pickle.loads(pickle.dumps(packed(frame, "low-first")))
    np.testing.assert_array_equal(given, frame)


def test_it_can_be_shown_as_an_array():
    frame = film(1)[0]
    for order in ("high-first", "low-first"):
        given = packed(frame, order)
        np.testing.assert_array_equal(given.unpack(), frame)
        np.testing.assert_array_equal(
            unpack_12bit(given.data, frame.shape, high_first=order[0] == "h"), frame
        )
        assert np.asarray(given).dtype == given.dtype == np.uint16
        np.testing.assert_array_equal(np.asarray(given, float), frame)
    assert (given.shape, given.ndim, given.size, len(given)) == ((120, 160), 2, 19200, 120)
    with pytest.raises(ValueError, match="copy"):
        given.__array__(copy=False)


@pytest.mark.parametrize("shape", [(0, 0), (0, 4), (3, 0), (1, 2), (3, 2)])
def test_frames_of_little_extent(shape):
    given = packed(np.ones(shape, np.uint16))
    assert given.unpack().shape == shape
    for method in METHODS:
        assert len(recognize(given, RecognitionOptions(method=method))) == 0


BYTES = np.zeros(24, np.uint8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((BYTES, (4, 4), "big"), "order: expected 'high-first' or 'low-first', got 'big'"),
        ((BYTES, (4, 3)), "shape: expected an even width, got .4, 3."),
        ((BYTES, (-4, 4)), "shape: expected 0 to 65536"),
        ((BYTES, (1, 1 << 17)), "shape: expected 0 to 65536"),
        ((BYTES, 16), "shape: expected .height, width., got 16"),
        ((BYTES, (4, 4, 1)), "shape: expected .height, width."),
        ((BYTES, (4, 4.0)), "shape: expected .height, width."),
        ((BYTES, (4, 6)), "data: expected 36 bytes for 4 x 6 samples of 12 bits, got 24"),
        ((BYTES, (2, 4)), "data: expected 12 bytes .* got 24"),
        ((bytes(23), (4, 4)), "data: expected 24 bytes .* got 23"),
        ((BYTES.astype(np.uint16), (4, 4)), "data: expected .*uint8, got uint16"),
        ((np.zeros(48, np.uint8)[::2], (4, 4)), "data: expected contiguous"),
        (([0] * 24, (4, 4)), "data: expected .* got list"),
        ((None, (4, 4)), "data: expected .* got NoneType"),
    ],
)
def test_what_does_not_fit_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        PackedFrame(*arguments)


def test_a_wrong_frame_of_a_sequence_is_named():
    frames = [packed(f) for f in film(2)]
    wrong = Duck(frames[0].data, (120, 161), "high-first")
    with pytest.raises(ValueError, match="frame 3: shape: expected an even width"):
        recognize_sequence([*frames, wrong], IN_PLACE)
    source = PackedSource(film(2))
    source.data[1] = source.data[1][:-1]
    with pytest.raises(SequenceError, match="frame 2: data: expected 28800 bytes"):
        recognize_sequence(source, IN_PLACE)


def record(folder: Path, frames, name="run", bit_depth=12) -> FrameSource:
    with create_sequence(
        folder / name,
        format="mraw",
        image_size_px=frames.shape[:0:-1],
        num_frames=len(frames),
        bit_depth=bit_depth,
    ) as writer:
        for frame in frames:
            writer.append(frame)
    return open_sequence(folder / f"{name}.cihx")


@pytest.mark.parametrize("num_threads", [1, 2])
@pytest.mark.parametrize("method", METHODS)
def test_a_recording_equals_its_frames(tmp_path: Path, method, num_threads):
    frames = film()
    options = RecognitionOptions(method=method, estimator="model")
    source = record(tmp_path, frames)
    found = recognize_sequence(source, options, num_threads=num_threads)
    expected = recognize_sequence(frames, options)
    assert len(found.targets) == 24
    assert found.camera == expected.camera
    assert_same(found.targets, expected.targets)


def test_a_recording_gives_views_into_the_file(tmp_path: Path, monkeypatch):
    frames = film(3)
    joined = record(tmp_path, frames)
    (source,) = joined.sources
    given = joined.packed(1)
    assert np.shares_memory(given.data, source.packed(1).data)  # both are the mapped file's
    frame = read_frame(joined, 1, IN_PLACE)
    assert np.shares_memory(frame.data, given.data)
    np.testing.assert_array_equal(frame, frames[1])
    with pytest.raises(IndexError):
        source.packed(3)
    # In place means that nobody reads.
    monkeypatch.setattr(type(source), "read", lambda *_: pytest.fail("a frame was unpacked"))
    assert len(recognize_sequence(joined, IN_PLACE).targets) == 12


def test_what_has_to_be_decoded_is_read(tmp_path: Path):
    odd = np.ones((2, 4, 5), np.uint16)
    for number, (frames, bits) in enumerate([(odd, 12), (film(1), 16), (film(1), 8)]):
        shown = frames >> 4 if bits == 8 else frames
        source = record(tmp_path, shown, f"run{number}", bits)
        assert source.packed(0) is None
        np.testing.assert_array_equal(read_frame(source, 0, IN_PLACE), shown[0])


def test_no_unpacked_copy_is_made(tmp_path: Path):
    """Of a large frame; 2 MB would be its samples' size in 16 bits."""
    frame = np.zeros((1024, 1024), np.uint16)
    frame[:120, :160] = film(1)[0]
    source = record(tmp_path, np.stack([frame] * 4))
    recognize_sequence(source, IN_PLACE, num_threads=1)  # what is kept is kept now
    tracemalloc.start()
    try:
        found = recognize_sequence(source, IN_PLACE, num_threads=1)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(found.targets) == 16
    assert peak < 200_000
