"""CSV tables: exact round trips, and one clear sentence about each kind of damage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.errors import TableError
from videogrammetry.pipeline.calibrate import known_lengths
from videogrammetry.project import (
    MotionTable,
    ScaleBar,
    TrajectoryTable,
    format_motion,
    format_targets,
    format_trajectories,
    read_motion,
    read_observations,
    read_points,
    read_scale_bars,
    read_targets,
    read_trajectories,
    target_table,
    write_observations,
    write_points,
    write_scale_bars,
    write_text,
)
from videogrammetry.project.network_tables import read_network_scale_bars
from videogrammetry.types import Observations, PointSet, Targets

RNG = np.random.default_rng(11)
# The writer keeps 12 significant digits: half a unit of the last one is 5e-12 relative.
RTOL = 5e-12


def write(folder: Path, text: str, name: str = "points.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def test_points_round_trip(tmp_path: Path) -> None:
    root = RNG.normal(size=(4, 3, 3))
    cov = root @ root.transpose(0, 2, 1)
    normal = RNG.normal(size=(4, 3))
    points = PointSet(
        id=np.array([5, 1, 99, 1001], dtype=np.int32),
        position_mm=RNG.normal(size=(4, 3)) * 1e3,
        cov_mm2=cov[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]],
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        diameter_mm=np.array([10.0, np.nan, 5.0, 5.0]),
    )
    write_points(tmp_path / "p.csv", points)
    back = read_points(tmp_path / "p.csv")
    np.testing.assert_array_equal(back.id, points.id)
    np.testing.assert_allclose(back.position_mm, points.position_mm, rtol=RTOL)
    np.testing.assert_array_equal(back.cov_mm2, points.cov_mm2)  # from the .npz: exact
    np.testing.assert_allclose(back.normal, points.normal, rtol=4 * RTOL)
    np.testing.assert_array_equal(back.diameter_mm, points.diameter_mm)
    # A table that has changed must not keep the old covariances.
    text = (tmp_path / "p.csv").read_text().replace("\n99,", "\n98,", 1)
    write_text(tmp_path / "p.csv", text)
    with pytest.raises(TableError, match=r"p\.npz: covariances of other points"):
        read_points(tmp_path / "p.csv")


def test_points_tolerate_bom_crlf_blank_lines_and_any_order(tmp_path: Path) -> None:
    text = "\ufeffz_mm, id,x_mm,y_mm\r\n3,7,1,2\r\n\r\n6, 8 ,4,5\r\n\r\n"
    points = read_points(write(tmp_path, text))
    assert points.id.tolist() == [7, 8]
    assert points.position_mm.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert points.cov_mm2 is None
    assert points.normal is None


HEAD = "id,x_mm,y_mm,z_mm\n"
SIGMA = "id,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm\n"
NORMAL = "id,x_mm,y_mm,z_mm,nx,ny,nz\n"
BAD_POINTS = [
    (HEAD + "1,0,0,0\n2,1,1,1\n1,2,2,2\n", ["line 4", "id", "1", "twice", "line 2"]),
    (HEAD + "1,0,0,0\n01,1,1,1\n", ["twice"]),
    (HEAD + "1,0,0,0\n2,1.5,2x.1,1\n", ["line 3", "y_mm", "'2x.1'", "number"]),
    (HEAD + "1,0,0,O\n", ["line 2", "z_mm", "'O'"]),
    (HEAD + "1,nan,0,0\n", ["line 2", "x_mm", "nan"]),
    (HEAD + "1,inf,0,0\n", ["line 2", "x_mm", "inf"]),
    (HEAD + "1,1_0,0,0\n", ["line 2", "x_mm", "1_0"]),
    (HEAD + "1,,0,0\n", ["line 2", "x_mm", "empty"]),
    (HEAD + '1,"1,5",0,0\n', ["line 2", "x_mm", "decimal point"]),
    (HEAD + "1,0,0\n", ["line 2", "3 cells", "4"]),
    (HEAD + "1,0,0,0,9\n", ["line 2", "5 cells"]),
    (HEAD + "a7,0,0,0\n", ["line 2", "id", "'a7'"]),
    (HEAD + "-3,0,0,0\n", ["line 2", "id", "-3"]),
    (HEAD + "1.0,0,0,0\n", ["line 2", "id", "'1.0'"]),
    (HEAD + "99999999999,0,0,0\n", ["line 2", "id", "out of range"]),
    ("id,x_mm,y_mm\n1,0,0\n", ["line 1", "z_mm", "missing"]),
    ("id;x_mm;y_mm;z_mm\n1;0;0;0\n", ["line 1", "commas"]),
    ("id,x_mm,y_mm,z_mm,colour\n1,0,0,0,red\n", ["line 1", "colour", "not known"]),
    ("id,x_mm,y_mm,z_mm,x_mm\n1,0,0,0,1\n", ["line 1", "x_mm", "twice"]),
    ("", ["empty", "id,x_mm,y_mm,z_mm"]),
    ("\n\n", ["empty"]),
    (HEAD, ["no row"]),
    ("id,x_mm,y_mm,z_mm,sigma_x_mm\n1,0,0,0,1\n", ["sigma_y_mm", "missing"]),
    (SIGMA + "1,0,0,0,1,1,1\n2,0,0,0,1,,1\n", ["line 3", "sigma_y_mm", "empty"]),
    (SIGMA + "1,0,0,0,1,0,1\n", ["line 2", "sigma_y_mm", "positive"]),
    (NORMAL + "1,0,0,0,0,0,0\n", ["line 2", "nx", "zero"]),
    (NORMAL + "1,0,0,0,1,,0\n", ["line 2", "nx", "whole"]),
    (HEAD + '1,"0,0,0\n', ["CSV"]),
]


@pytest.mark.parametrize(("text", "words"), BAD_POINTS)
def test_bad_points_are_named(tmp_path: Path, text: str, words: list[str]) -> None:
    path = write(tmp_path, text)
    with pytest.raises(TableError) as caught:
        read_points(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


def test_missing_and_binary_tables(tmp_path: Path) -> None:
    with pytest.raises(TableError, match="no such table"):
        read_points(tmp_path / "nothere.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(TableError, match="UTF-8"):
        read_points(tmp_path / "b.csv")


def test_observations_round_trip(tmp_path: Path) -> None:
    observations = Observations(
        image=("p1", "p2"),
        image_index=np.array([0, 0, 1], dtype=np.int32),
        point_id=np.array([4, -1, 4], dtype=np.int32),
        xy_px=RNG.uniform(0, 1000, (3, 2)),
        cov_px2=np.array([[1e-4, 0, 1e-4]] * 3),
    )
    write_observations(tmp_path / "o.csv", observations)
    back = read_observations(tmp_path / "o.csv")
    assert back.image == observations.image
    np.testing.assert_array_equal(back.image_index, observations.image_index)
    np.testing.assert_array_equal(back.point_id, observations.point_id)
    np.testing.assert_allclose(back.xy_px, observations.xy_px, rtol=RTOL)
    np.testing.assert_allclose(back.cov_px2, observations.cov_px2, rtol=4 * RTOL)


def test_observations_without_sigma_and_with_a_repeat(tmp_path: Path) -> None:
    text = "image,point,x_px,y_px\na,1,1,2\na,2,3,4\n"
    path = write(tmp_path, text)
    assert read_observations(path, 0.1).cov_px2[0].tolist() == pytest.approx([0.01, 0, 0.01])
    write(tmp_path, text + "a,1,5,6\n")
    with pytest.raises(TableError, match="line 4, column point: observation a 1 stands twice"):
        read_observations(path)
    write(tmp_path, text + ",1,5,6\n")
    with pytest.raises(TableError, match="line 4, column image: is empty"):
        read_observations(path)


def test_scale_bars_round_trip(tmp_path: Path) -> None:
    bars = [
        ScaleBar(point_a=1, point_b=2, length_mm=1100.057, sigma_mm=0.005),
        ScaleBar(
            point_a=3,
            point_b=4,
            length_mm=500.0,
            sigma_mm=0.01,
            alpha_per_K=1.2e-6,
            temperature_C=23.5,
            reference_C=20.0,
            certificate="A, 12",
        ),
    ]
    write_scale_bars(tmp_path / "b.csv", bars)
    assert read_scale_bars(tmp_path / "b.csv") == bars
    path = write(tmp_path, "point_a,point_b,length_mm,sigma_mm\n1,1,100,0.1\n")
    with pytest.raises(TableError, match="line 2, column point_b: both ends"):
        read_scale_bars(path)


@pytest.mark.parametrize(
    ("alpha", "used", "reference", "length"),
    [
        (None, None, None, 1000.0),
        (1.2e-5, 25.0, 20.0, 1000.06),
        (1.2e-5, 25.0, 22.0, 1000.036),
        (1.2e-5, 25.0, None, 1000.06),  # a certificate's 20 C
        (1.2e-5, 20.0, None, 1000.0),
        (-1e-6, 30.0, 20.0, 999.99),  # carbon fibre shrinks
        (1.2e-5, None, 20.0, 1000.0),
        (None, 25.0, None, 1000.0),
        (0.0, 25.0, 20.0, 1000.0),
    ],
)
def test_a_bar_at_the_temperature_of_its_use(tmp_path, alpha, used, reference, length) -> None:
    """The same of the method and of both kinds of tables."""
    bar = ScaleBar(
        point_a=1, point_b=2, length_mm=1000.0, sigma_mm=0.01,
        alpha_per_K=alpha, temperature_C=used, reference_C=reference,
    )  # fmt: skip
    assert bar.used_length_mm() == pytest.approx(length, rel=1e-15)
    write_scale_bars(tmp_path / "b.csv", [bar])
    assert read_scale_bars(tmp_path / "b.csv")[0].used_length_mm() == bar.used_length_mm()
    assert read_network_scale_bars(tmp_path / "b.csv")[0].length_mm == bar.used_length_mm()
    assert known_lengths(tmp_path / "b.csv")[0].length_mm == bar.used_length_mm()


@pytest.mark.parametrize(
    ("row", "message"),
    [("1,2,1000,0.01,11.5,20,20,", "not per million"), ("1,2,1000,0.01,,25,20,", "without alpha")],
)
def test_temperatures_that_cannot_be_used(tmp_path: Path, row: str, message: str) -> None:
    header = "point_a,point_b,length_mm,sigma_mm,alpha_per_K,temperature_C,reference_C,certificate"
    with pytest.raises(TableError, match=message):
        read_scale_bars(write(tmp_path, f"{header}\n{row}\n"))


def some_targets(ids: list[int]) -> Targets:
    n = len(ids)
    return Targets(
        centre_px=RNG.uniform(0, 1000, (n, 2)),
        semi_axes_px=RNG.uniform(5, 10, (n, 2)),
        angle_rad=RNG.uniform(0, 3, n),
        id=np.array(ids, dtype=np.int32),
        cov=np.tile(np.eye(5) * 1e-4, (n, 1, 1)),
        edge_rms_px=np.full(n, 0.1),
        contrast=np.full(n, 100.0),
        ring_status=np.zeros(n, np.uint8),
    )


def test_targets_round_trip(tmp_path: Path) -> None:
    first, second = some_targets([4, -1, -1]), some_targets([4])
    pictures = [
        ("a", "", None, first),
        ("b", "left", 2, second),
        ("c", "", None, some_targets([])),
    ]
    text = format_targets(target_table(pictures))
    assert text.splitlines()[1].startswith("a,,,4,")
    assert text.splitlines()[2].startswith("a,,,,")
    back = read_targets(write(tmp_path, text))
    assert back.image == ("a", "a", "a", "b")
    assert back.stage.tolist() == [0, 0, 0, 2]
    assert back.id.tolist() == [4, -1, -1, 4]
    np.testing.assert_allclose(back.xy_px[:3], first.centre_px, rtol=RTOL)
    np.testing.assert_allclose(back.sigma_px, 0.01, rtol=RTOL)
    write(tmp_path, text + text.splitlines()[1] + "\n")
    with pytest.raises(TableError, match=r"line 6, column id: target a .*4 stands twice"):
        read_targets(tmp_path / "points.csv")


def test_the_confidence_of_ids_is_an_optional_column(tmp_path: Path) -> None:
    targets = some_targets([4, -1])
    assert np.isnan(targets.id_confidence).all()  # where nothing is known of it
    sure = replace(targets, id_confidence=np.array([0.99975, np.nan]))
    table = target_table([("a", "", None, sure)])
    text = format_targets(table)
    assert [line.rsplit(",", 1)[1] for line in text.splitlines()] == [
        "id_confidence",
        "0.99975",
        "",
    ]
    back = read_targets(write(tmp_path, text))
    assert back.id_confidence is not None
    np.testing.assert_array_equal(back.id_confidence, sure.id_confidence)
    without = format_targets(replace(table, id_confidence=None))
    assert "id_confidence" not in without
    assert read_targets(write(tmp_path, without)).id_confidence is None
    write(tmp_path, text.replace("0.99975", "1.5"))
    with pytest.raises(TableError, match=r"id_confidence: 1\.5 is out of range"):
        read_targets(tmp_path / "points.csv")


def test_an_empty_target_table_has_its_header() -> None:
    assert format_targets(target_table([])).startswith("image,camera,stage,id,x_px")


def test_results_round_trip(tmp_path: Path) -> None:
    three = RNG.normal(size=(3, 3))
    trajectories = TrajectoryTable(
        stage=np.array([1, 1, 2], dtype=np.int32),
        time_s=np.array([0.0, 0.0, 0.002]),
        point=("7", "wing tip", "7"),
        position_mm=three,
        sigma_mm=np.abs(three),
        cameras=(("left", "right"), ("left",), ()),
    )
    back = read_trajectories(write(tmp_path, format_trajectories(trajectories)))
    assert (back.point, back.cameras) == (trajectories.point, trajectories.cameras)
    np.testing.assert_allclose(back.position_mm, three, rtol=RTOL)
    velocity = three.copy()
    velocity[0] = np.nan
    motion = MotionTable(
        stage=trajectories.stage,
        time_s=np.full(3, np.nan),
        point=("7", "centroid", "7"),
        displacement_mm=three,
        velocity_mm_s=velocity,
        sigma_displacement_mm=np.abs(three),
        sigma_velocity_mm_s=np.abs(velocity),
    )
    moved = read_motion(write(tmp_path, format_motion(motion)))
    assert moved.point == motion.point
    np.testing.assert_allclose(moved.velocity_mm_s, velocity, rtol=RTOL)
    with pytest.raises(ValueError, match="equal lengths"):
        TrajectoryTable(**{**vars(trajectories), "point": ("7",)})
