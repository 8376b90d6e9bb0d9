"""The tables of a network: points of any name, their pictures, known distances.

Unlike the tables of a project, whose points are numbered, a network's points bear
any name; a whole number is written without leading zeros and decimals, so that
``7``, ``07`` and ``7.0`` are one point. Lengths mm, pixels with (0, 0) in the centre
of the top-left pixel. Every TableError names file, line, column, value and remedy.
"""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import TableError
from videogrammetry.project.aicon import read_aicon_points
from videogrammetry.project.atomic import atomic_path
from videogrammetry.project.csv_table import CsvTable, read_csv
from videogrammetry.project.photomodeler import read_photomodeler_marks
from videogrammetry.project.tables import (
    OBSERVATION_COLUMNS,
    POINT_COLUMNS,
    POINT_NORMAL,
    POINT_SIGMAS,
    SCALE_BAR_COLUMNS,
    SCALE_BAR_OPTIONAL,
    read_lengths,
)
from videogrammetry.types import FloatArray

_WHOLE = re.compile(r"0*(\d+)(?:\.0*)?")
#: Of a sigma beside its covariance in the ``.npz``: the table's twelve digits.
_SAME_SIGMA = 1e-9


@dataclass(frozen=True, kw_only=True)
class NamedObservations:
    """Image points by names: picture and point of each, (M, 2) px, (M,) sigma or NaN.

    ``point`` is empty for a target of unknown identity; ``residuals``: whose the sigmas
    are, the "measured" points' or, of PhotoModeler's marks, the "corrected" ones'.
    """

    image: tuple[str, ...]
    point: tuple[str, ...]
    xy_px: FloatArray
    sigma_px: FloatArray
    residuals: str = "measured"

    def __len__(self) -> int:
        return len(self.image)


@dataclass(frozen=True, kw_only=True)
class NamedPoints:
    """Object points by name.

    Attributes
    ----------
    position_mm : (N, 3); a row is NaN where no start value is given.
    sigma_mm : (N, 3), NaN where none is given; 0: the coordinates are exact.
    full_cov_mm2 : (3K, 3K) of the K points with a positive sigma, in their order,
        where the ``.npz`` beside the table holds one.
    cov6_mm2 : (N, 6) in the order xx, xy, xz, yy, yz, zz from that file, or None.
    normal : (N, 3) unit normals, diameter_mm : (N,), NaN where unknown.
    """

    name: tuple[str, ...]
    position_mm: FloatArray
    sigma_mm: FloatArray
    full_cov_mm2: FloatArray | None = None
    cov6_mm2: FloatArray | None = None
    normal: FloatArray
    diameter_mm: FloatArray

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True, kw_only=True)
class NamedScaleBar:
    """A known distance, brought to the temperature at which it was used.

    ``calibrated_mm`` is the certificate's.
    """

    point_a: str
    point_b: str
    length_mm: float
    sigma_mm: float
    calibrated_mm: float
    certificate: str = ""


def point_name(text: str) -> str:
    """The name of a point as tables compare it.

    Examples
    --------
    >>> point_name(" 007"), point_name("12.0"), point_name("P07")
    ('7', '12', 'P07')
    """
    text = text.strip()
    whole = _WHOLE.fullmatch(text)
    return whole[1] if whole else text


def read_network_observations(path: str | os.PathLike[str]) -> NamedObservations:
    """Reads image points: an observations CSV, or PhotoModeler's text export.

    Which of both it is, the file's first line says; see
    :func:`~videogrammetry.project.photomodeler.read_photomodeler_marks`.

    Raises
    ------
    TableError
        Among other things where a point stands twice in one picture.
    """
    file = Path(path)
    marks = read_photomodeler_marks(file)
    if marks is not None:
        return NamedObservations(
            image=marks.image,
            point=tuple(map(point_name, marks.point)),
            xy_px=marks.xy_px,
            sigma_px=marks.sigma_px,
            residuals="corrected",
        )
    if file.is_file() and file.suffix.lower() not in (".csv", ".txt", ""):
        raise TableError(
            f"{file}: {file.suffix} is no known kind of observations; expected a CSV table "
            f"{','.join(OBSERVATION_COLUMNS)}[,sigma_px], or PhotoModeler's text export (.txt)"
        )
    table = read_csv(file, OBSERVATION_COLUMNS, ("sigma_px",))
    for row, image in enumerate(table.texts("image")):
        if not image:
            raise table.error(row, "image", "is empty: name the picture")
    _canonical(table, "point")
    table.refuse_repeats(["image", "point"], "observation", unless_empty="point")
    return NamedObservations(
        image=tuple(table.texts("image")),
        point=tuple(table.texts("point")),
        xy_px=np.stack([table.floats("x_px"), table.floats("y_px")], axis=1),
        sigma_px=_optional(table, "sigma_px", "a positive sigma", _positive),
    )


def read_network_points(path: str | os.PathLike[str]) -> NamedPoints:
    """Reads object points: a points CSV, or AICON's ``.obc``.

    A point without coordinates has no start value; one without sigmas is free.
    Covariances come from the ``.npz`` beside the table if that is there: ``id`` and
    ``full_cov_mm2`` (3N, 3N), or ``cov_mm2`` (N, 6) of the single points.
    """
    file = Path(path)
    if file.suffix.lower() == ".obc":
        aicon = read_aicon_points(file)
        n = len(aicon.name)
        return NamedPoints(
            name=tuple(map(point_name, aicon.name)),
            position_mm=aicon.position_mm,
            sigma_mm=aicon.sigma_mm,
            normal=np.full((n, 3), np.nan),
            diameter_mm=np.full(n, np.nan),
        )
    table = read_csv(file, POINT_COLUMNS, (*POINT_SIGMAS, *POINT_NORMAL, "diameter_mm"))
    _canonical(table, "id")
    for row, name in enumerate(table.texts("id")):
        if not name:
            raise table.error(row, "id", "is empty: name the point")
    table.refuse_repeats(["id"], "point")
    sigma_mm = _three(table, POINT_SIGMAS, "all three sigmas, or none", _not_negative)
    normal = _three(table, POINT_NORMAL, "nx, ny and nz, or none of them")
    length = np.linalg.norm(normal, axis=1)
    for zero in np.flatnonzero(length == 0):
        raise table.error(int(zero), "nx", "the normal is zero: give its direction, or nothing")
    names = tuple(table.texts("id"))
    full, cov6 = _covariances(file.with_suffix(".npz"), names, sigma_mm)
    return NamedPoints(
        name=names,
        position_mm=_three(table, POINT_COLUMNS[1:], "all three coordinates, or none"),
        sigma_mm=sigma_mm,
        full_cov_mm2=full,
        cov6_mm2=cov6,
        normal=normal / length[:, None],
        diameter_mm=_optional(table, "diameter_mm", "a positive length", _positive),
    )


def read_network_scale_bars(path: str | os.PathLike[str]) -> tuple[NamedScaleBar, ...]:
    """Reads known distances; the length is that at the temperature of the pictures.

    See :meth:`~videogrammetry.project.tables.CalibratedLength.used_length_mm`.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "bars.csv"
    >>> header = "point_a,point_b,length_mm,sigma_mm,alpha_per_K,temperature_C"
    >>> _ = path.write_text(header + "\\n1,2,1000,0.01,1e-5,25\\n")
    >>> round(read_network_scale_bars(path)[0].length_mm, 6)
    1000.05
    """
    table = read_csv(path, SCALE_BAR_COLUMNS, SCALE_BAR_OPTIONAL)
    for column in ("point_a", "point_b"):
        _canonical(table, column)
    bars = []
    for row, length in enumerate(read_lengths(table)):
        ends = [table.texts(column)[row] for column in ("point_a", "point_b")]
        for column, end in zip(("point_a", "point_b"), ends, strict=True):
            if not end:
                raise table.error(row, column, "is empty: name the point")
        if ends[0] == ends[1]:
            raise table.error(row, "point_b", "both ends are the same point: correct one")
        bars.append(
            NamedScaleBar(
                point_a=ends[0],
                point_b=ends[1],
                length_mm=length.used_length_mm(),
                sigma_mm=length.sigma_mm,
                calibrated_mm=length.length_mm,
                certificate=length.certificate,
            )
        )
    return tuple(bars)


def _positive(value: float) -> bool:
    return value > 0


def _not_negative(value: float) -> bool:
    return value >= 0


def _canonical(table: CsvTable, column: str) -> None:
    table.columns[column] = [point_name(text) for text in table.texts(column)]


def _optional(
    table: CsvTable, column: str, expected: str, check: Callable[[float], bool] | None = None
) -> FloatArray:
    if column not in table:
        return np.full(len(table), np.nan)
    return table.floats(column, empty=np.nan, check=check, expected=expected)


def _three(
    table: CsvTable,
    columns: Sequence[str],
    wanted: str,
    check: Callable[[float], bool] | None = None,
) -> FloatArray:
    """Three columns, each row whole or empty."""
    there = [name for name in columns if name in table]
    if there and len(there) < 3:
        missing = next(name for name in columns if name not in table)
        raise TableError(
            f"{table.path}, line 1: column {missing} is missing beside {', '.join(there)}: "
            f"give all of {', '.join(columns)}, or none"
        )
    expected = "a sigma of 0 or more" if check is not None else "a number"
    values = np.stack([_optional(table, name, expected, check) for name in columns], axis=1)
    count = np.isnan(values).sum(axis=1)
    for row in np.flatnonzero((count > 0) & (count < 3)):
        column = next(c for c in columns if not table.texts(c)[row])
        raise table.error(int(row), column, f"is empty: give {wanted}")
    if check is not None:
        zero = (values == 0).sum(axis=1)
        for row in np.flatnonzero((zero > 0) & (zero < 3)):
            raise table.error(
                int(row), columns[0], "some of the three sigmas are 0 and others not: a point is "
                "exact in all coordinates (all three 0), or give them a small sigma",
            )  # fmt: skip
    return values


def _covariances(
    path: Path, names: tuple[str, ...], sigma_mm: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """full_cov_mm2 of the weighted points and cov_mm2 of all from the ``.npz``, or None."""
    weighted = np.flatnonzero(np.nan_to_num(sigma_mm).all(axis=1))
    if not path.is_file() or not len(weighted):
        return None, None
    remedy = "write the points again, or delete this file to go on with the table's sigmas"
    try:
        with np.load(path, allow_pickle=False) as arrays:
            stored: dict[str, npt.NDArray[np.generic]] = {n: arrays[n] for n in arrays.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise TableError(f"{path}: damaged ({error}); {remedy}") from error
    if "id" not in stored or not {"cov_mm2", "full_cov_mm2"} & set(stored):
        return None, None
    ids = tuple(point_name(str(i)) for i in stored["id"].ravel())
    n = len(names)
    full = stored.get("full_cov_mm2")
    cov6 = stored.get("cov_mm2")
    if full is not None:
        full = np.asarray(full, dtype=float)
        good = full.shape == (3 * n, 3 * n)
        variance = np.diag(full).reshape(n, 3) if good else None
    else:
        cov6 = np.asarray(cov6, dtype=float)
        good = cov6.shape == (n, 6)
        variance = cov6[:, [0, 3, 5]] if good else None
    if (
        ids != names
        or variance is None
        or not np.allclose(variance[weighted], sigma_mm[weighted] ** 2, rtol=_SAME_SIGMA, atol=0)
    ):
        raise TableError(
            f"{path}: covariances of other points than those of the table beside it; "
            "delete the one that is out of date"
        )
    if full is None:
        return None, np.asarray(cov6, dtype=float)
    rows = (3 * weighted[:, None] + np.arange(3)).ravel()
    return np.asarray(full[np.ix_(rows, rows)]), None


def write_point_covariance(
    path: str | os.PathLike[str], names: Sequence[str], full_cov_mm2: FloatArray
) -> None:
    """Writes the ``.npz`` beside a points CSV: the full covariance (3N, 3N) of its points.

    ``id`` holds whole numbers where all names are, so that the tables of a project
    read it too; ``cov_mm2`` (N, 6) is each point's own part, xx, xy, xz, yy, yz, zz.
    """
    n = len(names)
    blocks = full_cov_mm2.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :]
    ids = np.array([int(name) for name in names]) if _numbers(names) else np.array(list(names))
    with atomic_path(path) as beside:
        np.savez_compressed(
            beside,
            id=ids,
            cov_mm2=blocks[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)],
            full_cov_mm2=full_cov_mm2,
            order="xx,xy,xz,yy,yz,zz",
        )


def _numbers(names: Sequence[str]) -> bool:
    return all(name.isascii() and name.isdigit() and int(name) < 2**31 for name in names)
