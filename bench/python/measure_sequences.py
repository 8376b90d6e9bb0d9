"""Stages a second from packed pictures to a file of trajectories, part by part.

    python bench/python/measure_sequences.py [--stages 2000] [--threads 2] [--full-every 25]
        [--clutter 0.3 0]

Four cameras of 1024x1024 pixels, 12 bit packed in Photron's way, see 50 coded targets on
a shaking plate; the rendered period of 64 stages is read again and again, as a recording
in the page cache. Times are of all stages, the errors those of the positions
against the truth.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from videogrammetry.calibration.calibrated_volume import CalibratedVolume
from videogrammetry.geometry import CAMERA_PARAMETERS, rotation_looking_at
from videogrammetry.matching import MatchingOptions
from videogrammetry.motion import MotionOptions
from videogrammetry.pipeline.assemble import (
    TrajectoryBuilder,
    assemble,
    plan_of_chunks,
)
from videogrammetry.pipeline.chunk import CameraTargets, measure_targets
from videogrammetry.pipeline.chunk_job import ChunkOptions, ChunkWorker, chunks_of, learn_models
from videogrammetry.pipeline.chunk_record import make_record
from videogrammetry.pipeline.chunk_store import FolderStore
from videogrammetry.pipeline.frames import map_bounded
from videogrammetry.pipeline.linking import Linker, link_chunks
from videogrammetry.pipeline.measure_job import first_free_id
from videogrammetry.project import MeasurementLayout, open_measurement_writer
from videogrammetry.recognition import (
    RecognitionOptions,
    TrackedOptions,
    code_family,
    recognize_sequence,
)
from videogrammetry.reconstruction import CalibrationField, Triangulator
from videogrammetry.rendering import Background, Renderer, SceneTargets, Sensor
from videogrammetry.sequence import create_sequence, open_sequence
from videogrammetry.types import RigCamera, RigData

PERIOD, TARGETS, SIZE = 64, 50, 1024
SIGMAS = {"f": 0.03, "x0": 0.04, "y0": 0.04, "A1": 2e-12, "rx": 2e-6, "ry": 2e-6, "rz": 2e-6}
SIGMAS |= {"tx": 0.005, "ty": 0.005, "tz": 0.008}


class Looped:
    """A recording that is read again and again."""

    def __init__(self, source, count):
        self.source, self.count = source, count
        self.image_size_px, self.frame_rate_hz = source.image_size_px, source.frame_rate_hz

    def __len__(self):
        return self.count

    def name(self, index):
        return self.source.name(index % len(self.source))

    def read(self, index):
        return self.source.read(index % len(self.source))

    def packed(self, index):
        return self.source.packed(index % len(self.source))


def make_rig() -> RigData:
    cameras = {}
    for k, (x, y) in enumerate([(-520, -180), (-180, 180), (180, -180), (520, 180)]):
        place = np.array([x, y, -1500.0])
        rotation = rotation_looking_at(place, [0.0, 0, 0], up=(0.0, -1.0, 0.0))
        cameras[f"camera{k + 1}"] = RigCamera(
            image_size_px=(SIZE, SIZE),
            interior=np.r_[2350.0, 4, -6, 2e-8, np.zeros(6)],
            r0_px=480.0,
            rotation=rotation,
            translation_mm=-rotation @ place,
        )
    names = tuple(f"{c}/{p}" for c in cameras for p in CAMERA_PARAMETERS)
    sigma = np.array([SIGMAS.get(n.split("/")[1], 0.0) for n in names])
    volume = np.random.default_rng(1).uniform(-300, 300, (200, 3)) * [1, 1, 0.4]
    return RigData(
        cameras=cameras,
        cov=np.diag(sigma**2),
        cov_names=names,
        volume_mm=volume,
        volume_seen=np.ones((len(volume), len(cameras)), bool),
        sigma_floor_px=dict.fromkeys(cameras, 0.005),
    )


def positions(stage: int) -> np.ndarray:
    """The plate's targets at a stage of the period."""
    x, y = np.meshgrid(np.arange(8) - 3.5, np.arange(7) - 3.0)
    flat = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])[:TARGETS] * 58.0
    phase = 2 * np.pi * stage / PERIOD
    bend = 6.0 * np.sin(phase + flat[:, 0] / 150) * np.cos(flat[:, 1] / 200)
    shake = [4 * np.cos(phase), 3 * np.sin(phase), 0]
    return flat + shake + np.column_stack([0 * bend, 0 * bend, bend])


def render(rig: RigData, folder: Path, clutter: float = 0.3) -> None:
    family = code_family("schneider-14")
    ids = np.arange(1, TARGETS + 1)
    for name, camera in rig.cameras.items():
        renderer = Renderer(
            camera,
            background=Background(level=0.3, clutter=clutter, seed=3),
            sensor=Sensor(psf_sigma_px=0.7, read_noise=8.0, bit_depth=12),
        )
        with create_sequence(
            folder / name,
            format="mraw",
            image_size_px=(SIZE, SIZE),
            num_frames=PERIOD,
            bit_depth=12,
            frame_rate_hz=5000.0,
        ) as writer:
            for stage in range(PERIOD):
                targets = SceneTargets(
                    centre_mm=positions(stage),
                    radius_mm=4.0,
                    id=ids,
                    num_bits=14,
                    code=[family.codes[i - 1] for i in ids],
                    ring=family.ring,
                )
                writer.append(renderer.render(targets, seed=stage).image)


class Clock:
    """Processor time of parts, by name."""

    def __init__(self):
        self.seconds = {}

    def run(self, name, function, *arguments, **options):
        begin = time.process_time()
        result = function(*arguments, **options)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - begin
        return result


def parts(rig, sources, options, models, stages, store) -> Clock:
    """The same work, its parts timed one by one."""
    clock = Clock()
    triangulator = Triangulator(rig)
    field, volume = CalibrationField(triangulator), CalibratedVolume(rig)
    for first, last in chunks_of(1, stages):
        found = [
            clock.run(
                "recognition",
                recognize_sequence,
                source,
                options.recognition,
                camera=models[name],
                track=TrackedOptions(full_every=options.full_every),
                first=first - 1,
                last=last - 1,
                num_threads=1,
            )
            for name, source in sources.items()
        ]
        cameras = [CameraTargets(f.targets, f.offsets) for f in found]
        result = clock.run(
            "matching, triangulation",
            measure_targets,
            triangulator,
            cameras,
            options.matching,
            field,
        )
        stage = np.arange(first, last + 1)
        record = clock.run("record", make_record, result, stage, volume)
        clock.run("keep", store.put, (first, last), record)
    chunks = chunks_of(1, stages)
    clock.run("number", link_chunks, store, chunks, first_free_id(options.recognition))
    return clock


def write(rig, store, chunks, linked, path) -> None:
    names = tuple(rig.cameras)
    plan = plan_of_chunks(store, chunks, linked, names, MotionOptions())
    layout = MeasurementLayout(
        stage=linked.totals.stage,
        point_id=linked.point_id,
        camera_names=names,
        num_targets=linked.num_targets,
        reference_stage=1,
        centroid_points=plan.centroid_points,
        image_name=[["#"] * len(linked.totals.stage)] * len(names),
        frame_rate_hz=5000.0,
        provenance={},
        warnings=(),
        flag_meanings={},
    )
    with open_measurement_writer(path, layout) as writer:
        assemble(store, chunks, linked, plan, TrajectoryBuilder(linked, 5000.0, names), writer)


def error_of(store, chunks) -> tuple[float, float, int]:
    """RMS of an axis (mm), RMS over the sigmas, and points a stage at least."""
    errors, normalised, least = [], [], TARGETS
    for chunk in chunks:
        record = store.get(chunk)
        stage = np.repeat(record.stage, record.point_count)
        truth = np.stack([positions((s - 1) % PERIOD) for s in range(1, PERIOD + 1)])
        off = record.position_mm - truth[(stage - 1) % PERIOD, record.point_code - 1]
        errors.append(off)
        normalised.append(off / np.sqrt(record.cov_image_mm2[:, [0, 3, 5]]))
        least = min(least, int(record.point_count.min()))
    return (
        float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        float(np.sqrt(np.mean(np.concatenate(normalised) ** 2))),
        least,
    )


def anonymous_mb() -> float:
    """Memory of this process that is no file, now."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon"):
            return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def read_once(sources, stages) -> float:
    """Seconds to read the bytes of all pictures once, on one thread."""
    begin = time.perf_counter()
    for source in sources.values():
        for index in range(stages):
            np.asarray(source.packed(index).data).view(np.uint64).max()
    return time.perf_counter() - begin


def run(rig, sources, options, stages, threads, folder) -> None:
    models = learn_models(sources, options.recognition, (1, stages))
    chunks = chunks_of(1, stages)
    store = FolderStore(folder / f"parts-{options.full_every}", "bench")
    worker = ChunkWorker(rig, sources, options, models)
    peak = 0.0
    begin = time.perf_counter()
    cpu = time.process_time()

    def work(chunk):
        store.put(chunk, worker(*chunk))
        return anonymous_mb()

    linker = Linker(store, chunks, first_free_id(options.recognition))
    for chunk, used in zip(chunks, map_bounded(work, chunks, threads), strict=True):
        peak = max(peak, used)
        linker.add(chunk)  # as measure does, while the next ones are being measured
    measured = time.perf_counter()
    linked = linker.result()
    numbered, tail = time.perf_counter(), time.process_time()
    write(rig, store, chunks, linked, folder / "measurement.h5")
    end, tail = time.perf_counter(), time.process_time() - tail
    peak = max(peak, anonymous_mb())
    cpu = time.process_time() - cpu
    rms, normalised, least = error_of(store, chunks)
    read_s = read_once(sources, min(stages, 256)) * stages / min(stages, 256)
    seconds = {
        "measure the chunks": measured - begin,
        "and number the points: what is left": numbered - measured,
        "motion and file": end - numbered,
        "all": end - begin,
    }
    print(f"\nfull frame every {options.full_every}, {threads} threads, {stages} stages\n")
    print("| part | s | us a stage | stages/s |\n| --- | ---: | ---: | ---: |")
    for name, value in seconds.items():
        print(f"| {name} | {value:.2f} | {value / stages * 1e6:.0f} | {stages / value:.0f} |")
    print(
        f"\nprocessor time {cpu / stages * 1e6:.0f} us a stage, {tail / stages * 1e6:.0f} of them "
        f"motion and file; reading all bytes once "
        f"{read_s / stages * 1e6:.0f} us (ratio {(end - begin) / read_s:.1f}); anonymous memory "
        f"{peak:.0f} MB at most\nerror {rms:.4f} mm an axis, {normalised:.2f} of its sigma; "
        f"{least} of {TARGETS} points at the worst stage"
    )
    size = os.path.getsize(folder / "measurement.h5")
    print(f"measurement.h5: {size / stages / 1e3:.1f} kB a stage")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stages", type=int, default=2000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--full-every", type=int, nargs="*", default=[25, 1])
    parser.add_argument("--clutter", type=float, nargs="*", default=[0.3, 0.0])
    parser.add_argument("--parts", action="store_true", help="times of the parts on one thread")
    arguments = parser.parse_args()
    rig = make_rig()
    for clutter in arguments.clutter:
        print(f"\n{TARGETS} targets, ground with {clutter:g} of the contrast of clutter")
        with tempfile.TemporaryDirectory() as name:
            measure(rig, Path(name), clutter, arguments)


def measure(rig: RigData, folder: Path, clutter: float, arguments: argparse.Namespace) -> None:
    render(rig, folder, clutter)
    sources = {
        camera: Looped(open_sequence(folder / f"{camera}.cihx"), arguments.stages)
        for camera in rig.cameras
    }
    options = ChunkOptions(recognition=RecognitionOptions(), matching=MatchingOptions())
    for full_every in arguments.full_every:
        chosen = replace(options, full_every=full_every)
        run(rig, sources, chosen, arguments.stages, arguments.threads, folder)
        if arguments.parts:
            models = learn_models(sources, chosen.recognition, (1, 200))
            store = FolderStore(folder / "parts", "parts")
            clock = parts(rig, sources, chosen, models, 200, store)
            for part, seconds in clock.seconds.items():
                print(f"{part}: {seconds / 200 * 1e6:.0f} us of processor time a stage")


if __name__ == "__main__":
    main()
