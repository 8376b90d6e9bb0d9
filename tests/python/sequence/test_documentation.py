"""The pages on recordings and own formats do what they say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.recognition import RecognitionOptions, recognize_sequence
from videogrammetry.sequence import formats, known_suffixes, open_sequence, register_format
from videogrammetry.types import FrameSource

PAGES = Path(__file__).parents[3] / "docs" / "how-to"


@pytest.fixture(autouse=True)
def _own_formats(monkeypatch):
    monkeypatch.setattr(formats, "_OPENERS", dict(formats._OPENERS))


def test_the_example_of_an_own_format_prints_what_is_shown(tmp_path, monkeypatch, capsys):
    page = (PAGES / "own-format.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```\n(?:\n((?:    [^\n]*\n)+))?", page, re.DOTALL)
    assert len(blocks) == 2
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for code, shown in blocks:
        exec(code, names)
        wanted = "".join(line[4:] + "\n" for line in shown.splitlines())
        assert capsys.readouterr().out == wanted
    source = names["LabSource"](Path("left.lab"))
    assert isinstance(source, FrameSource)
    found = recognize_sequence(source, RecognitionOptions(codes="none"))
    assert len(found) == 3
    for damage in (b"", b"123", b"\0" * 20, Path("left.lab").read_bytes()[:-1]):
        Path("bad.lab").write_bytes(damage)
        with pytest.raises(SequenceError, match=r"bad\.lab"):
            open_sequence("bad.lab")


def test_registering_is_checked():
    with pytest.raises(ValueError, match="endings like"):
        register_format(["raw"], lambda path: None)
    with pytest.raises(ValueError, match="known already"):
        register_format([".TIF"], lambda path: None)
    register_format([".tif"], lambda path: None, replace=True)


def test_formats_of_installed_packages(monkeypatch):
    class Point:
        def __init__(self, name, loaded):
            self.name, self.value, self.loaded = name, f"lab:{name}", loaded

        def load(self):
            if isinstance(self.loaded, Exception):
                raise self.loaded
            return self.loaded

    points = [
        Point(".lab", lambda path: None),
        Point(".bad", ImportError("no lab")),
        Point(".tif", 1),
    ]
    monkeypatch.setattr(formats, "entry_points", lambda group: points)
    formats._load_entry_points.cache_clear()
    with pytest.warns(SequenceWarning, match=r"'\.bad' .* cannot be used: ImportError: no lab"):
        assert ".lab" in known_suffixes()
    assert formats._OPENERS[".tif"] != 1
    formats._load_entry_points.cache_clear()


def test_the_page_on_recordings_names_every_format():
    page = (PAGES / "recordings.md").read_text()
    for suffix in known_suffixes():
        name = suffix.removeprefix(".").replace("tiff", "tif").replace("jpg", "jpeg")
        assert name.lower() in page.lower(), suffix


def test_sessions_of_several_cameras(tmp_path):
    from videogrammetry.sequence import create_sequence, photron_session

    for name in ("C001H001S0003", "C002H001S0003", "C001H001S0004"):
        (tmp_path / name).mkdir()
        with create_sequence(
            tmp_path / name / name, format="mraw", image_size_px=(8, 8), num_frames=1, bit_depth=8
        ) as writer:
            writer.append(np.zeros((8, 8), np.uint8))
    session = photron_session(tmp_path, 3)
    assert list(session) == ["C001H001", "C002H001"]
    assert [len(open_sequence(path)) for path in session.values()] == [1, 1]
    with pytest.raises(SequenceError, match=r"several sessions \(3, 4\)"):
        photron_session(tmp_path)
    with pytest.raises(SequenceError, match=r"no recording of session 7 .*sessions 3, 4"):
        photron_session(tmp_path, 7)
    with pytest.raises(SequenceError, match="no recording with a name like"):
        photron_session(tmp_path / "C001H001S0003" / "none")
