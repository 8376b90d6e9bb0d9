"""A disk that fills while HDF5 writes: an error that says so, and no crash when Python ends."""

from __future__ import annotations

import subprocess
import sys

import h5py
import numpy as np
import pytest

from videogrammetry.project.hdf5_output import Hdf5Output, open_hdf5

resource = pytest.importorskip("resource")  # not there on Windows

# Blocks of several sizes, compressed and not, so that any of HDF5's caches may be the one
# that cannot be written; the attributes come last.
WRITE = """
import resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from test_hdf5_output import fill
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    fill(Path(sys.argv[1]))
except OSError as error:
    print(error.strerror)
"""


def fill(path) -> None:
    rng = np.random.default_rng(0)
    with open_hdf5(path) as (file, _):
        for k in range(6):
            packed = {"compression": "gzip"} if k % 2 else {}
            data = file.create_dataset(
                f"d{k}", (4000, 8), "f4", chunks=(100 + 400 * k, 8), **packed
            )
            for row in range(0, 4000, 400):
                data[row : row + 400] = rng.normal(size=(400, 8))
            data.attrs["units"] = "mm" * 50


def test_what_is_written_is_what_hdf5_writes_by_itself(tmp_path) -> None:
    fill(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        rng = np.random.default_rng(0)
        for k in range(6):
            expected = np.concatenate([rng.normal(size=(400, 8)) for _ in range(10)])
            np.testing.assert_array_equal(file[f"d{k}"], expected.astype(np.float32))


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.9, 0.999, 1.0])
def test_a_limit_anywhere_in_the_file_is_an_error_and_no_crash(tmp_path, share) -> None:
    fill(tmp_path / "whole.h5")
    limit = int(share * (tmp_path / "whole.h5").stat().st_size)
    command = [sys.executable, "-c", WRITE, tmp_path / "a.h5", str(limit), str(_HERE)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == ("" if share == 1.0 else "File too large\n")


def test_after_a_failure_all_can_be_read_back(tmp_path) -> None:
    rng = np.random.default_rng(1)
    expected = np.zeros(4000, np.uint8)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Hdf5Output(tmp_path / "a") as output:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1500, hard))
        try:
            for _ in range(60):
                begin, size = int(rng.integers(0, 3500)), int(rng.integers(1, 500))
                data = rng.integers(0, 256, size, dtype=np.uint8)
                output.seek(begin)
                output.write(data)
                expected[begin : begin + size] = data
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        end = output.seek(0, 2)
        assert not expected[end:].any()
        for begin, size in rng.integers(0, 2000, (40, 2)):
            output.seek(begin)
            assert output.read(size) == expected[begin : begin + size].tobytes()
        with pytest.raises(OSError, match="File too large"):
            output.check()


_HERE = __file__.rsplit("/", 1)[0]
