"""A disk that fills up while a recording is simulated: nothing is left, and it is said."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rendering.simulated import FAMILY, small_rig

from videogrammetry.errors import SequenceError
from videogrammetry.rendering.scenes import Scene, tyre_scene
from videogrammetry.rendering.simulate import simulate


def tyre(num_stages: int) -> Scene:
    return tyre_scene(FAMILY, num_stages=num_stages, rig=small_rig())


_LIMITED = """
import resource, sys
from rendering.simulated import FAMILY, small_rig
from videogrammetry.errors import SequenceError
from videogrammetry.rendering.scenes import tyre_scene
from videogrammetry.rendering.simulate import simulate
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    simulate(tyre_scene(FAMILY, num_stages=3, rig=small_rig(48)), sys.argv[1], FAMILY)
except (SequenceError, OSError) as error:
    print(error)
    sys.exit(3)
"""


# 3456 bytes a packed frame of 48 x 48: the third fails; then the truth's table, of over 12 kB.
@pytest.mark.parametrize(("limit", "where"), [(8_000, "cam1"), (11_000, "nothing was kept")])
def test_a_file_size_limit_leaves_nothing(tmp_path, limit, where):
    done = subprocess.run(
        [sys.executable, "-c", _LIMITED, str(tmp_path / "x" / "out"), str(limit)],
        capture_output=True, text=True, check=False,
        env={"PYTHONPATH": str(Path(__file__).parents[1])},
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert str(tmp_path / "x" / "out") in done.stdout
    assert where in done.stdout
    assert ".part" not in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_small_disk(small_disk):
    out = small_disk / "lab" / "out"
    with pytest.raises((SequenceError, OSError), match=r"MB free") as full:  # one camera: 0.6 MB
        simulate(tyre(6), out, FAMILY)
    assert ".part" not in str(full.value)
    assert list(small_disk.iterdir()) == []

    def fill(done: int, total: int, what: str) -> None:
        if done == 2:  # both frames are written; the truth is yet to come
            (small_disk / "other").write_bytes(bytes(2_000_000))

    with pytest.raises(OSError, match="no room on the disk"):  # met by the filling itself
        simulate(tyre(2), out, FAMILY, progress=fill)

    def squeeze(done: int, total: int, what: str) -> None:
        free = shutil.disk_usage(small_disk).free
        (small_disk / "other").write_bytes(bytes(max(free - 4096, 0)))

    (small_disk / "other").unlink()
    with pytest.raises((SequenceError, OSError), match=str(out)) as full:
        simulate(tyre(2), out, FAMILY, progress=squeeze)
    assert ".part" not in str(full.value)
    assert [p.name for p in small_disk.iterdir()] == ["other"]
