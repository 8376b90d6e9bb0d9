"""The demo's work: renders the paper's experiments and runs the whole chain on their files."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.accuracy import KnownLength, TruePoints, lengths_from_calibration
from videogrammetry.calibration import CalibrationRun
from videogrammetry.cli.progress import Progress
from videogrammetry.pipeline import calibrate_by, measure_project
from videogrammetry.pipeline.calibrate import calibration_pictures
from videogrammetry.pipeline.verify import (
    Verification,
    known_lengths,
    true_points,
    verification_document,
    verify_project,
)
from videogrammetry.project import (
    Project,
    plain,
    read_project,
    read_rig,
    read_scale_bars,
    read_trajectories,
    write_measurement,
    write_rig,
    write_text,
)
from videogrammetry.recognition import code_family
from videogrammetry.rendering.disturbances import Conditions, exposure_for_blur
from videogrammetry.rendering.scenes import (
    Scene,
    calibration_scene,
    cross_target,
    scale_bar_scene,
    tyre_scene,
)
from videogrammetry.rendering.simulate import Simulated, SimulateOptions, simulate
from videogrammetry.report import calibration_report
from videogrammetry.types import FloatArray, Measurement, RigData


@dataclass(frozen=True, kw_only=True)
class DemoSize:
    """How much is rendered.

    Attributes
    ----------
    orientations : of the cross. stages : of the tyre, over 0.8 s. bar_stages : of
        each of the two scale bars.
    """

    orientations: int
    stages: int
    bar_stages: int

    @property
    def frame_rate_hz(self) -> float:
        """Of the tyre: the whole fall and the rebound in ``stages``."""
        return 250.0 * self.stages / 200.0

    @property
    def recorded_bytes(self) -> int:
        """Of all recordings: four cameras, a million pixels of 12 bits."""
        stages = self.orientations + self.stages + 2 * self.bar_stages
        return 4 * stages * 1024 * 1024 * 3 // 2


SMALL = DemoSize(orientations=12, stages=40, bar_stages=11)
FULL = DemoSize(orientations=24, stages=200, bar_stages=44)


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Size and conditions of a demo.

    ``blur_px`` chooses the exposure of the moving scenes; None: 200 microseconds.
    Occlusion and missing pictures of ``conditions`` are for the moving scenes alone.
    """

    size: DemoSize = SMALL
    conditions: Conditions = field(default_factory=lambda: Conditions(seed=1))
    blur_px: float | None = None


@dataclass(frozen=True, kw_only=True)
class MeasuredScene:
    """A moving scene, measured and verified."""

    project: Project
    simulated: Simulated
    measurement: Measurement
    verification: Verification
    measure_s: float


@dataclass(frozen=True, kw_only=True)
class DemoResults:
    """Everything that the table and the page show."""

    folder: Path
    options: DemoOptions
    calibration: CalibrationRun
    paper_method: CalibrationRun
    truth_rig: RigData
    scenes: dict[str, MeasuredScene]
    tyre: Scene
    bar_error_paper_mm: dict[str, float]
    seconds: dict[str, float]


#: Folders of the scenes in the demo's folder.
CALIBRATION, TYRE, BAR, ACROSS = "calibration", "tyre", "scale-bar", "scale-bar-across"


def run_demo(
    folder: Path, options: DemoOptions, say: Callable[[str], None] = lambda text: None
) -> DemoResults:
    """Renders, calibrates, measures and verifies into ``folder``, which must not exist."""
    family = code_family("schneider-14")
    size, conditions = options.size, options.conditions
    seconds: dict[str, float] = {}
    cross = cross_target(family)
    tyre, bar, across = _moving_scenes(options)
    still = replace(conditions, occluded=0.0, missing=0.0)
    folder.mkdir(parents=True)

    say(f"1. render the cross at {size.orientations} orientations, four cameras")
    scene = calibration_scene(
        family, num_orientations=size.orientations, cross=cross, seed=conditions.seed
    )
    with _timed(seconds, "render"), _progress("render", "stages") as progress:
        simulate(
            scene, folder / CALIBRATION, family, SimulateOptions(conditions=still), cross=cross,
            progress=progress,
        )  # fmt: skip

    say("2. calibrate")
    project = read_project(folder / CALIBRATION)
    with _timed(seconds, "calibrate"), _progress("calibrate") as progress:
        runs = calibrate_by(project, ("joint", "mean"), progress=progress)
    run, mean = runs["joint"], runs["mean"]
    write_rig(project.rig_path, run.rig)
    page = calibration_report(run, project.name, calibration_pictures(project))
    write_text(project.rig_path.with_name("rig-report.html"), page)

    say("3. render, measure and verify the tyre and the scale bars")
    moving = SimulateOptions(conditions=conditions, calibration=folder / CALIBRATION)
    scenes: dict[str, MeasuredScene] = {}
    for name, what in ((TYRE, tyre), (BAR, bar), (ACROSS, across)):
        with _timed(seconds, "render"), _progress(f"render {name}", "stages") as progress:
            done = simulate(what, folder / name, family, moving, progress=progress)
        for suffix in (".json", ".npz"):  # the same cameras, so the same rig
            shutil.copy(project.rig_path.with_suffix(suffix), folder / name)
        scenes[name] = _measure(folder / name, done)
        seconds[f"measure {name}"] = scenes[name].measure_s
    truth_rig = read_rig(folder / CALIBRATION / "truth" / "rig.json")
    return DemoResults(
        folder=folder,
        options=options,
        calibration=run,
        paper_method=mean,
        truth_rig=truth_rig,
        scenes=scenes,
        tyre=tyre,
        bar_error_paper_mm={
            name: _calibration_alone(scenes[name], mean.rig, truth_rig) for name in (BAR, ACROSS)
        },
        seconds=seconds,
    )


def _moving_scenes(options: DemoOptions) -> tuple[Scene, Scene, Scene]:
    family, size = code_family("schneider-14"), options.size
    seed = options.conditions.seed
    tyre = tyre_scene(family, num_stages=size.stages, frame_rate_hz=size.frame_rate_hz)
    bar = scale_bar_scene(family, num_stages=size.bar_stages, seed=seed)
    across = scale_bar_scene(family, num_stages=size.bar_stages, seed=seed + 1, cross_pair=True)
    if options.blur_px is None:
        return tyre, bar, across
    blurred = [
        replace(scene, exposure_s=exposure_for_blur(scene, options.blur_px))
        for scene in (tyre, bar, across)
    ]
    return blurred[0], blurred[1], blurred[2]


def _measure(folder: Path, simulated: Simulated) -> MeasuredScene:
    project = read_project(folder)
    start = time.perf_counter()
    with _progress(f"measure {folder.name}", "stages") as progress:
        measurement = measure_project(project, progress=progress)
    seconds = time.perf_counter() - start
    write_measurement(project.measurement_path, measurement)
    verification = verify_project(project, measurement=measurement)
    document = plain(verification_document(verification))
    write_text(folder / "verification.json", json.dumps(document) + "\n")
    return MeasuredScene(
        project=project,
        simulated=simulated,
        measurement=measurement,
        verification=verification,
        measure_s=seconds,
    )


def _calibration_alone(scene: MeasuredScene, rig: RigData, truth_rig: RigData) -> float:
    """RMS error of the bars' lengths with a rig, from exact pictures."""
    truth: TruePoints = true_points(
        read_trajectories(scene.project.folder / "truth" / "trajectories.csv"),
        tuple(truth_rig.cameras),
    )
    bars: tuple[KnownLength, ...] = known_lengths(
        read_scale_bars(scene.project.folder / "bars.csv")
    )
    errors: FloatArray = lengths_from_calibration(rig, truth_rig, truth, bars)
    return float(np.sqrt(np.nanmean(errors**2)))


@contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - start


@contextmanager
def _progress(what: str, unit: str = "") -> Iterator[Any]:
    progress = Progress(what, unit)
    try:
        # The parts of the work keep the name given here.
        yield lambda done, total, part: progress(done, total)
    finally:
        progress.close()
