"""The tables of a network: points of any name, PhotoModeler's marks, AICON's points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from videogrammetry.errors import TableError
from videogrammetry.project import read_points
from videogrammetry.project.network_tables import (
    read_network_observations,
    read_network_points,
    read_network_scale_bars,
    write_point_covariance,
)
from videogrammetry.project.photomodeler import read_photomodeler_marks

EXPORT = """\
A project
 0.000500 20 2272 1704
 1.0 0.1 10 100 100 100 20 20 20
 7.4653 3.6173 2.6128 7.25319 5.43764 0.00498 -0.0001 0 -0.00006 -0.00004
 0 0.00725 0.00544 0.5 0.5 0.001 0.0001 0.0001 0.001 0.001
   0 C:\\pictures\\P1.JPG
   0 0.455 1.794 1.468 -179.839 -1.181 -39.420
   0 0.0002 0.0002 0.0002 0.0029 0.0080 0.0090

   0 7.465 3.617 2.613 7.25319 5.43764 0.00498 -0.0001 0 -0.00006 -0.00004
   0 0 0.00725 0.00544 0.5 0.5 0.001 0.0001 0.0001 0.001 0.001
   1 data/dbat/P 2.JPG
   1 0.455 1.794 1.468 -179.839 -1.181 -39.420
   1 0.0002 0.0002 0.0002 0.0029 0.0080 0.0090

   1 7.465 3.617 2.613 7.25319 5.43764 0.00498 -0.0001 0 -0.00006 -0.00004
   1 0 0.00725 0.00544 0.5 0.5 0.001 0.0001 0.0001 0.001 0.001


    2 0.28573 1.14303 -0.00098 0.000042 0.000041 0.000072
 1001 0 1 0 0 0 0

 0 2 10.5 20.25 0.1 0.1
 0 1001 100.5 200.5 0.3 0.4
 1 2 11.5 21.5 0 0

 1 1 2
 2 1 3
"""


def csv(folder: Path, text: str, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_observations_of_any_name(tmp_path: Path) -> None:
    text = "image,point,x_px,y_px,sigma_px\na,7,1,2,0.1\na,P 7,3,4,\nb,07.0,5,6,0.2\nb,,7,8,\n"
    seen = read_network_observations(csv(tmp_path, text))
    assert seen.image == ("a", "a", "b", "b")
    assert seen.point == ("7", "P 7", "7", "")
    np.testing.assert_array_equal(seen.sigma_px, [0.1, np.nan, 0.2, np.nan])
    np.testing.assert_array_equal(seen.xy_px, [[1, 2], [3, 4], [5, 6], [7, 8]])


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("image,point,x_px,y_px\na,1,1,1\na,01,2,2\n", 3, "stands twice, first on line 2"),
        ("image,point,x_px,y_px\na,1,nan,1\n", 2, "not a finite number"),
        ("image,point,x_px,y_px\n,1,1,1\n", 2, "name the picture"),
        ("image,point,x_px,y_px,sigma_px\na,1,1,1,0\n", 2, "positive sigma"),
        ("image,point,x_px\na,1,1\n", 1, "column y_px is missing"),
    ],
)
def test_wrong_observations(tmp_path: Path, text: str, line: int, message: str) -> None:
    with pytest.raises(TableError, match=f"line {line}") as error:
        read_network_observations(csv(tmp_path, text))
    assert message in str(error.value)


def test_another_kind_of_observations(tmp_path: Path) -> None:
    with pytest.raises(TableError, match="no known kind of observations"):
        read_network_observations(csv(tmp_path, "<xml/>", "marks.xml"))


def test_photomodeler(tmp_path: Path) -> None:
    """Corner origin to centre; picture and point by name; sigma the RMS of both, 0: none."""
    seen = read_network_observations(csv(tmp_path, EXPORT, "export.txt"))
    assert seen.image == ("P1.JPG", "P1.JPG", "P 2.JPG")
    assert seen.point == ("2", "1001", "2")
    np.testing.assert_array_equal(seen.xy_px, [[10, 19.75], [100, 200], [11, 21]])
    np.testing.assert_allclose(seen.sigma_px, [0.1, np.sqrt(0.125), np.nan])


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        (" 1 2 11.5 21.5 0 0", " 5 2 11.5 21.5 0 0", 25, "picture 5, which the export"),
        (" 1 2 11.5 21.5 0 0", " 0 2 11.5 21.5 0 0", 25, "first on line 23"),
        (" 1 2 11.5 21.5 0 0", " 1 2 11.5 x 0 0", 25, "is no mark"),
    ],
)
def test_wrong_marks(tmp_path: Path, old: str, new: str, line: int, message: str) -> None:
    with pytest.raises(TableError, match=f"line {line}") as error:
        read_network_observations(csv(tmp_path, EXPORT.replace(old, new), "export.txt"))
    assert message in str(error.value)


def test_a_table_is_no_export(tmp_path: Path) -> None:
    assert read_photomodeler_marks(csv(tmp_path, "image,point,x_px,y_px\n", "a.txt")) is None
    assert read_photomodeler_marks(tmp_path / "missing.txt") is None


@pytest.mark.data
def test_camcal_export(data: Path) -> None:
    """README: 21 photographs, 2074 marks; DBAT's report: 0.1 px."""
    seen = read_network_observations(data / "camcal" / "camcal-pmexport.txt")
    assert (len(seen), len(set(seen.image)), len(set(seen.point))) == (2074, 21, 100)
    assert np.all(seen.sigma_px == 0.1)
    assert "P8250021.JPG" in seen.image


def test_points_and_their_sigmas(tmp_path: Path) -> None:
    text = (
        "id,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,nx,ny,nz,diameter_mm\n"
        "1,1,2,3,0.1,0.2,0.3,0,0,2,10\nA,4,5,6,,,,,,,\nB,,,,,,,,,,\nC,7,8,9,0,0,0,,,,\n"
    )
    points = read_network_points(csv(tmp_path, text))
    assert points.name == ("1", "A", "B", "C")
    np.testing.assert_array_equal(points.position_mm[:2], [[1, 2, 3], [4, 5, 6]])
    assert np.isnan(points.position_mm[2]).all()
    assert points.sigma_mm[0].tolist() == [0.1, 0.2, 0.3]
    assert np.isnan(points.sigma_mm[1:3]).all()
    assert points.sigma_mm[3].tolist() == [0, 0, 0]
    assert points.normal[0].tolist() == [0, 0, 1]
    assert points.diameter_mm[0] == 10
    assert np.isnan(points.diameter_mm[1:]).all()
    assert points.full_cov_mm2 is None


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,1,2,,,,", "all three coordinates, or none"),
        ("1,1,2,3,0.1,0.1,", "all three sigmas, or none"),
        ("1,1,2,3,0,0.1,0.1", "exact in all coordinates"),
        ("1,1,2,3,-1,0.1,0.1", "sigma of 0 or more"),
        (",1,2,3,,,", "name the point"),
        ("01,1,2,3,,,\n1,1,2,3,,,", "stands twice"),
    ],
)
def test_wrong_points(tmp_path: Path, row: str, message: str) -> None:
    header = "id,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm\n"
    with pytest.raises(TableError, match=message):
        read_network_points(csv(tmp_path, header + row + "\n"))


def covariance(count: int) -> np.ndarray:
    """A covariance of all coordinates, regular, with correlations."""
    a = np.random.default_rng(5).normal(size=(3 * count, 3 * count))
    return 1e-4 * (a @ a.T + np.eye(3 * count))


@pytest.mark.parametrize("names", [("1", "2", "12"), ("1", "A", "B")])
def test_full_covariance_goes_round(tmp_path: Path, names: tuple[str, ...]) -> None:
    """Written beside a table and read again, whole; a project's reader takes numbers' blocks."""
    cov = covariance(3)
    sigma = np.sqrt(np.diag(cov)).reshape(3, 3)
    rows = [
        ",".join([n, "1", "2", "3", *(repr(float(s)) for s in row)])
        for n, row in zip(names, sigma, strict=True)
    ]
    header = "id,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm\n"
    path = csv(tmp_path, header + "\n".join(rows) + "\n", "points.csv")
    write_point_covariance(tmp_path / "points.npz", names, cov)
    points = read_network_points(path)
    np.testing.assert_array_equal(points.full_cov_mm2, cov)
    if names[1] == "2":
        blocks = read_points(path).cov_mm2
        assert blocks is not None
        np.testing.assert_allclose(blocks[1], cov[3:6, 3:6][np.triu_indices(3)])


def test_covariance_of_other_points(tmp_path: Path) -> None:
    header = "id,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm\n"
    path = csv(tmp_path, header + "1,1,2,3,0.1,0.1,0.1\n", "points.csv")
    write_point_covariance(tmp_path / "points.npz", ("2",), 0.01 * np.eye(3))
    with pytest.raises(TableError, match="covariances of other points"):
        read_network_points(path)
    (tmp_path / "points.npz").write_bytes(b"PK damaged")
    with pytest.raises(TableError, match="damaged"):
        read_network_points(path)


OBC = """\
Object coordinates of project panel
# id x y z sx sy sz rays
1   12.5  -3.25  1e2   0.01 0.02 0.03  12
1001; 1.0; 2.0; 3.0
A7\t4\t5\t6\t0\t0\t0
"""


def test_aicon_points(tmp_path: Path) -> None:
    points = read_network_points(csv(tmp_path, OBC, "panel.obc"))
    assert points.name == ("1", "1001", "A7")
    np.testing.assert_array_equal(points.position_mm, [[12.5, -3.25, 100], [1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(points.sigma_mm[0], [0.01, 0.02, 0.03])
    assert np.isnan(points.sigma_mm[1:]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a heading\n", "no point in this table"),
        ("1 2 3 4\nrubbish\n", "line 2: 'rubbish' is no point"),
        ("1 2 3 4\n1 2 3 4\n", "line 2: point 1 stands twice, first on line 1"),
    ],
)
def test_wrong_aicon_points(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(TableError, match=message):
        read_network_points(csv(tmp_path, text, "panel.obc"))


BARS = "point_a,point_b,length_mm,sigma_mm,alpha_per_K,temperature_C,reference_C,certificate\n"


def test_scale_bars_at_their_temperature(tmp_path: Path) -> None:
    """L = L0 (1 + alpha (T - Tref)); without a reference, 20 C."""
    text = BARS + "1,A,1000,0.01,1.2e-5,25,20,K-1\n1,2,500,0.01,1e-5,30,,\n2,3,200,0.02,1e-5,,,\n"
    bars = read_network_scale_bars(csv(tmp_path, text))
    assert [bar.length_mm for bar in bars] == pytest.approx([1000.06, 500.05, 200.0], rel=1e-14)
    assert (bars[0].point_a, bars[0].point_b, bars[0].certificate) == ("1", "A", "K-1")
    assert bars[0].calibrated_mm == 1000


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,01,1000,0.01,,,,", "both ends are the same point"),
        ("1,2,-1,0.01,,,,", "positive length"),
        ("1,2,1000,0.01,11.5,20,20,", "not per million"),
        ("1,2,1000,0.01,,25,20,", "without alpha_per_K"),
        (",2,1000,0.01,,,,", "name the point"),
    ],
)
def test_wrong_scale_bars(tmp_path: Path, row: str, message: str) -> None:
    with pytest.raises(TableError, match=message) as error:
        read_network_scale_bars(csv(tmp_path, BARS + row + "\n"))
    assert "line 2" in str(error.value)
