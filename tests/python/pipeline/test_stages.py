"""What one stage leaves out for its size, and what is said of stages together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from two_pairs import NAMES, two_pair_rig

from videogrammetry.calibration.calibrated_volume import CalibratedVolume
from videogrammetry.errors import MeasurementError
from videogrammetry.geometry import project
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.pipeline.chunk import CameraTargets, measure_targets
from videogrammetry.pipeline.chunk_record import make_record
from videogrammetry.pipeline.totals import (
    Totals,
    nothing_measured,
    refuse_senseless,
    stage_warnings,
)
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import Targets

DIAMETER_MM, SIGMA_PX = 40.0, 0.02
ALL = slice(None)
RNG = np.random.default_rng(5)
RIG = dataclasses.replace(two_pair_rig(RNG), cov=None, cov_names=())
CODES = np.arange(1, 13, dtype=np.int32)
POSITION = RNG.uniform(-800, 800, (12, 3))


def sighted(camera: int, diameter_mm, points=ALL) -> Targets:
    """The targets of one camera: circles nearly edge-on, for cameras on both sides."""
    c = RIG.cameras[NAMES[camera]]
    in_cam = POSITION[points] @ c.rotation.T + c.translation_mm
    n = len(in_cam)
    semi = 0.5 * c.interior[0] * np.broadcast_to(diameter_mm, 12)[points] / in_cam[:, 2]
    return Targets(
        centre_px=project(c, in_cam),
        semi_axes_px=np.column_stack([semi, 0.2 * semi]),
        angle_rad=np.zeros(n),
        id=CODES[points],
        cov=np.tile(np.eye(5) * SIGMA_PX**2, (n, 1, 1)),
        edge_rms_px=np.full(n, 0.02),
        contrast=np.full(n, 3000.0),
        ring_status=np.zeros(n, np.uint8),
    )


def stage(sizes, diameter_mm=DIAMETER_MM, rig=RIG):
    targets = [sighted(c, sizes[c]) for c in range(len(rig.cameras))]
    return measure_stage(Triangulator(rig), targets, diameter_mm=diameter_mm)


def measure_stage(triangulator, targets, **options):
    cameras = [CameraTargets.of_stages([t]) for t in targets]
    return measure_targets(triangulator, cameras, **options)


def totals_of(results) -> Totals:
    totals = Totals()
    for number, result in enumerate(results, start=1):
        totals.add(make_record(result, np.array([number]), CalibratedVolume(RIG)))
    return totals


def status(result, camera):
    return [TARGET_STATUS[s] for s in result.matches.status[camera]]


def test_right_sizes_stay() -> None:
    # 15 % + 4 sigmas is the border; 12 % is within it.
    for size in (DIAMETER_MM, 0.88 * DIAMETER_MM, 1.12 * DIAMETER_MM):
        result = stage([size] * 4)
        assert len(result.points) == 12
        assert result.size.num_checked == 48
        assert len(result.size.measured_mm) == 0
        assert stage_warnings(totals_of([result]), NAMES, DIAMETER_MM) == []


def test_one_sighting_of_another_size_leaves_the_other_cameras() -> None:
    sizes = [np.full(12, DIAMETER_MM) for _ in range(4)]
    sizes[1][3] = 0.8 * DIAMETER_MM
    result = stage(sizes)
    row = result.points.id.tolist().index(CODES[3])
    assert result.points.target[row].tolist() == [3, -1, 3, 3]
    assert status(result, 1)[3] == "another size"
    assert len(result.points) == 12
    assert result.size.measured_mm == pytest.approx([0.8 * DIAMETER_MM], rel=0.01)


def test_a_partner_left_alone_has_none() -> None:
    names = NAMES[:2]
    rig = dataclasses.replace(RIG, cameras={n: RIG.cameras[n] for n in names}, volume_seen=None,
                              volume_mm=None)  # fmt: skip
    sizes = [np.full(12, DIAMETER_MM) for _ in range(2)]
    sizes[0][7] = 1.25 * DIAMETER_MM
    result = stage(sizes, rig=rig)
    assert CODES[7] not in result.points.id
    assert len(result.points) == len(result.matches) == 11
    assert status(result, 0)[7] == "another size"
    assert status(result, 1)[7] == "no partner"
    assert np.isfinite(result.points.position_mm).all()


def test_without_a_diameter_every_size_is_taken() -> None:
    result = stage([60.0] * 4, diameter_mm=None)
    assert result.size is None
    assert len(result.points) == 12


def test_far_off_the_axis_a_circle_may_look_larger() -> None:
    # At 40 degrees a circle square to its ray is 1 / cos(40) = 1.31 times f d / z long.
    wide = dataclasses.replace(RIG.cameras["cam1"], interior=np.r_[500.0, np.zeros(9)])
    shifted = dataclasses.replace(
        wide, translation_mm=wide.translation_mm + np.array([900.0, 0, 0])
    )
    rig = dataclasses.replace(RIG, cameras={"left": wide, "right": shifted}, volume_seen=None,
                              volume_mm=None)  # fmt: skip
    points = wide.rotation.T @ (np.array([10000.0, 0, 12000.0]) - wide.translation_mm)
    targets = []
    for camera in rig.cameras.values():
        in_cam = points @ camera.rotation.T + camera.translation_mm
        longest = 0.5 * 500.0 * 400.0 * np.linalg.norm(in_cam) / in_cam[2] ** 2
        one = sighted(0, DIAMETER_MM, slice(0, 1))
        targets.append(
            dataclasses.replace(
                one,
                centre_px=project(camera, in_cam[None]),
                semi_axes_px=np.array([[longest, 0.7 * longest]]),
            )
        )
    assert len(measure_stage(Triangulator(rig), targets, diameter_mm=400.0).points) == 1


def test_a_wrong_diameter_is_named_with_the_right_one() -> None:
    result = stage([DIAMETER_MM] * 4, diameter_mm=60.0)
    assert len(result.points) == 0
    said = nothing_measured(totals_of([result]), 60.0)
    assert "diameter_mm = 60" in said
    assert "48 of 48" in said
    assert "theirs is 40 mm; correct diameter_mm" in said


def test_many_of_another_size_are_a_warning_few_are_none() -> None:
    for wrong, warned in ((2, False), (5, True)):
        sizes = np.full(12, DIAMETER_MM)
        sizes[:wrong] = 25.0
        said = stage_warnings(totals_of([stage([sizes] * 4)]), NAMES, DIAMETER_MM)
        assert len(said) == warned
        if warned:
            assert "20 of 48" in said[0]
            assert "theirs is 25 mm" in said[0]
            assert "are dots hidden in part" in said[0]


def empty(stages_of_camera) -> list:
    """Stages at which a camera sees nothing: {camera: stages}, over three stages."""
    none = slice(0, 0)
    results = []
    for number in (1, 2, 3):
        targets = [
            sighted(c, DIAMETER_MM, none if number in stages_of_camera.get(c, ()) else ALL)
            for c in range(4)
        ]
        results.append(measure_stage(Triangulator(RIG), targets))
    return results


def test_an_empty_picture_is_named() -> None:
    said = stage_warnings(totals_of(empty({2: (2,)})), NAMES)
    assert len(said) == 1
    assert said[0].startswith("camera 'cam3': no target at all at 1 of 3 stages (2)")


def test_a_camera_that_never_sees_anything_is_named() -> None:
    said = stage_warnings(totals_of(empty({1: (1, 2, 3)})), NAMES)
    assert len(said) == 1
    assert said[0].startswith("camera 'cam2': no target at all at any of the 3 stages")


def test_full_pictures_are_no_warning() -> None:
    assert stage_warnings(totals_of(empty({})), NAMES) == []


def swapped(pairs):
    """One stage, the pictures of two cameras exchanged."""
    order = [0, 1, 2, 3]
    for a, b in pairs:
        order[a], order[b] = order[b], order[a]
    # Two pairs that share no target, as on opposite sides.
    side = [slice(0, 12), slice(12, 24)]
    targets = [sighted_of(camera, side[camera // 2]) for camera in order]
    return measure_stage(Triangulator(RIG), targets)


def sighted_of(camera: int, points) -> Targets:
    position = np.random.default_rng(6).uniform(-800, 800, (24, 3))[points]
    c = RIG.cameras[NAMES[camera]]
    in_cam = position @ c.rotation.T + c.translation_mm
    codes = np.arange(1, 25, dtype=np.int32)[points]
    return dataclasses.replace(sighted(camera, DIAMETER_MM), centre_px=project(c, in_cam), id=codes)


def test_a_swapped_pair_is_named_though_the_other_is_right() -> None:
    assert stage_warnings(totals_of([swapped([])] * 3), NAMES) == []
    said = stage_warnings(totals_of([swapped([(0, 1)])] * 3), NAMES)
    assert len(said) == 1
    assert "'cam1' (36 of 36), 'cam2' (36 of 36)" in said[0]
    assert "another order" in said[0]


def test_cameras_all_swapped_are_refused() -> None:
    with pytest.raises(MeasurementError, match="of 48 coded targets"):
        refuse_senseless(totals_of([swapped([(0, 1), (2, 3)])]))


def test_stickers_are_taken_off_along_their_normals() -> None:
    # Circles that face each pair, 2 mm over the object.
    def facing(c: int) -> Targets:
        seen = sighted(c, DIAMETER_MM)
        round_axes = np.repeat(seen.semi_axes_px[:, :1], 2, axis=1)
        return dataclasses.replace(seen, semi_axes_px=round_axes, id=CODES + 20 * (c // 2))

    targets = [facing(c) for c in range(4)]
    plain = measure_stage(Triangulator(RIG), targets, diameter_mm=DIAMETER_MM)
    moved = measure_stage(Triangulator(RIG), targets, diameter_mm=DIAMETER_MM, thickness_mm=2.0)
    assert len(moved.points) == len(plain.points) >= 12
    assert moved.without_normal == 0
    step = moved.points.position_mm - plain.points.position_mm
    assert step == pytest.approx(-2 * moved.points.normal, abs=1e-9)
    assert np.isfinite(moved.points.eccentricity_px).all()
    for k, c in enumerate(RIG.cameras.values()):
        mine = moved.points.target[:, k] >= 0
        away = moved.points.position_mm[mine] - c.centre_mm
        assert (np.sum(away * step[mine], axis=1) > 0).all()
    trace = np.trace(moved.points.cov_image_mm2, axis1=1, axis2=2)
    assert (trace > np.trace(plain.points.cov_image_mm2, axis1=1, axis2=2)).all()


def test_what_has_no_ellipse_is_counted() -> None:
    targets = [
        dataclasses.replace(t, cov=np.where(np.eye(5) > 0, t.cov, 0.0)) for t in
        (sighted(c, DIAMETER_MM) for c in range(4))
    ]  # fmt: skip
    for t in targets:
        t.cov[:, 4, 4] = t.cov[:, 3, 3] = np.nan
    result = measure_stage(Triangulator(RIG), targets, diameter_mm=DIAMETER_MM)
    said = stage_warnings(totals_of([result]), NAMES, DIAMETER_MM)
    assert [w for w in said if "12 of 12 positions are not corrected" in w]
    lost = measure_stage(Triangulator(RIG), targets, thickness_mm=1.0)
    assert len(lost.points) == 0
    assert lost.without_normal == 12
