"""Simulated recordings: the same bytes, the same truth, all of it or nothing."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rendering.simulated import FAMILY, small_rig

from videogrammetry.errors import ProjectFileError
from videogrammetry.geometry import project
from videogrammetry.project import read_points, read_project, read_rig, read_trajectories
from videogrammetry.rendering import render_frames
from videogrammetry.rendering import simulate as module
from videogrammetry.rendering.disturbances import Conditions
from videogrammetry.rendering.scenes import (
    Scene,
    calibration_scene,
    cross_target,
    photos_scene,
    scale_bar_scene,
    tyre_scene,
)
from videogrammetry.rendering.simulate import SimulateOptions, simulate, simulate_photos
from videogrammetry.sequence import SEQUENCE_FORMATS, open_sequence

RIG = small_rig()
CAMERAS = list(RIG.cameras)


def tyre(**changes) -> Scene:
    return tyre_scene(FAMILY, **{"num_stages": 3, "rig": RIG, **changes})


def files(folder: Path) -> dict[str, bytes]:
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert found
    return found


# --- the same bytes, the same samples ------------------------------------------------


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    for name, threads, seed in (("a", 1, 0), ("b", 3, 0), ("c", 2, 1)):
        conditions = Conditions(occluded=0.2, missing=0.34, seed=seed)
        options = SimulateOptions(conditions=conditions, num_threads=threads)
        simulate(tyre(), tmp_path / name, FAMILY, options)
    assert files(tmp_path / "a") == files(tmp_path / "b")
    other = files(tmp_path / "c")
    same = {name for name, data in files(tmp_path / "a").items() if data == other[name]}
    assert "sequence/cam1.cihx" in same
    assert not {f"sequence/{name}.mraw" for name in CAMERAS} & same


def rendered(scene: Scene, conditions: Conditions) -> dict[str, list[np.ndarray]]:
    """What the renderer gives, without any file."""
    options = SimulateOptions(conditions=conditions)
    result = {}
    for c, (name, camera) in enumerate(scene.rig.cameras.items()):
        renderer = module._renderer(camera, c, conditions)
        jobs = [
            (renderer, scene.targets(scene.time_s(s)), module._seed(options, c, s))
            for s in range(1, scene.num_stages + 1)
        ]
        result[name] = [frame.image for frame in render_frames(jobs)]
    return result


@pytest.mark.peer
@pytest.mark.parametrize("bit_depth", [8, 12, 16])
def test_pymraw_reads_what_was_rendered(tmp_path, bit_depth):
    pymraw = pytest.importorskip("pyMRAW")
    conditions = Conditions(bit_depth=bit_depth)
    simulate(tyre(), tmp_path / "out", FAMILY, SimulateOptions(conditions=conditions))
    for name, images in rendered(tyre(), conditions).items():
        path = tmp_path / "out" / "sequence" / f"{name}.cihx"
        theirs, header = pymraw.load_video(str(path))
        np.testing.assert_array_equal(np.array(theirs), images, err_msg=name)
        assert int(header["Record Rate(fps)"]) == 250


@pytest.mark.parametrize("bit_depth", [8, 12])
@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_files_hold_what_was_rendered(tmp_path, format, bit_depth):
    conditions = Conditions(bit_depth=bit_depth, seed=4)
    options = SimulateOptions(conditions=conditions, format=format)
    simulate(tyre(), tmp_path / "out", FAMILY, options)
    found = read_project(tmp_path / "out")
    for name, images in rendered(tyre(), conditions).items():
        source = open_sequence(found.cameras[name].sequence, found.folder)
        assert len(source) == 3
        for i, image in enumerate(images):
            np.testing.assert_array_equal(source.read(i), image, err_msg=name)
    # Single pictures state no rate, so the project does.
    rate = source.frame_rate_hz if format == "mraw" else found.sequence.frame_rate_hz
    assert rate == 250


# --- the project file ------------------------------------------------------------------


@pytest.fixture(scope="module")
def calibration(tmp_path_factory) -> Path:
    """A calibration recording in a folder with a difficult name."""
    folder = tmp_path_factory.mktemp("lab") / 'a "b" [1]'
    cross = cross_target(FAMILY)
    scene = calibration_scene(FAMILY, num_orientations=4, rig=RIG, cross=cross)
    simulate(scene, folder, FAMILY, SimulateOptions(target_sigma_mm=0.5), cross=cross)
    return folder


def test_the_projects_name_what_is_there(calibration):
    found = read_project(calibration)
    assert list(found.cameras) == CAMERAS
    assert found.calibration.sigma_mm == 0.5
    assert (found.folder / found.calibration.target).is_file()
    for camera in found.cameras.values():
        assert len(open_sequence(camera.calibration, found.folder)) == 4
        assert camera.sequence is None
    scene = calibration_scene(FAMILY, num_orientations=4, rig=RIG)
    sizes = []
    for stage in range(1, 5):
        targets = scene.targets(scene.time_s(stage))
        for c, camera in enumerate(RIG.cameras.values()):
            truth = module._renderer(camera, c, Conditions()).truth(targets)
            sizes.append(2 * truth.semi_axes_px[truth.visible])
    low, high = found.targets.diameter_px
    assert low <= max(3.0, np.concatenate(sizes).min())
    assert np.concatenate(sizes).max() <= high


def test_a_calibration_in_another_folder_is_found(tmp_path, calibration, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = SimulateOptions(calibration=calibration)
    bar = scale_bar_scene(FAMILY, num_stages=2, rig=RIG, exposure_s=1e-3)
    simulate(bar, "x/y/bar", FAMILY, options)
    found = read_project(tmp_path / "x/y/bar")
    assert (found.folder / found.calibration.target).resolve() == calibration / "cross.csv"
    assert found.calibration.sigma_mm == 0.5
    for name, camera in found.cameras.items():
        (spec,) = camera.calibration
        assert not Path(spec).is_absolute()
        assert len(open_sequence(camera.calibration, found.folder)) == 4, name
        source = open_sequence(camera.sequence, found.folder)
        assert (len(source), source.frame_rate_hz) == (2, bar.frame_rate_hz), name
    assert (found.folder / "bars.csv").is_file()
    truth = json.loads((found.folder / "truth" / "scene.json").read_text())
    assert truth["facts"]["length_mm"] == 1100.057


def test_a_calibration_that_cannot_be_used_is_said_before_the_work(tmp_path, calibration):
    one = replace(RIG, cameras={"cam1": RIG.cameras["cam1"], "cam9": RIG.cameras["cam2"]})
    simulate(tyre(), tmp_path / "none", FAMILY)
    told = []
    for folder, rig, message in (
        (tmp_path / "nothere", RIG, "nothere"),
        (tmp_path / "none", RIG, "names no calibration target"),
        (calibration, one, "names no calibration pictures of cam9"),
    ):
        with pytest.raises(ProjectFileError, match=message):
            simulate(
                tyre(rig=rig), tmp_path / "out", FAMILY, SimulateOptions(calibration=folder),
                progress=lambda *args: told.append(args),
            )  # fmt: skip
    assert told == []
    assert [p.name for p in tmp_path.iterdir()] == ["none"]


# --- truth -----------------------------------------------------------------------------


def image_rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "truth" / "images.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("exposure_s", [0.0, 200e-6, 4e-3])
def test_trajectories_lie_where_the_pictures_show_them(tmp_path, exposure_s):
    scene = tyre(exposure_s=exposure_s, speed_mm_s=3000.0, spin_deg_s=90.0)
    simulate(scene, tmp_path / "out", FAMILY)
    rig = read_rig(tmp_path / "out" / "truth" / "rig.json")
    table = read_trajectories(tmp_path / "out" / "truth" / "trajectories.csv")
    places = dict(zip(zip(table.stage.tolist(), table.point, strict=True), table.position_mm,
                      strict=True))  # fmt: skip
    seen_by = dict(zip(zip(table.stage.tolist(), table.point, strict=True), table.cameras,
                       strict=True))  # fmt: skip
    assert len(places) == 3 * 18
    compared = 0
    for row in image_rows(tmp_path / "out"):
        key = int(row["stage"]), row["point"]
        camera = rig.cameras[row["camera"]]
        assert (row["camera"] in seen_by[key]) == (row["visibility"] == "visible")
        if row["circle_x_px"]:
            own = camera.rotation @ places[key] + camera.translation_mm
            circle = [float(row["circle_x_px"]), float(row["circle_y_px"])]
            np.testing.assert_allclose(project(camera, own[None])[0], circle, atol=1e-6)
            compared += 1
    assert compared == 3 * 2 * 18


@pytest.mark.parametrize("sigma_mm", [0.0, 0.2])
def test_the_cross_table_errs_by_its_sigma(tmp_path, sigma_mm):
    cross = cross_target(FAMILY)
    scene = calibration_scene(FAMILY, num_orientations=1, rig=RIG, cross=cross)
    simulate(scene, tmp_path / "o", FAMILY, SimulateOptions(target_sigma_mm=sigma_mm), cross=cross)
    true = read_points(tmp_path / "o" / "truth" / "cross.csv")
    measured = read_points(tmp_path / "o" / "cross.csv")
    np.testing.assert_array_equal(measured.id, true.id)
    np.testing.assert_allclose(true.position_mm, cross.place.centre_mm, atol=1e-9)
    error = measured.position_mm - true.position_mm
    if sigma_mm == 0:
        assert np.abs(error).max() < 1e-6  # written to the nanometre
        assert measured.cov_mm2 is None
    else:
        # 294 errors: their root mean square is sure to 1 / sqrt(2 * 294) = 4 %, four of them.
        assert np.sqrt((error**2).mean()) == pytest.approx(sigma_mm, rel=0.17)
        assert abs(error.mean()) < 4 * sigma_mm / np.sqrt(294)
        np.testing.assert_allclose(np.sqrt(measured.cov_mm2[:, [0, 3, 5]]), sigma_mm)


def test_missing_pictures_are_empty_and_listed(tmp_path):
    options = SimulateOptions(conditions=Conditions(missing=0.5, seed=2))
    done = simulate(tyre(num_stages=6), tmp_path / "out", FAMILY, options)
    assert len(done.missing) == 3
    assert done.num_pictures == 24
    found = read_project(tmp_path / "out")
    for name in CAMERAS:
        source = open_sequence(found.cameras[name].sequence, found.folder)
        for stage in range(1, 7):
            assert source.read(stage - 1).any() == (done.missing.get(stage) != name)
    truth = json.loads((tmp_path / "out" / "truth" / "scene.json").read_text())
    assert truth["missing"] == {str(stage): name for stage, name in done.missing.items()}
    visible = [r for r in image_rows(tmp_path / "out") if r["visibility"] == "visible"]
    assert (
        len(visible)
        == done.num_visible
        == 6 * 36
        - sum(16 // 2 if name in ("cam1", "cam2") else 10 for name in done.missing.values())
    )
    assert not [r for r in visible if done.missing.get(int(r["stage"])) == r["camera"]]


def test_photographs(tmp_path):
    photos = photos_scene(
        FAMILY, heights_mm=[1400.0], step_deg=90.0, image_size_px=(648, 432), seed=1
    )
    done = simulate_photos(photos, tmp_path / "p", FAMILY)
    found = read_project(tmp_path / "p")
    source = open_sequence(found.cameras["handheld"].calibration, found.folder)
    assert (len(source), done.num_pictures, source.image_size_px) == (4, 4, (648, 432))
    names = [Path(source.name(i)).stem for i in range(4)]
    assert names == list(photos.cameras) == list(read_rig(tmp_path / "p/truth/rig.json").cameras)
    points = read_points(tmp_path / "p" / "truth" / "points.csv")
    np.testing.assert_allclose(points.position_mm, photos.place.centre_mm, atol=1e-8)
    assert (found.folder / found.calibration.scale_bars).is_file()
    for conditions in (Conditions(occluded=0.1), Conditions(missing=0.1)):
        with pytest.raises(ValueError, match="photographs know neither"):
            simulate_photos(photos, tmp_path / "q", FAMILY, SimulateOptions(conditions=conditions))
    assert [p.name for p in tmp_path.iterdir()] == ["p"]


# --- what cannot be ----------------------------------------------------------------------


def test_a_target_behind_a_camera_is_refused(tmp_path):
    scene = tyre()
    away = np.array([0.0, 0.0, -12000.0])
    behind = replace(scene, place=lambda t: scene.place(t).moved(np.eye(3), away))
    with pytest.raises(ValueError, match=r"at stage 1 target \d+ lies behind camera cam1"):
        simulate(behind, tmp_path / "out", FAMILY)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "options",
    [{"format": "avi"}, {"target_sigma_mm": -0.1}, {"target_sigma_mm": np.nan},
     {"num_threads": -1}],
)  # fmt: skip
def test_impossible_options(options):
    with pytest.raises(ValueError, match="expected"):
        SimulateOptions(**options)


@pytest.mark.parametrize("kind", ["file", "folder", "full", "link"])
def test_what_is_there_stays(tmp_path, kind):
    out = tmp_path / "out"
    if kind == "file":
        out.write_text("mine")
    elif kind == "link":
        out.symlink_to(tmp_path / "nowhere")
    else:
        out.mkdir()
        if kind == "full":
            (out / "mine").touch()
    before = sorted(str(p) for p in tmp_path.rglob("*"))
    with pytest.raises(FileExistsError, match="is there already, and nothing is overwritten"):
        simulate(tyre(), out, FAMILY)
    assert sorted(str(p) for p in tmp_path.rglob("*")) == before


def test_somebody_who_was_quicker_keeps_the_name(tmp_path):
    with pytest.raises(FileExistsError, match="made by somebody else meanwhile"):
        simulate(
            tyre(), tmp_path / "out", FAMILY,
            progress=lambda done, total, what: (tmp_path / "out").mkdir(exist_ok=True),
        )  # fmt: skip
    assert [p.name for p in tmp_path.rglob("*")] == ["out"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_an_interruption_leaves_nothing(tmp_path, error):
    def stop(done: int, total: int, what: str) -> None:
        if done == 2:
            raise error

    photos = photos_scene(FAMILY, heights_mm=[900.0], step_deg=120.0, image_size_px=(300, 200))
    with pytest.raises(error):
        simulate(tyre(), tmp_path / "made" / "too" / "out", FAMILY, progress=stop)
    with pytest.raises(error):
        simulate_photos(photos, tmp_path / "photos", FAMILY, progress=stop)
    assert list(tmp_path.iterdir()) == []
