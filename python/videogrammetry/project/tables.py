"""The CSV tables that users give and get: points, observations, scale bars, targets.

Columns are those of docs/conventions.md; lengths mm, angles rad, pixels with
(0, 0) in the centre of the top-left pixel. Readers are strict (TableError names
file, line, column, value and remedy), writers write all or nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.errors import TableError
from videogrammetry.project.atomic import atomic_path
from videogrammetry.project.csv_table import CsvTable, format_csv, read_csv, write_csv
from videogrammetry.types import FloatArray, IntArray, Observations, PointSet, Targets

POINT_COLUMNS = ("id", "x_mm", "y_mm", "z_mm")
POINT_SIGMAS = ("sigma_x_mm", "sigma_y_mm", "sigma_z_mm")
POINT_NORMAL = ("nx", "ny", "nz")
OBSERVATION_COLUMNS = ("image", "point", "x_px", "y_px")
SCALE_BAR_COLUMNS = ("point_a", "point_b", "length_mm", "sigma_mm")
SCALE_BAR_OPTIONAL = ("alpha_per_K", "temperature_C", "reference_C", "certificate")
TARGET_COLUMNS = (
    *("image", "camera", "stage", "id", "x_px", "y_px", "semi_major_px", "semi_minor_px"),
    *("angle_rad", "sigma_x_px", "sigma_y_px"),
)
TARGET_OPTIONAL = ("id_confidence",)
#: A priori standard deviation of an observation whose table states none.
DEFAULT_SIGMA_PX = 0.05
#: Temperature at which lengths are stated unless something else is said (ISO 1).
ISO_REFERENCE_C = 20.0
#: No solid expands as much per kelvin; what is larger was given per million.
_MOST_ALPHA_PER_K = 1e-3


@dataclass(frozen=True, kw_only=True)
class CalibratedLength:
    """A length as its certificate states it; temperatures in degrees Celsius.

    ``alpha_per_K``: the coefficient of expansion. None = not stated.
    """

    length_mm: float
    sigma_mm: float
    alpha_per_K: float | None = None
    temperature_C: float | None = None
    reference_C: float | None = None
    certificate: str = ""

    def used_length_mm(self) -> float:
        """The length at the temperature at which it was used: L (1 + alpha (T - T0)).

        T0 is ``reference_C``, where that is not stated the 20 C of ISO 1, at which lengths
        are certified. Without alpha or T the length is as stated.

        Examples
        --------
        >>> bar = CalibratedLength(
        ...     length_mm=1000.0, sigma_mm=0.01, alpha_per_K=1e-5, temperature_C=25.0
        ... )
        >>> round(bar.used_length_mm(), 6)
        1000.05
        """
        if self.alpha_per_K is None or self.temperature_C is None:
            return self.length_mm
        reference = ISO_REFERENCE_C if self.reference_C is None else self.reference_C
        return self.length_mm * (1.0 + self.alpha_per_K * (self.temperature_C - reference))


@dataclass(frozen=True, kw_only=True)
class ScaleBar(CalibratedLength):
    """A known distance between two points."""

    point_a: int
    point_b: int


@dataclass(frozen=True, kw_only=True)
class TargetTable:
    """A targets CSV: the targets of many pictures, one row each.

    Attributes
    ----------
    image, camera : (N,) texts; ``camera`` empty where unknown.
    stage : (N,) from 1; 0 = not stated. id : (N,) code number or -1.
    xy_px, semi_axes_px : (N, 2). angle_rad : (N,).
    sigma_px : (N, 2), NaN where not stated.
    id_confidence : (N,) probability that the ID is right, NaN where there is none or it
        is not stated; None: the table does not have the column.
    """

    image: tuple[str, ...]
    camera: tuple[str, ...]
    stage: IntArray
    id: IntArray
    xy_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    sigma_px: FloatArray
    id_confidence: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)


def _positive(value: float) -> bool:
    return value > 0


def _share(value: float) -> bool:
    return 0 <= value <= 1


def read_points(path: str | os.PathLike[str]) -> PointSet:
    """Reads a points CSV; full covariances from the ``.npz`` beside it if that is there.

    Sigma columns are all there or none, and filled for all points or for none.
    Normals and diameters may be empty for single points (NaN).

    Raises
    ------
    TableError
        Among other things for a repeated id, or a letter in a number.
    """
    optional = (*POINT_SIGMAS, *POINT_NORMAL, "diameter_mm")
    table = read_csv(path, POINT_COLUMNS, optional)
    for group in (POINT_SIGMAS, POINT_NORMAL):
        _all_or_none(table, group)
    table.refuse_repeats(["id"], "point")
    ids = table.integers("id")
    if len(np.unique(ids)) < len(ids):  # "7" and "07"
        raise TableError(f"{table.path}: an id stands twice; every point has its own number")
    cov_mm2, full = _cov_of_sigmas(table), None
    if table.has_values(POINT_SIGMAS[0]):
        cov_mm2, full = _full_covariance(Path(path).with_suffix(".npz"), ids, cov_mm2)
    diameters = table.has_values("diameter_mm")
    return PointSet(
        id=ids,
        position_mm=np.stack([table.floats(c) for c in POINT_COLUMNS[1:]], axis=1),
        cov_mm2=cov_mm2,
        normal=_normals(table) if table.has_values("nx") else None,
        diameter_mm=table.floats(
            "diameter_mm", empty=np.nan, check=_positive, expected="a positive length"
        )
        if diameters
        else None,
        full_cov_mm2=full,
    )


def _all_or_none(table: CsvTable, group: Sequence[str]) -> None:
    there = [name for name in group if name in table]
    if there and len(there) < len(group):
        missing = next(name for name in group if name not in table)
        raise TableError(
            f"{table.path}, line 1: column {missing} is missing beside {', '.join(there)}: "
            f"give all of {', '.join(group)}, or none"
        )


def _cov_of_sigmas(table: CsvTable) -> FloatArray | None:
    if not any(table.has_values(name) for name in POINT_SIGMAS):
        return None
    sigmas = [table.floats(c, check=_positive, expected="a positive sigma") for c in POINT_SIGMAS]
    cov = np.zeros((len(table), 6))
    for column, sigma in zip((0, 3, 5), sigmas, strict=True):
        cov[:, column] = sigma**2
    return cov


def _normals(table: CsvTable) -> FloatArray:
    normals = np.stack([table.floats(c, empty=np.nan) for c in POINT_NORMAL], axis=1)
    lengths = np.linalg.norm(normals, axis=1)
    for row in range(len(table)):
        nothing = [c for c in POINT_NORMAL if not table.texts(c)[row]]
        if 0 < len(nothing) < 3 or lengths[row] == 0:
            raise table.error(row, "nx", "the normal is zero or not whole: give nx, ny and nz")
    return np.asarray(normals / lengths[:, None])


def _full_covariance(
    path: Path, ids: IntArray, cov: FloatArray | None
) -> tuple[FloatArray | None, FloatArray | None]:
    """cov_mm2 and full_cov_mm2 of the ``.npz`` beside the table, if it is of these very points."""
    if not path.is_file():
        return cov, None
    try:
        with np.load(path, allow_pickle=False) as arrays:
            if "cov_mm2" not in arrays or "id" not in arrays:
                return cov, None
            full_ids, full = arrays["id"], np.asarray(arrays["cov_mm2"], dtype=float)
            joint = np.asarray(arrays["full_cov_mm2"]) if "full_cov_mm2" in arrays else None
    except (OSError, ValueError, EOFError) as error:
        raise TableError(
            f"{path}: damaged ({error}); write the points again, or delete this file to go on "
            "with the standard deviations of the table beside it"
        ) from error
    same = full.shape == (len(ids), 6) and np.array_equal(full_ids, ids)
    # The table's rounding to 12 digits is all that may differ.
    if (
        not same
        or cov is None
        or not np.allclose(full[:, [0, 3, 5]], cov[:, [0, 3, 5]], rtol=1e-9, atol=0)
    ):
        raise TableError(
            f"{path}: covariances of other points than those of the table beside it; "
            "delete the one that is out of date"
        )
    if joint is not None and joint.shape != (3 * len(ids), 3 * len(ids)):
        raise TableError(
            f"{path}: full_cov_mm2 has the shape {joint.shape}, not {(3 * len(ids),) * 2} of the "
            "table's points; write both again"
        )
    return full, joint


def write_points(path: str | os.PathLike[str], points: PointSet) -> None:
    """Writes a points CSV, and a ``.npz`` beside it if points have correlated coordinates."""
    header, columns = list(POINT_COLUMNS), [points.id, *points.position_mm.T]
    full = Path(path).with_suffix(".npz")
    if points.cov_mm2 is not None:
        header += POINT_SIGMAS
        columns += [np.sqrt(points.cov_mm2[:, i]) for i in (0, 3, 5)]
    if points.normal is not None:
        header += POINT_NORMAL
        columns += [*points.normal.T]
    if points.diameter_mm is not None:
        header.append("diameter_mm")
        columns.append(points.diameter_mm)
    joint = points.full_cov_mm2
    if points.cov_mm2 is not None and (joint is not None or points.cov_mm2[:, [1, 2, 4]].any()):
        arrays: dict[str, Any] = {"id": points.id, "cov_mm2": points.cov_mm2}
        if joint is not None:
            arrays["full_cov_mm2"] = joint
        with atomic_path(full) as beside:
            np.savez(beside, order="xx,xy,xz,yy,yz,zz", **arrays)
    write_csv(path, header, columns)


def read_observations(
    path: str | os.PathLike[str], default_sigma_px: float = DEFAULT_SIGMA_PX
) -> Observations:
    """Reads an observations CSV; an empty ``point`` is -1: not yet identified."""
    table = read_csv(path, OBSERVATION_COLUMNS, ("sigma_px",))
    for row, image in enumerate(table.texts("image")):
        if not image:
            raise table.error(row, "image", "is empty: name the picture")
    table.refuse_repeats(["image", "point"], "observation", unless_empty="point")
    images = tuple(dict.fromkeys(table.texts("image")))
    number = {name: i for i, name in enumerate(images)}
    sigma = np.full(len(table), default_sigma_px)
    if "sigma_px" in table:
        sigma = table.floats(
            "sigma_px", empty=default_sigma_px, check=_positive, expected="a positive sigma"
        )
    return Observations(
        image=images,
        image_index=np.array([number[name] for name in table.texts("image")], dtype=np.int32),
        point_id=table.integers("point", empty=-1),
        xy_px=np.stack([table.floats("x_px"), table.floats("y_px")], axis=1),
        cov_px2=np.stack([sigma**2, np.zeros(len(table)), sigma**2], axis=1),
    )


def write_observations(path: str | os.PathLike[str], observations: Observations) -> None:
    """Writes an observations CSV; ``sigma_px`` is the RMS of the two coordinates' sigmas."""
    cov = observations.cov_px2
    columns = [
        [observations.image[i] for i in observations.image_index],
        [None if i < 0 else int(i) for i in observations.point_id],
        *observations.xy_px.T,
        np.sqrt((cov[:, 0] + cov[:, 2]) / 2),
    ]
    write_csv(path, (*OBSERVATION_COLUMNS, "sigma_px"), columns)


def read_lengths(table: CsvTable) -> list[CalibratedLength]:
    """What every scale-bar table says of its lengths, a row each.

    A temperature and a reference without a coefficient are an error, for they would
    have no effect.
    """
    lengths = table.floats("length_mm", check=_positive, expected="a positive length")
    sigmas = table.floats("sigma_mm", check=_positive, expected="a positive sigma")
    thermal = {
        name: table.floats(name, empty=np.nan) if name in table else np.full(len(table), np.nan)
        for name in SCALE_BAR_OPTIONAL[:3]
    }
    result = []
    for row in range(len(table)):
        given = {k: None if np.isnan(v[row]) else float(v[row]) for k, v in thermal.items()}
        length = CalibratedLength(
            length_mm=float(lengths[row]),
            sigma_mm=float(sigmas[row]),
            certificate=table.texts("certificate")[row] if "certificate" in table else "",
            **given,
        )
        if length.alpha_per_K is not None and not abs(length.alpha_per_K) < _MOST_ALPHA_PER_K:
            raise table.error(
                row, "alpha_per_K", f"{length.alpha_per_K:g} is no coefficient of expansion per "
                "kelvin (steel 1.15e-5, carbon fibre near 0): not per million?",
            )  # fmt: skip
        if length.alpha_per_K is None and None not in (length.temperature_C, length.reference_C):
            raise table.error(
                row, "temperature_C", "is given without alpha_per_K, so that the length cannot be "
                "corrected: give the bar's coefficient of expansion (0 for none)",
            )  # fmt: skip
        result.append(length)
    return result


def read_scale_bars(path: str | os.PathLike[str]) -> list[ScaleBar]:
    """Reads a scale-bar CSV."""
    table = read_csv(path, SCALE_BAR_COLUMNS, SCALE_BAR_OPTIONAL)
    ends = table.integers("point_a"), table.integers("point_b")
    bars = []
    for row, length in enumerate(read_lengths(table)):
        if ends[0][row] == ends[1][row]:
            raise table.error(row, "point_b", "both ends are the same point: correct one")
        bars.append(ScaleBar(point_a=int(ends[0][row]), point_b=int(ends[1][row]), **vars(length)))
    return bars


def write_scale_bars(path: str | os.PathLike[str], bars: Sequence[ScaleBar]) -> None:
    """Writes a scale-bar CSV with all its columns."""
    header = (*SCALE_BAR_COLUMNS, *SCALE_BAR_OPTIONAL)
    write_csv(path, header, [[getattr(bar, name) for bar in bars] for name in header])


def read_targets(path: str | os.PathLike[str]) -> TargetTable:
    """Reads a targets CSV; an ID may stand once in a picture."""
    table = read_csv(path, TARGET_COLUMNS, TARGET_OPTIONAL)
    for row, image in enumerate(table.texts("image")):
        if not image:
            raise table.error(row, "image", "is empty: name the picture")
    table.refuse_repeats(["image", "camera", "stage", "id"], "target", unless_empty="id")
    axes = [
        table.floats(c, check=_positive, expected="a positive length")
        for c in ("semi_major_px", "semi_minor_px")
    ]
    sigmas = [
        table.floats(c, empty=np.nan, check=_positive, expected="a positive sigma")
        for c in ("sigma_x_px", "sigma_y_px")
    ]
    confidence = None
    if "id_confidence" in table:
        confidence = table.floats(
            "id_confidence", empty=np.nan, check=_share, expected="a probability from 0 to 1"
        )
    return TargetTable(
        id_confidence=confidence,
        image=tuple(table.texts("image")),
        camera=tuple(table.texts("camera")),
        stage=table.integers("stage", empty=0, minimum=1),
        id=table.integers("id", empty=-1),
        xy_px=np.stack([table.floats("x_px"), table.floats("y_px")], axis=1),
        semi_axes_px=np.stack(axes, axis=1),
        angle_rad=table.floats("angle_rad"),
        sigma_px=np.stack(sigmas, axis=1),
    )


def target_table(pictures: Iterable[tuple[str, str, int | None, Targets]]) -> TargetTable:
    """One table of (image, camera or "", stage or None, targets) of many pictures."""
    items = list(pictures)
    counts = [len(targets) for *_, targets in items]

    def joined(name: str, width: int) -> FloatArray:
        parts = [np.asarray(getattr(t, name), dtype=float).reshape(-1, width) for *_, t in items]
        return np.concatenate([np.empty((0, width)), *parts])

    return TargetTable(
        image=tuple(i for (i, _, _, t) in items for _ in range(len(t))),
        camera=tuple(c for (_, c, _, t) in items for _ in range(len(t))),
        stage=np.repeat(np.array([s or 0 for _, _, s, _ in items], dtype=np.int32), counts),
        id=joined("id", 1)[:, 0].astype(np.int32),
        xy_px=joined("centre_px", 2),
        semi_axes_px=joined("semi_axes_px", 2),
        angle_rad=joined("angle_rad", 1)[:, 0],
        sigma_px=joined("sigma_px", 2),
        id_confidence=joined("id_confidence", 1)[:, 0],
    )


def format_targets(table: TargetTable) -> str:
    """The text of a targets CSV."""
    columns = [
        table.image,
        table.camera,
        [int(s) or None for s in table.stage],
        [None if i < 0 else int(i) for i in table.id],
        *table.xy_px.T,
        *table.semi_axes_px.T,
        table.angle_rad,
        *table.sigma_px.T,
    ]
    if table.id_confidence is None:
        return format_csv(TARGET_COLUMNS, columns)
    return format_csv((*TARGET_COLUMNS, *TARGET_OPTIONAL), [*columns, list(table.id_confidence)])
