"""``videogrammetry undistort``: pictures, recordings, projects, tables."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import tifffile
from command_fakes import Run, complaint
from rendering.simulated import small_rig

from videogrammetry.geometry import Undistortion, ideal_camera, undistort_ellipses
from videogrammetry.project import read_rig, read_targets, write_rig
from videogrammetry.project.tables import TARGET_COLUMNS
from videogrammetry.sequence import create_sequence, open_sequence

RIG = small_rig(128)
CAM = RIG.cameras["cam1"]


def frames(count=3, dtype=np.uint8, top=255):
    rng = np.random.default_rng(5)
    return [rng.integers(0, top + 1, (128, 128)).astype(dtype) for _ in range(count)]


@pytest.fixture
def work(tmp_path):
    write_rig(tmp_path / "rig.json", RIG)
    (tmp_path / "in").mkdir()
    for k, frame in enumerate(frames()):
        tifffile.imwrite(tmp_path / "in" / f"left_{k}.tif", frame)
    return tmp_path


def recording(folder, name="rec", bit_depth=12):
    images = frames(4, np.uint16 if bit_depth > 8 else np.uint8, 2**bit_depth - 1)
    with create_sequence(
        folder / name, format="mraw", image_size_px=(128, 128), num_frames=4,
        bit_depth=bit_depth, frame_rate_hz=500, exposure_s=1e-4,
    ) as writer:  # fmt: skip
        for image in images:
            writer.append(image)
    return images


@pytest.mark.parametrize("keep", ["size", "all", "valid"])
@pytest.mark.parametrize("suffix", ["tiff", "png"])
def test_pictures_keep_name_and_type(run: Run, work, keep, suffix):
    out = run(
        "undistort", "in", "out", "--rig", "rig.json", "--camera", "cam1", "--keep", keep,
        "--format", suffix, "--fill", "9",
    )  # fmt: skip
    ideal = ideal_camera(CAM, keep)
    assert f"3 pictures of {ideal.image_size_px[0]}x{ideal.image_size_px[1]} px" in out.stderr
    source = open_sequence(work / "out")
    ending = "tif" if suffix == "tiff" else "png"
    assert [source.name(i) for i in range(3)] == [f"left_{i}.{ending}" for i in range(3)]
    undistort = Undistortion(camera=CAM, ideal=ideal, fill=9)
    for i, frame in enumerate(frames()):
        found = source.read(i)
        assert found.dtype == np.uint8
        np.testing.assert_array_equal(found, undistort(frame))
    written = read_rig(work / "out" / "rig.json")
    np.testing.assert_array_equal(written.cameras["cam1"].interior, ideal.interior)
    assert written.cameras["cam1"].image_size_px == ideal.image_size_px
    assert written.how["options"]["keep"] == keep
    assert len(written.how["inputs_sha256"]) == 4


@pytest.mark.parametrize("bit_depth", [8, 12, 16])
def test_recordings_stay_recordings(run: Run, work, bit_depth):
    images = recording(work, bit_depth=bit_depth)
    run("undistort", "rec.cihx", "out.cihx", "--rig", "rig.json", "--camera", "cam1",
        "--interpolation", "cubic")  # fmt: skip
    source = open_sequence(work / "out.cihx")
    assert (source.frame_rate_hz, source.bit_depth, source.exposure_s) == (500, bit_depth, 1e-4)
    undistort = Undistortion(camera=CAM, ideal=ideal_camera(CAM), interpolation="cubic")
    for i, image in enumerate(images):
        np.testing.assert_array_equal(source.read(i), undistort(image, 2**bit_depth - 1))
    assert (work / "out.rig.json").is_file()
    message = complaint(
        run("undistort", "rec.cihx", "out.cihx", "--rig", "rig.json", "--camera", "cam1",
            "--force", status=2), "undistort",
    )  # fmt: skip
    assert "pictures are not overwritten" in message


def test_frames_of_a_stack_are_numbered(run: Run, work):
    tifffile.imwrite(work / "stack.tif", np.stack(frames()), photometric="minisblack")
    run("undistort", "stack.tif", "out", "--rig", "rig.json", "--camera", "cam1")
    names = sorted(p.name for p in (work / "out").glob("*.tif"))
    assert names == [f"stack_{i:06d}.tif" for i in (1, 2, 3)]


def test_a_project_as_a_whole(run: Run, work):
    recording(work, "rec1")
    text = 'schema = 1\nname = "p"\n[cameras.cam1]\nsequence = "rec1.cihx"\n'
    text += '[cameras.cam2]\nsequence = "in"\n[cameras.cam3]\nsequence = "in"\n'
    (work / "project.toml").write_text(text + '[cameras.cam4]\nsequence = "in"\n')
    run("undistort", ".", "out", "--keep", "all")
    assert (work / "out" / "cam1.cihx").is_file()
    assert len(list((work / "out" / "cam2").glob("*.tif"))) == 3
    ideal = read_rig(work / "out" / "rig.json")
    assert list(ideal.cameras) == list(RIG.cameras)
    assert not any(c.interior[3:].any() for c in ideal.cameras.values())
    run("undistort", "project.toml", "one", "--camera", "cam3")
    assert sorted(p.name for p in (work / "one").iterdir()) == ["cam3", "rig.json"]


TARGETS = (
    ",".join(TARGET_COLUMNS)
    + """
a.tif,,1,7,20.5,30.25,6,5,0.3,0.02,0.03
a.tif,,1,,100.5,90.25,6,5,0.3,,
"""
)


def test_targets(run: Run, work):
    (work / "targets.csv").write_text(TARGETS)
    run("undistort", "targets.csv", "out.csv", "--rig", "rig.json", "--camera", "cam1")
    found = read_targets(work / "out.csv")
    xy, _, _ = undistort_ellipses(
        CAM, [[20.5, 30.25], [100.5, 90.25]], [[6.0, 5.0]] * 2, [0.3, 0.3]
    )
    np.testing.assert_allclose(found.xy_px, xy, rtol=1e-11)
    assert found.id.tolist() == [7, -1]
    assert np.isfinite(found.sigma_px[0]).all()
    assert np.isnan(found.sigma_px[1]).all()
    assert read_rig(work / "out.rig.json").cameras["cam1"].interior[0] == CAM.interior[0]
    origin = json.loads((work / "out.csv.provenance.json").read_text())
    assert set(origin["inputs_sha256"]) == {"rig.json", "targets.csv"}
    complaint(run("undistort", "targets.csv", "out.csv", "--rig", "rig.json", "--camera", "cam1",
                  status=1), "undistort")  # fmt: skip


@pytest.mark.parametrize(
    ("args", "status", "message"),
    [
        (("in", "out"), 2, "--rig FILE is needed"),
        (("in", "out", "--rig", "rig.json"), 2, "--camera is needed: rig.json has cam1, cam2"),
        (("in", "out", "--rig", "rig.json", "--camera", "left"), 2, "not left"),
        (("in", "o.cihx", "--rig", "rig.json", "--camera", "cam1", "--format", "png"), 2, ".cihx"),
        (("in", "in", "--rig", "rig.json", "--camera", "cam1"), 2, "is there already"),
        (("none*.tif", "out", "--rig", "rig.json", "--camera", "cam1"), 1, "none*.tif"),
        (("large.tif", "out", "--rig", "rig.json", "--camera", "cam1"), 1, "(128, 128)"),
        (("in", "out", "--rig", "rig.json", "--camera", "cam1", "--fill", "300"), 2, "8 bits"),
        (("in", "out", "--rig", "rig.json", "--camera", "cam1", "--fill", "-1"), 2, "--fill"),
        (("t.csv", "out.txt", "--rig", "rig.json"), 2, "ends in .csv"),
        (("t.csv", "out.csv", "--rig", "rig.json"), 1, "no camera is named"),
    ],
)
def test_complaints_leave_nothing_behind(run: Run, work, args, status, message):
    tifffile.imwrite(work / "large.tif", np.zeros((130, 128), np.uint8))
    (work / "t.csv").write_text(TARGETS)
    before = sorted(str(p) for p in work.rglob("*"))
    result = run("undistort", *args, status=status)
    assert message in result.stderr.splitlines()[-1]
    assert sorted(str(p) for p in work.rglob("*")) == before


def test_one_cameras_rig_needs_no_name(run: Run, work):
    one = dataclasses.replace(RIG, cameras={"only": CAM})
    write_rig(work / "one.json", one)
    run("undistort", "in", "out", "--rig", "one.json")
    assert list(read_rig(work / "out" / "rig.json").cameras) == ["only"]
