"""A project of small pictures with many stages, calibrated and ready to be measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from videogrammetry.geometry import CAMERA_PARAMETERS, rotation_looking_at
from videogrammetry.project import write_rig
from videogrammetry.recognition import code_family
from videogrammetry.rendering import Background, Renderer, SceneTargets, Sensor
from videogrammetry.sequence import create_sequence
from videogrammetry.types import RigCamera, RigData

SIZE_PX, PERIOD = (192, 128), 20
SIGMAS = {"f": 0.03, "x0": 0.04, "y0": 0.04, "rx": 2e-6, "ry": 2e-6, "rz": 2e-6}
SIGMAS |= {"tx": 0.005, "ty": 0.005, "tz": 0.008}
_FLAT = np.column_stack([g.ravel() for g in np.meshgrid([-75.0, -25, 25, 75], [-30.0, 30], [0])])


def small_rig(cameras: int = 3) -> RigData:
    """Cameras side by side, 900 mm before the origin."""
    rig = {}
    for k in range(cameras):
        place = np.array([400.0 * (k / max(cameras - 1, 1) - 0.5), 60.0 * (k % 2), -900.0])
        rotation = rotation_looking_at(place, [0.0, 0, 0], up=(0.0, -1.0, 0.0))
        rig[f"c{k + 1}"] = RigCamera(
            image_size_px=SIZE_PX,
            interior=np.r_[700.0, 1, -2, 1e-8, np.zeros(6)],
            r0_px=75.0,
            rotation=rotation,
            translation_mm=-rotation @ place,
        )
    names = tuple(f"{c}/{p}" for c in rig for p in CAMERA_PARAMETERS)
    volume = np.random.default_rng(1).uniform(-1, 1, (100, 3)) * [100, 60, 40]
    return RigData(
        cameras=rig,
        cov=np.diag([SIGMAS.get(n.split("/")[1], 0.0) ** 2 for n in names]),
        cov_names=names,
        volume_mm=volume,
        volume_seen=np.ones((100, cameras), bool),
        sigma_floor_px=dict.fromkeys(rig, 0.005),
    )


def positions(stage: int) -> np.ndarray:
    """(8, 3) where the targets are at a stage, from 1; the motion repeats every 20 stages."""
    phase = 2 * np.pi * (stage - 1) / PERIOD
    moved = _FLAT + np.array([4 * np.cos(phase), 3 * np.sin(phase), 0])
    moved[:, 2] += 5 * np.sin(phase + _FLAT[:, 0] / 60)
    return moved


def frames_of(rig: RigData, name: str, stages: int, *, coded: bool = True) -> list[np.ndarray]:
    """What a camera sees, period after period with the same noise."""
    family = code_family("schneider-14")
    renderer = Renderer(
        rig.cameras[name],
        background=Background(level=0.06),
        sensor=Sensor(psf_sigma_px=0.6, read_noise=1.0),
    )
    period = [
        renderer.render(
            SceneTargets(
                centre_mm=positions(s),
                radius_mm=5.5,
                num_bits=14 if coded else 0,
                code=list(family.codes[:8]) if coded else 0,
                ring=family.ring,
                white_on_black=True,
            ),
            seed=s,
        ).image
        for s in range(1, PERIOD + 1)
    ]
    return [period[s % PERIOD] for s in range(stages)]


def write_small_project(
    folder: Path,
    stages: int,
    *,
    rig: RigData | None = None,
    later: tuple[int, RigData] | None = None,
) -> Path:
    """A folder with a rig and one recording a camera; returns the project file.

    ``later``: a stage, and how the cameras stand from there on.
    """
    rig = rig or small_rig()
    folder.mkdir(exist_ok=True)
    for name in rig.cameras:
        with create_sequence(
            folder / name,
            format="mraw",
            image_size_px=SIZE_PX,
            num_frames=stages,
            bit_depth=8,
            frame_rate_hz=1000.0,
        ) as writer:
            frames = frames_of(rig, name, stages)
            if later is not None:
                first, moved = later
                frames[first - 1 :] = frames_of(moved, name, stages)[first - 1 :]
            for frame in frames:
                writer.append(frame)
    write_rig(folder / "rig.json", rig)
    sections = "".join(f'[cameras.{n}]\nsequence = "{n}.cihx"\n' for n in rig.cameras)
    text = f'schema = 1\nname = "small"\n{sections}[targets]\ncodes = "schneider-14"\n'
    (folder / "project.toml").write_text(text, encoding="utf-8")
    return folder / "project.toml"
