"""rig.json and rig.npz: the same bits back, or a sentence about what is wrong."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from videogrammetry.errors import ProjectFileError
from videogrammetry.geometry import rotation_from_vector
from videogrammetry.project import provenance, read_rig, write_rig
from videogrammetry.types import INTERIOR_NAMES, FlatInterface, RigCamera, RigData

RNG = np.random.default_rng(5)
POSE = ("rx", "ry", "rz", "tx", "ty", "tz")


def a_rig(measured: bool = True) -> RigData:
    names = (*INTERIOR_NAMES, *POSE)
    cameras = {
        name: RigCamera(
            image_size_px=(1024, 768),
            interior=np.abs(RNG.normal(size=10)) * 10.0 ** RNG.integers(-20, 4, 10),
            r0_px=RNG.uniform(300, 500),
            rotation=rotation_from_vector(RNG.normal(size=3)),
            translation_mm=RNG.normal(size=3) * 1e4,
            measured=measured,
            sigma={key: float(RNG.uniform()) for key in names},
        )
        for name in ("left", "2")
    }
    root = RNG.normal(size=(32, 32))
    return RigData(
        cameras=cameras,
        reference="camera left",
        cov=root @ root.T,
        cov_names=tuple(f"{camera}/{name}" for camera in cameras for name in names),
        sigma_floor_px={"left": 0.021},
        how=provenance({"method": "joint", "critical_value": 3.29}),
    )


@pytest.mark.parametrize("measured", [True, False])
def test_the_same_bits_back(tmp_path: Path, measured: bool) -> None:
    rig = a_rig(measured)
    path = tmp_path / "rig.json"
    write_rig(path, rig)
    back = read_rig(path)
    assert list(back.cameras) == ["left", "2"]
    for name, camera in rig.cameras.items():
        other = back.cameras[name]
        np.testing.assert_array_equal(other.interior, camera.interior)
        np.testing.assert_array_equal(other.rotation, camera.rotation)
        np.testing.assert_array_equal(other.translation_mm, camera.translation_mm)
        assert other.r0_px == camera.r0_px
        assert other.image_size_px == camera.image_size_px
        assert other.measured is measured
        assert other.sigma == camera.sigma
    np.testing.assert_array_equal(back.cov, rig.cov)
    assert back.cov_names == rig.cov_names
    assert back.sigma_floor_px == rig.sigma_floor_px
    assert back.reference == rig.reference
    assert back.how == rig.how
    assert sorted(p.name for p in tmp_path.iterdir()) == ["rig.json", "rig.npz"]


def test_the_keys_are_those_of_the_contract(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", a_rig())
    document = json.loads((tmp_path / "rig.json").read_text())
    assert document["schema"] == 1
    assert document["distortion"] == "measured"
    camera = document["cameras"]["left"]
    interior = ["f_px", "x0_px", "y0_px", "A1", "A2", "A3", "B1", "B2", "E1", "E2"]
    assert list(camera) == [
        *("image_size_px", *interior, "r0_px", "cam_from_world", "sigma", "sigma_floor_px")
    ]
    assert list(camera["sigma"]) == [*interior, "cam_from_world"]
    assert np.shape(camera["cam_from_world"]["rotation"]) == (3, 3)


def test_a_rig_without_covariance_removes_an_old_one(tmp_path: Path) -> None:
    rig = a_rig()
    write_rig(tmp_path / "rig.json", rig)
    write_rig(tmp_path / "rig.json", RigData(cameras=rig.cameras))
    assert not (tmp_path / "rig.npz").exists()
    assert read_rig(tmp_path / "rig.json").cov is None


def test_a_rig_cut_anywhere_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    write_rig(path, a_rig())
    data = path.read_bytes()
    for length in range(0, len(data) - 2, 7):
        path.write_bytes(data[:length])
        with pytest.raises(ProjectFileError, match=r"rig\.json.*cut short"):
            read_rig(path)


def change(document: dict, *keys: str, value: object = None, delete: bool = False) -> None:
    for key in keys[:-1]:
        document = document[key]
    if delete:
        del document[keys[-1]]
    else:
        document[keys[-1]] = value


LEFT = ("cameras", "left")
WRONG = [
    (("schema",), 2, ["newer", "update"]),
    (("schema",), "1", ["schema"]),
    (("distortion",), "both", ["distortion", "'both'"]),
    ((*LEFT, "f_px"), None, ["camera 'left' f_px"]),
    ((*LEFT, "f_px"), -3.0, ["camera 'left' f_px"]),
    ((*LEFT, "f_px"), "2600", ["camera 'left' f_px", "'2600'"]),
    ((*LEFT, "f_pix"), 3.0, ["f_pix", "did you mean 'f_px'"]),
    ((*LEFT, "image_size_px"), [1024], ["image_size_px"]),
    ((*LEFT, "image_size_px"), [1024, 0], ["image_size_px"]),
    ((*LEFT, "cam_from_world", "rotation"), [[2, 0, 0], [0, 1, 0], [0, 0, 1]], ["rotation"]),
    ((*LEFT, "cam_from_world", "rotation"), [[-1, 0, 0], [0, 1, 0], [0, 0, 1]], ["rotation"]),
    ((*LEFT, "cam_from_world", "translation_mm"), [1, 2], ["translation_mm"]),
    ((*LEFT, "sigma", "g_px"), 1.0, ["sigma", "g_px"]),
    (("cameras",), {}, ["no camera"]),
    (("covariance", "file"), "other.npz", ["other.npz", "not there"]),
]


@pytest.mark.parametrize(("keys", "value", "words"), WRONG)
def test_wrong_values_are_named(tmp_path: Path, keys, value, words) -> None:
    path = tmp_path / "rig.json"
    write_rig(path, a_rig())
    document = json.loads(path.read_text())
    change(document, *keys, value=value)
    path.write_text(json.dumps(document))
    with pytest.raises(ProjectFileError) as caught:
        read_rig(path)
    for word in (str(path), *words):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["A1", "r0_px", "cam_from_world"])
def test_a_missing_key_is_named(tmp_path: Path, key: str) -> None:
    path = tmp_path / "rig.json"
    write_rig(path, a_rig())
    document = json.loads(path.read_text())
    change(document, *LEFT, key, delete=True)
    path.write_text(json.dumps(document))
    with pytest.raises(ProjectFileError, match=f"camera 'left' has no {key}"):
        read_rig(path)


def test_a_covariance_of_another_calibration_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    write_rig(path, a_rig())
    other = tmp_path / "other.json"
    write_rig(other, a_rig())
    (tmp_path / "other.npz").replace(tmp_path / "rig.npz")
    with pytest.raises(ProjectFileError, match=r"rig\.npz.*another calibration"):
        read_rig(path)
    (tmp_path / "rig.npz").unlink()
    with pytest.raises(ProjectFileError, match=r"rig\.npz is not there"):
        read_rig(path)


def test_what_is_no_rig(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match="no such rig file"):
        read_rig(tmp_path / "rig.json")
    (tmp_path / "rig.json").write_text('{"a": 1}')
    with pytest.raises(ProjectFileError, match="is no rig"):
        read_rig(tmp_path / "rig.json")
    (tmp_path / "rig.json").write_bytes(b"\xff\x00")
    with pytest.raises(ProjectFileError, match=r"rig\.json"):
        read_rig(tmp_path / "rig.json")


def through_a_window(rig: RigData) -> RigData:
    window = FlatInterface(
        name="front",
        normal=np.array([0.6, 0.0, -0.8]),
        distance_mm=-np.pi * 1e2,
        fluid_index=1.3337,
        glass_index=1.51,
        glass_thickness_mm=6.1,
        sigma={"tilt_1": 1e-4, "distance": 0.3},
    )
    return replace(rig, cameras={**rig.cameras, "2": replace(rig.cameras["2"], interface=window)})


def test_windows_come_back_with_the_same_bits(tmp_path: Path) -> None:
    rig = through_a_window(a_rig())
    path = tmp_path / "rig.json"
    write_rig(path, rig)
    back = read_rig(path)
    assert back.cameras["left"].interface is None
    window, other = rig.cameras["2"].interface, back.cameras["2"].interface
    assert window is not None
    assert other is not None
    np.testing.assert_array_equal(other.normal, window.normal)
    assert replace(other, normal=window.normal) == window
    # Without one, the file is as it was before there were any.
    write_rig(path, a_rig())
    assert "interface" not in path.read_text(encoding="utf-8")


def test_two_windows_of_one_name_are_refused(tmp_path: Path) -> None:
    rig = through_a_window(a_rig())
    window = rig.cameras["2"].interface
    assert window is not None
    other = replace(rig.cameras["left"], interface=replace(window, distance_mm=1.0))
    with pytest.raises(ValueError, match="differs from another camera's"):
        write_rig(tmp_path / "rig.json", replace(rig, cameras={**rig.cameras, "left": other}))


def _set(*keys: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        for key in keys[:-1]:
            document = document[key]
        document[keys[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_set("interfaces", "front", "normal", value=[0, 0, 2]), "unit length"),
        (_set("interfaces", "front", "normal", value=[0, 1]), "3 finite numbers"),
        (_set("interfaces", "front", "fluid_index", value=0.5), "1 to 4"),
        (_set("interfaces", "front", "glass", value=[1.5, -1]), "not negative"),
        (_set("interfaces", "front", "depth", value=1), "unknown key 'depth'"),
        (_set("interfaces", "front", "sigma", value={"tilt": 1}), "unknown key 'tilt'"),
        (_set("cameras", "2", "interface", value="back"), "not among 'interfaces'"),
        (_set("interfaces", value=[]), "not among 'interfaces'"),
        (_set("interfaces", value=[1]), "not a JSON object"),
    ],
)
def test_wrong_windows_are_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], said: str
) -> None:
    path = tmp_path / "rig.json"
    write_rig(path, through_a_window(a_rig()))
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ProjectFileError, match=said):
        read_rig(path)
