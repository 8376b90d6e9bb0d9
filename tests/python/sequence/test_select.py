"""Which files a specification means, their order, and what is said when it means none."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import check_same_length, open_sequence
from videogrammetry.types import FrameSource

ROOT = Path(__file__).parents[3]
DATA = Path(os.environ.get("VIDEOGRAMMETRY_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for i in (1, 2, 9, 10, 11, 100):
        tifffile.imwrite(tmp_path / f"img{i}.tif", np.full((4, 5), i, np.uint8))
    (tmp_path / "notes.txt").write_text("not a picture")
    (tmp_path / ".hidden.tif").write_text("not shown")
    return tmp_path


def values(source: FrameSource) -> list[int]:
    return [int(source.read(i)[0, 0]) for i in range(len(source))]


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        (".", [1, 2, 9, 10, 11, 100]),
        ("img*.tif", [1, 2, 9, 10, 11, 100]),
        ("img?.tif", [1, 2, 9]),
        ("img[12].tif", [1, 2]),
        ("img{10,2}.tif", [2, 10]),
        ("img{1,2}*.{tif,png}", [1, 2, 10, 11, 100]),
        (["img10.tif", "img[12].tif"], [10, 1, 2]),
        ("img9.tif", [9]),
    ],
)
def test_natural_order(folder: Path, spec: str | list[str], expected: list[int]) -> None:
    source = open_sequence(spec, folder)
    assert isinstance(source, FrameSource)
    assert values(source) == expected
    assert source.name(0) == f"img{expected[0]}.tif"
    assert source.image_size_px == (5, 4)
    assert source.frame_rate_hz is None
    assert len(source.paths) == len(expected)


def test_a_real_name_with_brackets_wins_over_a_pattern(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a[1].tif", np.zeros((4, 5), np.uint8))
    assert open_sequence("a[1].tif", tmp_path).name(0) == "a[1].tif"


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("cam7*.tif", ["cam7*.tif", "pattern"]),
        ("nothere/img1.tif", ["nothere", "img1.tif"]),
        ("img3.tif", ["img3.tif", "no such file"]),
        ("img{1,3}.tif", ["img3.tif", "img{1,3}.tif"]),
        ([], ["empty list"]),
    ],
)
def test_no_match_says_what_and_where(
    folder: Path, spec: str | list[str], words: list[str]
) -> None:
    with pytest.raises(SequenceError) as caught:
        open_sequence(spec, folder)
    for word in words:
        assert word in str(caught.value)


def test_an_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(SequenceError, match="holds no picture"):
        open_sequence(tmp_path)


def test_a_stranger_of_another_size(folder: Path) -> None:
    Image.fromarray(np.zeros((6, 5), np.uint8)).save(folder / "img12.png")
    with pytest.raises(SequenceError, match=r"img12\.png has 5x6 px.*img1\.tif.*5x4 px"):
        open_sequence(folder)
    assert len(open_sequence(folder, same_size=False)) == 7


def test_cameras_with_different_numbers_of_frames(folder: Path) -> None:
    left, right = open_sequence("img*.tif", folder), open_sequence("img?.tif", folder)
    assert check_same_length({"left": left}) == 6
    with pytest.raises(SequenceError, match="'left' has 6 frames.*'right' has 3"):
        check_same_length({"left": left, "right": right})


def test_stacks_and_files_join(folder: Path) -> None:
    tifffile.imwrite(folder / "s.tif", np.full((3, 4, 5), 7, np.uint8), photometric="minisblack")
    source = open_sequence(["img2.tif", "s.tif", "img1.tif"], folder)
    assert values(source) == [2, 7, 7, 7, 1]
    assert source.name(3) == "s.tif#3"
    with pytest.raises(IndexError):
        source.read(-1)


def test_many_threads_read_at_once(folder: Path) -> None:
    source = open_sequence(folder)
    with ThreadPoolExecutor(8) as pool:
        read = list(pool.map(lambda i: int(source.read(i % 6)[0, 0]), range(600)))
    assert read == [1, 2, 9, 10, 11, 100] * 100


@pytest.mark.data
@pytest.mark.parametrize(
    ("spec", "count", "size"),
    [
        ("aicon-panel/left_*.tif", 10, (2000, 1333)),
        ("camcal", 21, (2272, 1704)),
        ("test-cavity/frames/cam1_*", 3, (1280, 1024)),
        ("rendered-targets/*S75.png", 3, (1024, 1024)),
    ],
)
def test_real_pictures(spec: str, count: int, size: tuple[int, int]) -> None:
    if not DATA.is_dir():
        pytest.skip(f"{DATA} is not there")
    source = open_sequence(spec, DATA)
    assert len(source) == count
    assert source.image_size_px == size
    frame = source.read(count - 1)
    assert frame.shape == size[::-1]
    assert frame.std() > 5
