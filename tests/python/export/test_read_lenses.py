"""Rigs from other programs' files: what the peer wrote projects as the peer does."""

from __future__ import annotations

import json
import subprocess

import cv2
import numpy as np
import pytest
from export.lens_rigs import assert_within, points_seen_by, usual_rig
from export.test_rig_formats import ask_mrcal, opencv_pixels

from videogrammetry.errors import CalibrationError, ProjectFileError
from videogrammetry.export import (
    convert_for,
    format_file,
    format_folder,
    read_lens_cameras,
    rig_of_lenses,
)
from videogrammetry.geometry import project
from videogrammetry.rendering.scenes.paper_rig import paper_rig

MATRIX = np.array([[1500.0, 0, 530.25], [0, 1500.0, 480.5], [0, 0, 1]])
VECTOR, TRANSLATION = np.array([0.1, -0.3, 0.05]), np.array([-400.0, 30.0, 120.0])


def opencv_file(path, coefficients, matrix=MATRIX, **more):
    """As OpenCV itself writes it."""
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    store.write("image_width", 1024)
    store.write("image_height", 960)
    store.write("camera_matrix", matrix)
    store.write("distortion_coefficients", np.array(coefficients))
    for name, value in more.items():
        store.write(name, value)
    store.release()
    return path


def pictures(camera, points):
    return project(camera, points @ camera.rotation.T + camera.translation_mm)


@pytest.mark.peer
@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".json"])
def test_opencvs_own_file_exactly(tmp_path, suffix):
    coefficients = [-0.2, 0.1, 4e-4, -7e-4, 0.05]
    rotation = cv2.Rodrigues(VECTOR)[0]
    path = opencv_file(
        tmp_path / f"left{suffix}", coefficients, rotation=rotation, translation_mm=TRANSLATION
    )
    rig, fits = rig_of_lenses(read_lens_cameras(path))
    assert list(rig.cameras) == ["left"]
    camera = rig.cameras["left"]
    assert (camera.image_size_px, camera.measured) == ((1024, 960), False)
    assert fits["left"].residual.max_px < 1e-8
    points, _ = points_seen_by(camera, seed=1)
    theirs = opencv_pixels(points, rotation, TRANSLATION, MATRIX, np.array(coefficients))
    np.testing.assert_allclose(pictures(camera, points), theirs, rtol=0, atol=1e-8)


@pytest.mark.peer
@pytest.mark.parametrize("measured", [None, False])
def test_opencvs_rational_model_within_the_residual(tmp_path, measured):
    coefficients = [-0.2, 0.1, 4e-4, -7e-4, 0.05, 0.02, 0.01, -0.03]
    matrix = MATRIX * [[1.0, 1, 1], [1, 0.99, 1], [1, 1, 1]]
    path = opencv_file(tmp_path / "a.yaml", coefficients, matrix, rvec=VECTOR, T=TRANSLATION)
    rig, fits = rig_of_lenses(read_lens_cameras(path), measured=measured)
    camera = rig.cameras["a"]
    assert camera.measured is (measured is None)
    points, pixels = points_seen_by(camera, seed=2)
    theirs = opencv_pixels(points, cv2.Rodrigues(VECTOR)[0], TRANSLATION, matrix, coefficients)
    assert_within(theirs, pixels, fits["a"].residual)
    assert fits["a"].residual.max_px < 0.2


def test_two_cameras_of_which_one_is_exact_have_one_direction(tmp_path):
    cameras = []
    for name, extra in (("exact", []), ("rational", [0.02, 0.01, -0.03])):
        path = tmp_path / f"{name}.yaml"
        opencv_file(path, [-0.2, 0.1, 4e-4, -7e-4, 0.05, *extra])
        cameras += read_lens_cameras(path)
    rig, _ = rig_of_lenses(cameras)
    assert [c.measured for c in rig.cameras.values()] == [True, True]


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_there_and_back(tmp_path, suffix):
    there = usual_rig()
    cameras = convert_for(there, "opencv")
    path = tmp_path / f"rig{suffix}"
    path.write_text(format_file(cameras, "opencv", suffix))
    rig, fits = rig_of_lenses(read_lens_cameras(path))
    assert list(rig.cameras) == list(there.cameras)
    for k, (name, camera) in enumerate(rig.cameras.items()):
        points, pixels = points_seen_by(there.cameras[name], seed=k)
        both = fits[name].residual.max_px + cameras[k].residual.max_px
        assert np.abs(pictures(camera, points) - pixels).max() < 1.05 * both + 1e-6
        assert both < 0.02


def test_ros_file_is_read_too(tmp_path):
    cameras = convert_for(usual_rig(1), "ros", "equidistant")
    [(name, text)] = format_folder(cameras, "ros").items()
    (tmp_path / name).write_text(text)
    [camera] = read_lens_cameras(tmp_path / name)
    assert (camera.name, camera.lens.kind) == ("cam1", "equidistant")
    np.testing.assert_array_equal(camera.lens.coefficients, cameras[0].lens.coefficients)


# --- mrcal -----------------------------------------------------------------------------

_WRITE = """
import sys, numpy as np, mrcal
model = mrcal.cameramodel(intrinsics=(sys.argv[2], np.array(eval(sys.argv[3]))),
                          extrinsics_rt_fromref=np.array(eval(sys.argv[4])), imagersize=(1024, 960))
model.write(sys.argv[1])
"""


@pytest.mark.peer
@pytest.mark.parametrize("count", [0, 4, 5, 8, 12])
def test_mrcals_own_file(tmp_path, mrcal_python, count):
    values = [1500.0, 1488.0 if count > 5 else 1500.0, 530.25, 480.5]
    values += [-0.2, 0.1, 4e-4, -7e-4, 0.05, 0.02, 0.01, -0.03, 1e-3, -2e-3, 5e-4, 1e-3][:count]
    model = f"LENSMODEL_OPENCV{count}" if count else "LENSMODEL_PINHOLE"
    path = tmp_path / "right.cameramodel"
    pose = [*VECTOR.tolist(), *(TRANSLATION / 1000).tolist()]
    subprocess.run(
        [mrcal_python, "-c", _WRITE, str(path), model, str(values), str(pose)], check=True
    )
    rig, fits = rig_of_lenses(read_lens_cameras(path))
    camera = rig.cameras["right"]
    assert camera.measured is (count > 5)
    points, pixels = points_seen_by(camera, seed=count)
    [(theirs, _)] = ask_mrcal(mrcal_python, {str(path): (points / 1000).tolist()}).values()
    assert_within(np.array(theirs), pixels, fits["right"].residual)
    assert fits["right"].residual.max_px < (0.5 if count > 5 else 1e-8)


def test_our_mrcal_files_come_back(tmp_path):
    cameras = convert_for(usual_rig(2), "mrcal", "opencv5")
    for (name, text), camera in zip(format_folder(cameras, "mrcal").items(), cameras, strict=True):
        (tmp_path / name).write_text(text)
        [found] = read_lens_cameras(tmp_path / name)
        np.testing.assert_array_equal(found.lens.coefficients, camera.lens.coefficients)
        np.testing.assert_allclose(found.rotation, camera.rotation, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.translation_mm, camera.translation_mm, rtol=1e-15)


# --- what is wrong is named ------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "%YAML:1.0\n---\nx: 1\n", "has no camera_matrix"),
        ("a.yaml", "[1, 2", "not a whole YAML or JSON file"),
        ("a.yaml", "- 1\n- 2\n", "holds no camera_matrix"),
        ("a.yaml", "!!python/object/apply:os.system ['true']", "not a whole YAML"),
        ("a.json", '{"camera_matrix": [[1,0,0],[0,1,0]', "not a whole YAML or JSON"),
        ("a.json", json.dumps({"camera_matrix": [[1, 0], [0, 1]]}), r"shape \(3, 3\)"),
        ("a.json", json.dumps({"camera_matrix": MATRIX.tolist()}), "give --image-size"),
        (
            "a.json",
            json.dumps({"camera_matrix": (MATRIX + np.eye(3, k=1)).tolist()}),
            "a skew is not part of OpenCV",
        ),
        (
            "a.json",
            json.dumps({"K": MATRIX.tolist(), "D": [0.1] * 6, "width": 9, "height": 9}),
            "opencv has 0, 4, 5, 8, 12, 14 of them",
        ),
        (
            "a.json",
            json.dumps({"K": MATRIX.tolist(), "width": 9, "height": 9, "R": [[2, 0], [0, 2]]}),
            "neither a rotation matrix nor vector",
        ),
        ("a.json", json.dumps({"K": MATRIX.tolist(), "image_size": [9.5, 9]}), "image size is"),
        ("a.json", '{"cameras": []}', "names no camera"),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_OPENCV4',", "not a whole .cameramodel"),
        ("a.cameramodel", "__import__('os')", "not a whole .cameramodel"),
        (
            "a.cameramodel",
            "{'lensmodel': 'LENSMODEL_CAHVOR', 'intrinsics': [1,2,3,4], 'imagersize': [9,9]}",
            "LENSMODEL_CAHVOR with 4 intrinsics is not known",
        ),
    ],
)  # fmt: skip
def test_damaged_files_are_named(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(ProjectFileError, match=message) as caught:
        read_lens_cameras(tmp_path / name)
    assert name in str(caught.value)


def test_missing_file_and_names_that_repeat(tmp_path):
    with pytest.raises(ProjectFileError, match="there is no such file"):
        read_lens_cameras(tmp_path / "none.yaml")
    camera = convert_for(usual_rig(1), "mrcal")[0]
    with pytest.raises(CalibrationError, match="two cameras are named 'cam1'"):
        rig_of_lenses([camera, camera])


def test_the_papers_rig_comes_back_through_its_tilt(tmp_path):
    there = paper_rig()
    cameras = convert_for(there, "opencv")
    (tmp_path / "rig.yaml").write_text(format_file(cameras, "opencv", ".yaml"))
    rig, fits = rig_of_lenses(read_lens_cameras(tmp_path / "rig.yaml"))
    for name, camera in rig.cameras.items():
        # The ten parameters hold the shear that the tilt stands for.
        points, pixels = points_seen_by(there.cameras[name], seed=3)
        assert np.abs(pictures(camera, points) - pixels).max() < 1.0
        assert fits[name].residual.rms_px < 0.15
