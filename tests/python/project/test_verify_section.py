"""[verify] of the project file."""

from __future__ import annotations

from pathlib import Path

import pytest

from videogrammetry.errors import ProjectFileError
from videogrammetry.project import VerifySection, read_project

HEAD = "schema = 1\n[cameras.left]\n"


def read(folder: Path, text: str) -> VerifySection:
    (folder / "project.toml").write_text(HEAD + text)
    return read_project(folder).verify


def test_everything_is_read(tmp_path: Path) -> None:
    section = read(
        tmp_path,
        '[verify]\nscale_bars = "bars.csv"\nfree_fall = [1, 100]\ngravity_m_s2 = 9.8\n'
        'drag_per_m = 0.01\npoints = [4, 5, 21]\nvertical = [0, -1, 0.1]\ntruth = "truth"\n',
    )
    here = tmp_path.resolve()
    assert section == VerifySection(
        scale_bars=here / "bars.csv",
        free_fall=(1, 100),
        gravity_m_s2=9.8,
        drag_per_m=0.01,
        points=(4, 5, 21),
        vertical=(0.0, -1.0, 0.1),
        truth=here / "truth",
    )
    assert section.anything


def test_nothing_is_the_default(tmp_path: Path) -> None:
    assert read(tmp_path, "") == VerifySection()
    assert not VerifySection(points=(1,), gravity_m_s2=9.8).anything
    assert read(tmp_path, '[verify]\ndrag_per_m = "estimate"\n').estimate_drag


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "free_fall = [9, 3]",
            r"line 4: \[verify\] free_fall = \[9, 3\]: expected \[first, last\]",
        ),
        ("free_fall = [0, 3]", r"free_fall = \[0, 3\]: expected \[first, last\] stage, from 1"),
        ("free_fall = [1, 2, 3]", r"expected \[first, last\] stage"),
        ("points = []", "expected a list of point numbers"),
        ("points = [1, 1]", "names a number twice"),
        ("points = [1.5]", "expected a list of point numbers"),
        ("vertical = [0, 0, 0]", "not all zero"),
        ("vertical = [0, 1]", "the direction upwards"),
        ("drag_per_m = -1", "drag_per_m = -1 is negative"),
        ('drag_per_m = "much"', "'much' is not known"),
        ("gravity_m_s2 = 0", "greater than 0"),
        ('scale_bar = "b.csv"', "did you mean 'scale_bars'"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(ProjectFileError, match=message):
        read(tmp_path, f"[verify]\n{line}\n")
