"""Packed samples of 12 bits against an oracle that spells every bit out."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.sequence.packing import pack_12bit, packed_12bit_bytes, unpack_12bit

SEEDS = (1, 2, 3)


def oracle(samples: np.ndarray, high_first: bool) -> np.ndarray:
    """All bits one after the other, the most or the least significant of everything first."""
    places = np.arange(11, -1, -1) if high_first else np.arange(12)
    bits = (samples.ravel()[:, None] >> places & 1).ravel()
    return np.packbits(bits.astype(np.uint8), bitorder="big" if high_first else "little")


@pytest.mark.parametrize("high_first", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_equals_the_oracle_for_many_shapes(seed: int, high_first: bool) -> None:
    random = np.random.default_rng(seed)
    for shape in [(1,), (2,), (3,), (15, 3), (16, 2), (17, 33), (48, 64), (101, 1)]:
        samples = random.integers(0, 4096, shape).astype(np.uint16)
        packed = pack_12bit(samples, high_first=high_first)
        where = f"seed {seed}, shape {shape}"
        np.testing.assert_array_equal(packed, oracle(samples, high_first), err_msg=where)
        assert len(packed) == packed_12bit_bytes(samples.size)
        back = unpack_12bit(packed, shape, high_first=high_first)
        np.testing.assert_array_equal(back, samples, err_msg=where)


def test_unpacks_into_an_array_that_is_there() -> None:
    samples = np.arange(24, dtype=np.uint16).reshape(4, 6)
    out = np.zeros((4, 6), np.uint16)
    assert unpack_12bit(pack_12bit(samples), (4, 6), out=out) is out
    np.testing.assert_array_equal(out, samples)
    with pytest.raises(ValueError, match=r"out: expected shape \(6, 4\), got \(4, 6\)"):
        unpack_12bit(pack_12bit(samples), (6, 4), out=out)


def test_reads_what_may_not_be_written_to() -> None:
    packed = pack_12bit(np.array([1, 2], np.uint16))
    packed.flags.writeable = False
    assert unpack_12bit(packed, 2).tolist() == [1, 2]
    samples = np.array([1, 2], np.uint16)
    samples.flags.writeable = False
    np.testing.assert_array_equal(pack_12bit(samples), packed)
    fixed = np.zeros(2, np.uint16)
    fixed.flags.writeable = False
    with pytest.raises(ValueError, match="not writeable"):
        unpack_12bit(packed, 2, out=fixed)


def test_wrong_sizes_values_and_types_are_errors() -> None:
    with pytest.raises(ValueError, match="4 samples of 12 bits take 6 bytes, got 7"):
        unpack_12bit(np.zeros(7, np.uint8), 4)
    with pytest.raises(ValueError, match="sample 1 is 4096, the largest of 12 bits is 4095"):
        pack_12bit(np.array([0, 4096], np.uint16))
    with pytest.raises(TypeError):
        unpack_12bit(np.zeros(6, np.uint16), 4)
    with pytest.raises(TypeError):  # a copy would be made unseen
        unpack_12bit(np.zeros(12, np.uint8)[::2], 4)
