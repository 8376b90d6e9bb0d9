"""The rig file: rig.json, and its covariance in rig.npz beside it.

Layout (schema 1), keys as in docs/conventions.md: pixels for the ten interior
parameters and r0, a 3x3 matrix and mm for ``cam_from_world``; ``sigma`` has the
same names, its ``rotation`` being three angles in rad, the standard deviations
of the rotation vector applied on the left of cam_from_world. ``covariance``
names the ``.npz`` (arrays ``cov`` and ``names``, "camera/parameter") and its
SHA-256, so that a covariance of another calibration is never taken.

Only where cameras look through flat windows into a fluid: ``interfaces``, by name
{"normal": [x, y, z] unit, towards the cameras, "distance_mm": normal . X on the
cameras' side of the window, "fluid_index": ..., "glass": [index, thickness_mm],
"sigma": {"tilt_1", "tilt_2" in rad, "distance_mm"}}, the last two optional, and
``interface`` of a camera names one.
"""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.project.atomic import write_bytes, write_text
from videogrammetry.project.provenance import plain, sha256_of
from videogrammetry.project.toml_table import nearest
from videogrammetry.types import INTERIOR_NAMES, FlatInterface, FloatArray, RigCamera, RigData

#: The version of the file's layout that this program writes and reads.
SCHEMA = 1
#: Names of the ten interior parameters in the file: f, x0, y0 carry their unit.
INTERIOR_KEYS = tuple(
    f"{name}_px" if name in ("f", "x0", "y0") else name for name in INTERIOR_NAMES
)
ROTATION_NAMES = ("rx", "ry", "rz")
TRANSLATION_NAMES = ("tx", "ty", "tz")

_RIG_KEYS = ("schema", "distortion", "cameras", "reference", "how", "covariance", "interfaces")
_CAMERA_KEYS = ("image_size_px", *INTERIOR_KEYS, "r0_px", "cam_from_world")
_CAMERA_OPTIONAL = ("sigma", "sigma_floor_px", "interface")
_INTERFACE_KEYS = ("normal", "distance_mm", "fluid_index")
_INTERFACE_SIGMAS = {"tilt_1": "tilt_1", "tilt_2": "tilt_2", "distance_mm": "distance"}
_SIGMA_KEYS = (*INTERIOR_KEYS, "cam_from_world")
_POSE_KEYS = ("rotation", "translation_mm")
_ROTATION_TOLERANCE = 1e-6


def write_rig(path: str | os.PathLike[str], rig: RigData) -> None:
    """Writes rig.json, and rig.npz beside it if the rig has a covariance.

    Floats are written so that reading gives the same bits back.
    """
    target = Path(path)
    directions = {camera.measured for camera in rig.cameras.values()}
    if len(directions) != 1:
        raise ValueError("rig: expected one direction of distortion for all cameras, got both")
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "distortion": "measured" if directions.pop() else "ideal",
        "cameras": {
            name: _camera_to_json(camera, rig.sigma_floor_px.get(name))
            for name, camera in rig.cameras.items()
        },
        "reference": rig.reference,
        "how": plain(rig.how),
    }
    interfaces = _interfaces_of(rig)
    if interfaces:
        document["interfaces"] = {n: _interface_to_json(i) for n, i in interfaces.items()}
    beside = target.with_suffix(".npz")
    if rig.cov is not None:
        data = _npz_bytes(rig)
        write_bytes(beside, data)
        document["covariance"] = {"file": beside.name, "sha256": sha256_of(beside)}
    write_text(target, json.dumps(document, indent=1, allow_nan=False) + "\n")
    if rig.cov is None:
        beside.unlink(missing_ok=True)


def _interfaces_of(rig: RigData) -> dict[str, FlatInterface]:
    """The rig's windows by name; ValueError where two of one name differ."""
    found: dict[str, FlatInterface] = {}
    for name, camera in rig.cameras.items():
        if camera.interface is None:
            continue
        first = found.setdefault(camera.interface.name, camera.interface)
        if _interface_to_json(first) != _interface_to_json(camera.interface):
            raise ValueError(
                f"camera {name}: its interface {first.name!r} differs from another camera's of the "
                "same name; give it another name"
            )
    return found


def _interface_to_json(interface: FlatInterface) -> dict[str, Any]:
    result: dict[str, Any] = {
        "normal": np.asarray(interface.normal, dtype=float).tolist(),
        "distance_mm": float(interface.distance_mm),
        "fluid_index": float(interface.fluid_index),
    }
    if interface.glass_thickness_mm > 0:
        result["glass"] = [float(interface.glass_index), float(interface.glass_thickness_mm)]
    sigma = {
        key: float(interface.sigma[name])
        for key, name in _INTERFACE_SIGMAS.items()
        if name in interface.sigma
    }
    if sigma:
        result["sigma"] = sigma
    return result


def _npz_bytes(rig: RigData) -> bytes:
    assert rig.cov is not None
    if rig.cov.shape != (len(rig.cov_names), len(rig.cov_names)):
        raise ValueError(
            f"cov: expected {len(rig.cov_names)} rows as cov_names, got shape {rig.cov.shape}"
        )
    arrays: dict[str, Any] = {"cov": rig.cov, "names": np.array(rig.cov_names, dtype=np.str_)}
    if rig.volume_mm is not None and rig.volume_seen is not None:
        arrays.update(volume_mm=rig.volume_mm, volume_seen=rig.volume_seen)
    data = io.BytesIO()
    np.savez(data, **arrays)
    return data.getvalue()


def _camera_to_json(camera: RigCamera, sigma_floor_px: float | None) -> dict[str, Any]:
    values = [float(v) for v in camera.interior]
    result: dict[str, Any] = {"image_size_px": [int(v) for v in camera.image_size_px]}
    result.update(zip(INTERIOR_KEYS, values, strict=True))
    result["r0_px"] = float(camera.r0_px)
    result["cam_from_world"] = {
        "rotation": np.asarray(camera.rotation, dtype=float).tolist(),
        "translation_mm": np.asarray(camera.translation_mm, dtype=float).tolist(),
    }
    sigma = _sigma_to_json(camera.sigma)
    if sigma:
        result["sigma"] = sigma
    if camera.interface is not None:
        result["interface"] = camera.interface.name
    if sigma_floor_px is not None:
        result["sigma_floor_px"] = float(sigma_floor_px)
    return result


def _sigma_to_json(sigma: Mapping[str, float]) -> dict[str, Any]:
    known = (*INTERIOR_NAMES, *ROTATION_NAMES, *TRANSLATION_NAMES)
    for name in sigma:
        if name not in known:
            raise ValueError(f"sigma: {name!r} is not a parameter{nearest(name, known)}")
    result: dict[str, Any] = {
        key: float(sigma[name])
        for key, name in zip(INTERIOR_KEYS, INTERIOR_NAMES, strict=True)
        if name in sigma and math.isfinite(sigma[name])
    }
    pose = {}
    for key, names in zip(_POSE_KEYS, (ROTATION_NAMES, TRANSLATION_NAMES), strict=True):
        if all(name in sigma and math.isfinite(sigma[name]) for name in names):
            pose[key] = [float(sigma[name]) for name in names]
    if pose:
        result["cam_from_world"] = pose
    return result


def read_rig(path: str | os.PathLike[str]) -> RigData:
    """Reads a rig file.

    Raises
    ------
    ProjectFileError
        Not there, damaged, of a newer schema, a key missing or wrong, or the
        covariance missing or of another calibration.
    """
    file = Path(path)
    reader = _Reader(file)
    document = reader.document()
    reader.check_keys(document, "the rig", _RIG_KEYS[:3], _RIG_KEYS[3:])
    measured = document["distortion"] == "measured"
    if document["distortion"] not in ("measured", "ideal"):
        raise reader.error(f"distortion is {document['distortion']!r}, not 'measured' or 'ideal'")
    cameras = document["cameras"]
    if not isinstance(cameras, dict) or not cameras:
        raise reader.error("it names no camera")
    floors = {n: c["sigma_floor_px"] for n, c in cameras.items() if _has(c, "sigma_floor_px")}
    windows = document.get("interfaces") or {}
    if not isinstance(windows, dict):
        raise reader.error("interfaces is not a JSON object")
    interfaces = {name: reader.interface(name, item) for name, item in windows.items()}
    return RigData(
        cameras={
            name: reader.camera(name, item, measured, interfaces) for name, item in cameras.items()
        },
        reference=str(document.get("reference", "")),
        sigma_floor_px={n: reader.number(f, f"{n} sigma_floor_px") for n, f in floors.items()},
        how=document.get("how") or {},
        **reader.arrays(document.get("covariance"), len(cameras)),
    )


def _has(item: Any, key: str) -> bool:
    return isinstance(item, dict) and item.get(key) is not None


class _Reader:
    """Takes a rig document apart; every error names the file."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def error(self, what: str, remedy: str = "calibrate again, or correct it") -> ProjectFileError:
        return ProjectFileError(f"{self._file}: {what}; {remedy}")

    def document(self) -> dict[str, Any]:
        """The JSON object, its schema checked."""
        if not self._file.is_file():
            raise self.error(
                "there is no such rig file", "correct its name, or run calibrate first"
            )
        try:
            document = json.loads(self._file.read_text(encoding="utf-8-sig"))
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise self.error(
                f"not a whole JSON file ({error}): it is damaged or cut short",
                "copy it again, or calibrate again",
            ) from error
        if not isinstance(document, dict) or "cameras" not in document:
            raise self.error("this JSON file is no rig: it has no 'cameras'", "give a rig.json")
        schema = document.get("schema")
        if not isinstance(schema, int) or isinstance(schema, bool) or schema < 1:
            raise self.error(f"schema is {schema!r}: expected {SCHEMA}")
        if schema > SCHEMA:
            raise self.error(
                f"schema {schema} is newer than this program, which reads up to {SCHEMA}",
                "update videogrammetry",
            )
        return document

    def check_keys(
        self, item: Any, where: str, needed: tuple[str, ...], optional: tuple[str, ...]
    ) -> None:
        """All needed keys are there and no unknown one."""
        if not isinstance(item, dict):
            raise self.error(f"{where} is not a JSON object")
        for key in needed:
            if key not in item:
                raise self.error(f"{where} has no {key}")
        for key in item:
            if key not in (*needed, *optional):
                raise self.error(
                    f"{where} has the unknown key {key!r}{nearest(key, (*needed, *optional))}"
                )

    def number(self, value: Any, where: str) -> float:
        """A finite number."""
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise self.error(f"{where} is {value!r}, not a finite number")
        return float(value)

    def array(self, value: Any, shape: tuple[int, ...], where: str) -> FloatArray:
        """Finite numbers in the given shape."""
        try:
            result = np.array(value, dtype=float)
        except (TypeError, ValueError):
            result = np.empty(0)
        if result.shape != shape or not np.isfinite(result).all():
            size = "x".join(map(str, shape))
            raise self.error(f"{where} is not {size} finite numbers")
        return result

    def interface(self, name: str, item: Any) -> FlatInterface:
        """One window, checked."""
        where = f"interface {name!r}"
        self.check_keys(item, where, _INTERFACE_KEYS, ("glass", "sigma"))
        normal = self.array(item["normal"], (3,), f"{where} normal")
        off = abs(float(np.linalg.norm(normal)) - 1.0)
        if off > _ROTATION_TOLERANCE:
            raise self.error(f"{where} normal is not of unit length (off by {off:.2g})")
        glass = self.array(item.get("glass", [1.0, 0.0]), (2,), f"{where} glass")
        fluid = self.number(item["fluid_index"], f"{where} fluid_index")
        if not (1 <= fluid <= 4 and 1 <= glass[0] <= 4 and glass[1] >= 0):
            raise self.error(
                f"{where} has fluid_index {fluid}, glass {glass.tolist()}: refractive indices are "
                "1 to 4, a thickness is not negative"
            )
        sigma = item.get("sigma") or {}
        self.check_keys(sigma, f"{where} sigma", (), tuple(_INTERFACE_SIGMAS))
        return FlatInterface(
            name=name,
            normal=normal,
            distance_mm=self.number(item["distance_mm"], f"{where} distance_mm"),
            fluid_index=fluid,
            glass_index=float(glass[0]),
            glass_thickness_mm=float(glass[1]),
            sigma={
                _INTERFACE_SIGMAS[key]: self.number(value, f"{where} sigma {key}")
                for key, value in sigma.items()
            },
        )

    def camera(
        self, name: str, item: Any, measured: bool, interfaces: Mapping[str, FlatInterface]
    ) -> RigCamera:
        """One camera, checked."""
        where = f"camera {name!r}"
        self.check_keys(item, where, _CAMERA_KEYS, _CAMERA_OPTIONAL)
        size = self.array(item["image_size_px"], (2,), f"{where} image_size_px")
        if not all(v > 0 and v == int(v) for v in size):
            raise self.error(f"{where} image_size_px is {item['image_size_px']}")
        pose = item["cam_from_world"]
        self.check_keys(pose, f"{where} cam_from_world", _POSE_KEYS, ())
        rotation = self.array(pose["rotation"], (3, 3), f"{where} rotation")
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if off > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise self.error(f"{where} rotation is not a rotation matrix (off by {off:.2g})")
        window = item.get("interface")
        if window is not None and window not in interfaces:
            raise self.error(
                f"{where} looks through the interface {window!r}, which is not among 'interfaces'"
            )
        interior = np.array([self.number(item[k], f"{where} {k}") for k in INTERIOR_KEYS])
        r0_px = self.number(item["r0_px"], f"{where} r0_px")
        if interior[0] <= 0 or r0_px < 0:
            raise self.error(f"{where} f_px is {interior[0]}, r0_px {r0_px}: out of range")
        return RigCamera(
            image_size_px=(int(size[0]), int(size[1])),
            interior=interior,
            r0_px=r0_px,
            rotation=rotation,
            translation_mm=self.array(pose["translation_mm"], (3,), f"{where} translation_mm"),
            measured=measured,
            sigma=self.sigma(item.get("sigma") or {}, f"{where} sigma"),
            interface=None if window is None else interfaces[window],
        )

    def sigma(self, item: Any, where: str) -> dict[str, float]:
        """Standard deviations by parameter name."""
        self.check_keys(item, where, (), _SIGMA_KEYS)
        result = {
            name: self.number(item[key], f"{where} {key}")
            for key, name in zip(INTERIOR_KEYS, INTERIOR_NAMES, strict=True)
            if key in item
        }
        pose = item.get("cam_from_world", {})
        self.check_keys(pose, f"{where} cam_from_world", (), _POSE_KEYS)
        for key, names in zip(_POSE_KEYS, (ROTATION_NAMES, TRANSLATION_NAMES), strict=True):
            if key in pose:
                values = self.array(pose[key], (3,), f"{where} cam_from_world {key}")
                result.update(zip(names, values.tolist(), strict=True))
        return result

    def arrays(self, item: Any, num_cameras: int) -> dict[str, Any]:
        """What the file beside the rig holds: covariance, its names, the calibrated volume."""
        if item is None:
            return {}
        self.check_keys(item, "covariance", ("file", "sha256"), ())
        beside = self._file.parent / str(item["file"])
        remedy = "copy it beside the rig file, or take 'covariance' out of that to do without"
        if not beside.is_file():
            raise self.error(f"its covariance {beside.name} is not there", remedy)
        if sha256_of(beside) != item["sha256"]:
            raise self.error(
                f"{beside.name} beside it is damaged or belongs to another calibration", remedy
            )
        try:
            with np.load(beside, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            names = tuple(str(n) for n in arrays["names"])
            cov = self.array(arrays["cov"], (len(names), len(names)), beside.name)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise self.error(f"{beside.name} cannot be read ({error})", remedy) from error
        result: dict[str, Any] = {"cov": cov, "cov_names": names}
        if "volume_mm" in arrays:
            volume = self.array(arrays["volume_mm"], (len(arrays["volume_mm"]), 3), beside.name)
            seen = self.array(arrays["volume_seen"], (len(volume), num_cameras), beside.name)
            result.update(volume_mm=volume, volume_seen=seen.astype(bool))
        return result
