"""Rigs in other programs' files: the peer's own projection is the oracle."""

from __future__ import annotations

import json
import subprocess

import cv2
import numpy as np
import pytest
import yaml
from export.lens_rigs import assert_within, points_seen_by, usual_rig

from videogrammetry.export import (
    RIG_FORMATS,
    convert_for,
    convert_rig,
    format_file,
    format_folder,
)
from videogrammetry.export.lenses import quaternion
from videogrammetry.geometry import rotation_from_vector
from videogrammetry.rendering.scenes.paper_rig import paper_rig

RIGS = {"usual": usual_rig(), "paper": paper_rig()}
rigs = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


def opencv_pixels(points, rotation, translation, matrix, coefficients, fisheye=False):
    vector, _ = cv2.Rodrigues(np.asarray(rotation))
    if fisheye:
        pixels, _ = cv2.fisheye.projectPoints(
            points[:, None], vector, np.asarray(translation), matrix, np.asarray(coefficients)
        )
    else:
        pixels, _ = cv2.projectPoints(
            points, vector, np.asarray(translation), matrix, np.asarray(coefficients)
        )
    return pixels.reshape(-1, 2)


# --- OpenCV ----------------------------------------------------------------------------


@pytest.mark.peer
@rigs
@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_opencv_reads_and_projects(rig, suffix, tmp_path):
    cameras = convert_for(rig, "opencv")
    path = tmp_path / f"cameras{suffix}"
    path.write_text(format_file(cameras, "opencv", suffix))
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    node = store.getNode("cameras")
    assert node.size() == len(rig.cameras)
    for k, (name, camera) in enumerate(rig.cameras.items()):
        item = node.at(k)
        assert item.getNode("name").string() == name
        assert int(item.getNode("image_width").real()) == camera.image_size_px[0]
        assert item.getNode("residual_rms_px").real() == cameras[k].residual.rms_px
        world, pixels = points_seen_by(camera, seed=k)
        theirs = opencv_pixels(
            world,
            item.getNode("rotation").mat(),
            item.getNode("translation_mm").mat(),
            item.getNode("camera_matrix").mat(),
            item.getNode("distortion_coefficients").mat(),
        )
        assert_within(theirs, pixels, cameras[k].residual, name)


@pytest.mark.peer
def test_one_camera_has_the_names_of_opencvs_sample(tmp_path):
    [camera] = convert_for(usual_rig(1), "opencv")
    path = tmp_path / "one.yml"
    path.write_text(format_file([camera], "opencv", ".yml"))
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(store.getNode("camera_matrix").mat(), camera.camera_matrix)
    found = store.getNode("distortion_coefficients").mat().ravel()
    np.testing.assert_array_equal(found, camera.lens.coefficients)
    assert f"residual of {camera.residual}" in path.read_text()


# --- ROS -------------------------------------------------------------------------------


@pytest.mark.peer
@rigs
@pytest.mark.parametrize("model", [None, "opencv5", "equidistant"])
def test_ros_camera_info_by_its_own_formula(rig, model, tmp_path):
    cameras = convert_for(rig, "ros", model)
    texts = format_folder(cameras, "ros")
    assert list(texts) == [f"{name}.yaml" for name in rig.cameras]
    for camera, text in zip(cameras, texts.values(), strict=True):
        info = yaml.safe_load(text)
        size = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
        k, d, r, p = (
            np.reshape(info[key]["data"], (info[key]["rows"], info[key]["cols"]))
            for key in (
                "camera_matrix",
                "distortion_coefficients",
                "rectification_matrix",
                "projection_matrix",
            )
        )
        assert d.shape == (1, size[info["distortion_model"]])
        np.testing.assert_array_equal(r, np.eye(3))
        np.testing.assert_array_equal(p, np.column_stack([k, np.zeros(3)]))
        world, pixels = points_seen_by(rig.cameras[camera.name], seed=11)
        # The orientation is in a comment: quaternion x, y, z, w, then metres.
        [line] = [line for line in text.splitlines() if "quaternion" in line]
        x, y, z, w, *translation = (
            float(v) for part in line.split("[")[1:] for v in part.split("]")[0].split(",")
        )
        angle = 2 * np.arctan2(np.linalg.norm([x, y, z]), w)
        vector = np.array([x, y, z]) * (angle / max(np.linalg.norm([x, y, z]), 1e-300))
        theirs = opencv_pixels(
            world / 1000, rotation_from_vector(vector), translation, k, d,
            info["distortion_model"] == "equidistant",
        )  # fmt: skip
        assert_within(theirs, pixels, camera.residual, camera.name)


# --- Kalibr ----------------------------------------------------------------------------


@pytest.mark.peer
@rigs
@pytest.mark.parametrize("model", ["opencv4", "equidistant", None])
def test_kalibr_camchain_by_its_own_formula(rig, model):
    cameras = convert_for(rig, "kalibr", model)
    chain = yaml.safe_load(format_file(cameras, "kalibr", ".yaml"))
    assert list(chain) == [f"cam{k}" for k in range(len(cameras))]
    # The first camera's frame is the chain's: points of the world taken into it first.
    first = cameras[0]
    here = np.eye(4)
    for camera, item in zip(cameras, chain.values(), strict=True):
        world, pixels = points_seen_by(rig.cameras[camera.name], seed=12)
        in_first = (world @ first.rotation.T + first.translation_mm) / 1000
        here = np.array(item.get("T_cn_cnm1", np.eye(4))) @ here
        fu, fv, pu, pv = item["intrinsics"]
        assert item["resolution"] == list(camera.image_size_px)
        fisheye = item["distortion_model"] == "equidistant"
        assert fisheye or item["distortion_model"] == "radtan"
        theirs = opencv_pixels(
            in_first, here[:3, :3], here[:3, 3], np.array([[fu, 0, pu], [0, fv, pv], [0, 0, 1]]),
            item["distortion_coeffs"], fisheye,
        )  # fmt: skip
        assert_within(theirs, pixels, camera.residual, camera.name)


# --- COLMAP ----------------------------------------------------------------------------


def write_folder(folder, texts):
    folder.mkdir()
    for name, text in texts.items():
        (folder / name).write_text(text)


@pytest.mark.peer
@rigs
@pytest.mark.parametrize("model", [None, "opencv4", "equidistant"])
def test_colmap_reads_and_projects(rig, model, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    cameras = convert_for(rig, "colmap", model)
    write_folder(tmp_path / "sparse", format_folder(cameras, "colmap"))
    found = pycolmap.Reconstruction(str(tmp_path / "sparse"))
    assert (found.num_cameras(), found.num_images(), found.num_rigs()) == (len(cameras),) * 2 + (1,)
    images = {image.name: image for image in found.images.values()}
    for camera in cameras:
        image = images[f"{camera.name}.png"]
        world, pixels = points_seen_by(rig.cameras[camera.name], seed=13)
        # Through frame and rig, as COLMAP composes them.
        pose = image.cam_from_world()
        in_cam = world / 1000 @ pose.rotation.matrix().T + pose.translation
        theirs = np.array(found.cameras[image.camera_id].img_from_cam(in_cam))
        # Its (0, 0) is the corner of the first pixel.
        assert_within(theirs - 0.5, pixels, camera.residual, camera.name)


def test_colmaps_rig_and_images_tell_the_same_orientation():
    texts = format_folder(convert_for(RIGS["usual"], "colmap"), "colmap")

    def rows(name):
        return [r.split() for r in texts[name].splitlines() if r and not r.startswith("#")]

    poses = [np.array(row[1:8], dtype=float) for row in rows("images.txt")]
    [rig], [frame] = rows("rigs.txt"), rows("frames.txt")
    np.testing.assert_array_equal(np.array(frame[2:9], dtype=float), poses[0])
    assert rig[:4] == ["1", "3", "CAMERA", "1"]
    w, x, y, z = poses[0][:4]
    turn_first = rotation_from_quaternion(w, x, y, z)
    for k, pose in enumerate(poses[1:]):
        sensor = rig[4 + 10 * k : 14 + 10 * k]
        assert sensor[:3] == ["CAMERA", str(k + 2), "1"]
        values = np.array(sensor[3:], dtype=float)
        turn = rotation_from_quaternion(*values[:4])
        np.testing.assert_allclose(
            turn @ turn_first, rotation_from_quaternion(*pose[:4]), rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(turn @ poses[0][4:] + values[4:], pose[4:], rtol=0, atol=1e-12)


def rotation_from_quaternion(w, x, y, z):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_quaternions_are_those_of_the_rotation():
    rng = np.random.default_rng(8)
    vectors = [*rng.normal(size=(50, 3)), np.zeros(3), np.array([np.pi, 0, 0])]
    for vector in vectors:
        rotation = rotation_from_vector(vector)
        q = quaternion(rotation)
        assert q[0] >= 0
        np.testing.assert_allclose(rotation_from_quaternion(*q), rotation, rtol=0, atol=1e-14)


# --- mrcal -----------------------------------------------------------------------------

# Reads models and points, projects them by mrcal alone.
_MRCAL = """
import json, sys
import numpy as np
import mrcal
answer = {}
for name, points in json.load(sys.stdin).items():
    model = mrcal.cameramodel(name)
    in_cam = mrcal.transform_point_rt(model.extrinsics_rt_fromref(), np.array(points))
    answer[name] = [mrcal.project(in_cam, *model.intrinsics()).tolist(),
                    [int(v) for v in model.imagersize()]]
print(json.dumps(answer))
"""


def ask_mrcal(python, points_m):
    answer = subprocess.run(
        [python, "-c", _MRCAL], input=json.dumps(points_m), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    return json.loads(answer.stdout)


@pytest.mark.peer
@rigs
@pytest.mark.parametrize("model", [None, "opencv4", "opencv5", "opencv12"])
def test_mrcal_reads_and_projects(rig, model, tmp_path, mrcal_python):
    cameras = convert_for(rig, "mrcal", model)
    write_folder(tmp_path / "models", format_folder(cameras, "mrcal"))
    seen = {c.name: points_seen_by(rig.cameras[c.name], seed=14) for c in cameras}
    files = {c.name: str(tmp_path / "models" / f"{c.name}.cameramodel") for c in cameras}
    answer = ask_mrcal(
        mrcal_python, {files[name]: (world / 1000).tolist() for name, (world, _) in seen.items()}
    )
    for camera in cameras:
        theirs, size = answer[files[camera.name]]
        assert size == list(camera.image_size_px)
        assert_within(np.array(theirs), seen[camera.name][1], camera.residual, camera.name)


# --- what is refused -------------------------------------------------------------------


def test_formats_say_what_they_cannot_hold():
    cameras = convert_rig(usual_rig(2), ["opencv5"])
    with pytest.raises(ValueError, match=r"a ros file holds one camera, the rig has cam1, cam2"):
        format_file(cameras, "ros", ".yaml")
    with pytest.raises(ValueError, match="colmap is a folder of files"):
        format_file(cameras, "colmap", "")
    with pytest.raises(ValueError, match="kalibr is one file for all cameras"):
        format_folder(cameras, "kalibr")
    with pytest.raises(ValueError, match="model: kalibr has opencv4, equidistant, not opencv8"):
        convert_for(usual_rig(1), "kalibr", "opencv8")


def test_every_format_has_models_that_exist():
    from videogrammetry.export.lenses import MODELS

    assert {"opencv", "ros", "kalibr", "colmap", "mrcal"} == set(RIG_FORMATS)
    for form in RIG_FORMATS.values():
        assert set(form.default) <= set(form.models) <= set(MODELS)
        assert [form.one, form.joint, form.folder].count(None) == 2
