"""The check of the cameras in a measurement: from targets, and from pictures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from moving_camera import body, calibrated, pictures, ring_rig, turned

from videogrammetry.geometry import vector_from_rotation
from videogrammetry.pipeline.chunk import CameraTargets, measure_targets
from videogrammetry.pipeline.chunk_record import (
    CalibratedVolume,
    join_records,
    make_record,
)
from videogrammetry.pipeline.linking import Linked
from videogrammetry.pipeline.stability import StabilityCheck
from videogrammetry.pipeline.totals import Totals
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import POINT_FLAGS, PointSet, Targets

# What the edges say of a centre, and the calibration's floor.
EDGE_PX, FLOOR_PX = 0.015, 0.013
UNSTABLE = 1 << POINT_FLAGS.index("unstable_camera")


def sighted(camera, xy, codes) -> Targets:
    """Targets that face along z: seen from the side their circles are narrow."""
    n = len(xy)
    narrow = abs(camera.rotation[2, 2])
    return Targets(
        centre_px=xy,
        semi_axes_px=np.tile([8.0, 8.0 * narrow], (n, 1)),
        angle_rad=np.full(n, np.pi / 2),
        id=np.asarray(codes, np.int32),
        cov=np.tile(np.eye(5) * EDGE_PX**2, (n, 1, 1)),
        edge_rms_px=np.full(n, 0.02),
        contrast=np.full(n, 3000.0),
        ring_status=np.zeros(n, np.uint8),
    )


def records_of(rig, rig_at, position, rng, *, coded=True, still=None):
    """Records of chunks of 100 stages; ``still`` (N, 3): points 101, ... that do not move."""
    triangulator, volume = Triangulator(rig), CalibratedVolume(rig)
    points = position.shape[1]
    codes = np.arange(1, points + 1) if coded else np.full(points, -1)
    records = []
    for first in range(1, len(position) + 1, 100):
        stages = np.arange(first, min(first + 100, len(position) + 1))
        targets = [[] for _ in rig.cameras]
        for stage in stages:
            places, numbers = position[stage - 1], codes
            if still is not None:
                places = np.concatenate([places, still])
                numbers = np.concatenate([codes, 101 + np.arange(len(still))])
            xy = pictures(rig_at(stage), places, rng, np.hypot(EDGE_PX, FLOOR_PX))
            for c, camera in enumerate(rig.cameras.values()):
                targets[c].append(sighted(camera, xy[:, c], numbers))
        result = measure_targets(triangulator, [CameraTargets.of_stages(t) for t in targets])
        records.append(make_record(result, stages, volume))
    return records


def checked(rig, records, **options):
    check = StabilityCheck([(1, rig)], (1, int(records[-1].stage[-1])), **options)
    for record in records:
        check.add(record)
    return check.result()


def scene(seed, cameras=4):
    rng = np.random.default_rng(seed)
    truth = ring_rig(cameras, rng, sigma=0.2)
    rig = dataclasses.replace(
        calibrated(truth, rng), sigma_floor_px=dict.fromkeys(truth.cameras, FLOOR_PX)
    )
    return rng, truth, rig


@pytest.mark.parametrize("turn_mrad", [0.1, 2.0])
@pytest.mark.parametrize("cameras", [2, 4])
def test_a_moved_camera_is_named_with_stage_and_size(cameras, turn_mrad) -> None:
    rng, truth, rig = scene(1, cameras)
    after = turned(truth, 1, (turn_mrad * 1e-3, 0, 0))
    position = body(rng, 20, 300, swing_mm=20.0)
    # By 2 mrad (5 px) matching leaves the camera's targets out: "inconsistent ID".
    records = records_of(rig, lambda s: after if s >= 151 else truth, position, rng)
    found = checked(rig, records)
    (warning,) = found.warnings
    assert "'c2'" in warning
    assert "between the stages 149 and 153" in warning
    (numbers,) = found.found
    assert numbers["found_at_stage"] <= 170
    if cameras == 4:
        assert numbers["cameras"] == ["c2"]
        off = np.array(numbers["turn_mrad"]) - [turn_mrad, 0, 0]
        # The model is linear in the turn: good to a share of it.
        assert (np.abs(off) < 5 * np.array(numbers["sigma_turn_mrad"]) + 0.01 * turn_mrad).all()
        assert numbers["sigma_turn_mrad"][0] < 0.02 + 0.02 * turn_mrad
        assert found.unstable_from.tolist() == [2**31 - 1, 150, 2**31 - 1, 2**31 - 1]
    else:
        assert set(numbers["cameras"]) == {"c1", "c2"}
        assert "do not tell which" in warning


def test_quiet_records_say_nothing_and_have_series() -> None:
    rng, truth, rig = scene(2)
    found = checked(rig, records_of(rig, lambda s: truth, body(rng, 20, 300), rng))
    assert found.warnings == ()
    assert found.series.stage.tolist() == list(range(1, 301, 16))
    assert found.series.turn_rad.shape == (19, 4, 3)
    assert np.isnan(found.series.turn_rad[0]).all()
    off = found.series.turn_rad[1:] / found.series.sigma_turn_rad[1:]
    assert np.abs(off).max() < 5
    # 20 points of 0.02 px, 0.0045 px of the picture and f = 2650 px, are 1.7 urad across the
    # axis for one look; roll and what points take make it more, never as much as 0.1 mrad.
    assert np.median(found.series.sigma_turn_rad[10:, :, :2]) < 1e-4


def test_points_that_a_moved_camera_sees_are_flagged_from_there_on() -> None:
    rng, truth, rig = scene(3)
    after = turned(truth, 0, (2e-4, 0, 0))
    records = records_of(
        rig, lambda s: after if s >= 151 else truth, body(rng, 20, 200), rng, coded=False
    )
    stability = checked(rig, records)
    none = np.empty(0, np.int32)
    linked = Linked(none, [], [], none, none, none, 0, Totals(), stability)
    assert not (linked.flags(records[0]) & UNSTABLE).any()
    record = records[1]
    stage = np.repeat(record.stage, record.point_count)
    flagged = (linked.flags(record) & UNSTABLE) > 0
    np.testing.assert_array_equal(flagged, (stage >= 150) & record.cameras_used[:, 0])
    # By 0.5 px matching leaves all of the camera's targets out afterwards.
    assert flagged.any()
    assert "'c1' has moved between the stages 149 and 153" in stability.warnings[0]


def test_static_points_say_which_of_two_cameras() -> None:
    rng, truth, rig = scene(4, 2)
    after = turned(truth, 1, (1e-4, 0, 0))
    still = rng.uniform(-400, 400, (8, 3))
    sigma_mm = 0.02
    static = PointSet(
        id=101 + np.arange(8, dtype=np.int32),
        position_mm=still + rng.normal(0, sigma_mm, still.shape),
        cov_mm2=np.tile(sigma_mm**2 * np.array([1.0, 0, 0, 1, 0, 1]), (8, 1)),
    )
    position = body(rng, 20, 300, swing_mm=20.0)
    quiet = checked(
        rig, records_of(rig, lambda s: truth, position, rng, still=still), static=static
    )
    assert quiet.warnings == ()
    records = records_of(rig, lambda s: after if s >= 151 else truth, position, rng, still=still)
    found = checked(rig, records, static=static).found
    (by_points,) = (entry for entry in found if entry["by"] == "static points")
    assert by_points["cameras"] == ["c2"]
    assert by_points["found_at_stage"] <= 170
    assert by_points["turn_mrad"][0] == pytest.approx(0.1, abs=0.03)


def test_a_record_of_parts_is_that_of_the_whole() -> None:
    rng, truth, rig = scene(5)
    position = body(rng, 12, 4)
    xy = [pictures(truth, p, rng) for p in position]
    cameras = [
        CameraTargets.of_stages([sighted(camera, of[:, c], np.arange(1, 13)) for of in xy])
        for c, camera in enumerate(rig.cameras.values())
    ]
    volume, triangulator = CalibratedVolume(rig), Triangulator(rig)
    stage = np.arange(1, 5)
    whole = make_record(measure_targets(triangulator, cameras), stage, volume)
    joined = join_records(
        [
            make_record(
                measure_targets(triangulator, [c.rows(rows) for c in cameras]), stage[rows], volume
            )
            for rows in (slice(0, 1), slice(1, 4))
        ]
    )
    for name in whole.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(whole, name), getattr(joined, name), err_msg=name)


@pytest.mark.slow
def test_from_pictures_to_the_pose_found_anew(tmp_path) -> None:
    from small_project import small_rig, write_small_project

    from videogrammetry.pipeline import measure_project, measure_to_file
    from videogrammetry.project import read_measurement, read_project

    stages, moved_at, turn = 200, 120, (0.0, 1e-3, 0.0)
    rig = small_rig(4)
    after = turned(rig, 1, turn)
    path = write_small_project(tmp_path / "moved", stages, rig=rig, later=(moved_at, after))
    project = read_project(path)
    table = measure_to_file(project)
    (warning,) = (w for w in table.warnings if "has moved" in w)
    assert "camera 'c2' has moved between the stages 117 and 121" in warning
    assert "--reorient c2:118" in warning
    measured = read_measurement(project.measurement_path)
    flagged = (measured.trajectories.flags & UNSTABLE) > 0
    there = measured.trajectories.cameras_used[..., 1]
    late = measured.trajectories.stage[:, None] >= 118
    np.testing.assert_array_equal(flagged, there & late)
    assert np.nanmax(measured.stability.chi2) > measured.stability.critical_chi2
    assert measured.stability.turn_rad.shape == (13, 4, 3)

    again = measure_project(project, reorient=[("c2", moved_at)])
    assert [w for w in again.warnings if "has moved" in w] == []
    (how,) = again.provenance["options"]["reoriented"]
    assert (how["camera"], how["stage"], how["by"]) == ("c2", moved_at, "rays")
    error = vector_from_rotation(np.array(how["rotation"]) @ after.cameras["c2"].rotation.T)
    assert (np.abs(error) < 5 * np.array(how["sigma_turn_rad"])).all()
    # Without the turn undone the camera's rays are 0.7 px off, or left out.
    assert again.trajectories.cameras_used[moved_at + 5 :, :, 1].mean() > 0.9
    assert np.nanmedian(again.trajectories.rms_px[moved_at:]) < 1.3 * np.nanmedian(
        again.trajectories.rms_px[: moved_at - 1]
    )
