"""From a network file and its tables to an adjusted network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_input import (
    NO_SCALE_BARS,
    Datum,
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
    ScaleBars,
)
from videogrammetry.calibration.network_result import NetworkAdjustment, NetworkOptions
from videogrammetry.errors import ProjectFileError, TableError
from videogrammetry.geometry import default_r0_px
from videogrammetry.pipeline.frames import Progress, silent
from videogrammetry.project.network_file import (
    DEFAULT_SIGMA_PX,
    NetworkCameraSection,
    NetworkFile,
)
from videogrammetry.project.network_tables import (
    NamedObservations,
    NamedPoints,
    NamedScaleBar,
    read_network_observations,
    read_network_points,
    read_network_scale_bars,
)
from videogrammetry.project.toml_table import nearest
from videogrammetry.types import INTERIOR_NAMES, FloatArray


@dataclass(frozen=True, kw_only=True)
class AdjustRun:
    """A network file, what it came to, and what was remarked about its tables."""

    file: NetworkFile
    network: NetworkInput
    result: NetworkAdjustment


def adjust_file(
    file: NetworkFile,
    options: NetworkOptions | None = None,
    *,
    progress: Progress = silent,
) -> AdjustRun:
    """Adjust the network of a network file.

    Raises
    ------
    ProjectFileError, TableError
        The tables do not fit together: file, line or name, and what to do.
    CalibrationError
        The network cannot be adjusted: see
        :func:`~videogrammetry.calibration.network_adjustment.adjust_network`.
    """
    progress(0, 2, "reading")
    network, remarks = network_input(file)
    progress(1, 2, "adjusting")
    result = adjust_network(network, options)
    progress(2, 2, "adjusting")
    if remarks:
        result = replace(result, warnings=(*remarks, *result.warnings))
    return AdjustRun(file=file, network=network, result=result)


def network_input(file: NetworkFile) -> tuple[NetworkInput, tuple[str, ...]]:
    """The tables of a network file as the adjustment takes them, and remarks about them.

    Points that observations name and the points table does not are unknowns without a
    start value. Pictures without an ``[images.NAME]`` belong to the only camera.
    """
    observed = read_network_observations(file.observations)
    points = _points(file, observed)
    bars = () if file.scale_bars is None else read_network_scale_bars(file.scale_bars)
    images, remarks = _images(file, observed)
    number = {name: i for i, name in enumerate(points.name)}
    image_number = {image.name: i for i, image in enumerate(images)}
    sigma_px = _sigma_px(file, observed)
    variance = np.where(np.isnan(observed.sigma_px), sigma_px, observed.sigma_px) ** 2
    corrected = (file.residuals or observed.residuals) == "corrected"
    network = NetworkInput(
        cameras=tuple(_camera(section, corrected) for section in file.cameras.values()),
        images=images,
        points=points,
        observations=NetworkObservations(
            image=np.array([image_number[name] for name in observed.image], np.int32),
            point=np.array([number.get(name, -1) for name in observed.point], np.int32),
            xy_px=observed.xy_px,
            cov_px2=np.stack([variance, np.zeros(len(variance)), variance], axis=1),
        ),
        scale_bars=_scale_bars(file, bars, points),
        sigma_px=sigma_px,
        datum=_datum(file, points),
        critical_value=file.critical_value,
    )
    return network, tuple(remarks)


def _sigma_px(file: NetworkFile, observed: NamedObservations) -> float:
    """The a-priori sigma: stated, else what most observations state, else the default."""
    if file.sigma_px is not None:
        return file.sigma_px
    stated = observed.sigma_px[np.isfinite(observed.sigma_px)]
    return float(np.median(stated)) if len(stated) else DEFAULT_SIGMA_PX


def _datum(file: NetworkFile, points: NetworkPoints) -> Datum:
    """As stated; else what the points are: fixed, weighted, or all unknown."""
    if file.datum is not None:
        return file.datum
    if (points.kind == "fixed").any():
        return "fixed"
    return "weighted" if (points.kind == "weighted").any() else "free"


def _camera(section: NetworkCameraSection, corrected: bool) -> NetworkCamera:
    interior = np.array([section.start.get(name, 0.0) for name in INTERIOR_NAMES])
    interior[0] = section.start.get("f", np.nan)
    if "time_offset" in (section.free or ()):
        raise ProjectFileError(
            f"[cameras.{section.name}] free has time_offset, which needs moving points: a network "
            "of single pictures says nothing about it; take it away"
        )
    return NetworkCamera(
        name=section.name,
        image_size_px=section.image_size_px,
        interior=interior,
        r0_px=section.r0_px or default_r0_px(section.image_size_px),
        measured=section.measured,
        aspect=section.start.get("aspect", 0.0),
        corrected_residual=corrected and section.measured,
        free=section.free,
        sigma=section.sigma,
    )


def _images(
    file: NetworkFile, observed: NamedObservations
) -> tuple[tuple[NetworkImage, ...], list[str]]:
    """The pictures that have observations, in the tables' order."""
    cameras = list(file.cameras)
    seen = tuple(dict.fromkeys(observed.image))
    images = []
    for name in seen:
        section = file.images.get(name)
        if section is None and len(cameras) > 1:
            raise ProjectFileError(
                f"{file.path}: picture {name} of {file.observations.name} has no table "
                f"[images.{_key(name)}], and there are {len(cameras)} cameras: say which took it, "
                f'camera = "..."{nearest(name, file.images) if file.images else ""}'
            )
        images.append(
            NetworkImage(
                name=name,
                camera=0 if section is None else cameras.index(section.camera),
                rotation=None if section is None else section.rotation,
                translation_mm=None if section is None else section.translation_mm,
            )
        )
    unseen = [name for name in file.images if name not in seen]
    if file.images and len(unseen) == len(file.images):
        raise ProjectFileError(
            f"{file.path}: none of its [images] is in {file.observations.name}: "
            f"{unseen[0]!r} is not an image there{nearest(unseen[0], seen)}"
        )
    remarks = []
    if unseen:
        remarks.append(
            f"{len(unseen)} pictures of {file.path.name} have no observation: "
            f"{', '.join(unseen[:8])}"
        )
    return tuple(images), remarks


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() else f'"{name}"'


def _points(file: NetworkFile, observed: NamedObservations) -> NetworkPoints:
    """The table's points, then those that are observed alone."""
    empty = np.empty((0, 3))
    table = (
        NamedPoints(
            name=(), position_mm=empty, sigma_mm=empty, normal=empty, diameter_mm=np.empty(0)
        )
        if file.points is None
        else read_network_points(file.points)
    )
    for name in file.fixed:
        if name not in table.name:
            raise file.error(
                "fixed", f"names point {name}, which {file.points} does not have"
                f"{nearest(name, table.name[:50])}",
            )  # fmt: skip
    more = tuple(dict.fromkeys(p for p in observed.point if p and p not in set(table.name)))
    n, m = len(table), len(more)
    kind = _kinds(file, table)
    names = (*table.name, *more)
    diameter = np.append(table.diameter_mm, np.full(m, np.nan))
    if file.diameter_mm is not None:
        diameter = np.where(np.isnan(diameter), file.diameter_mm, diameter)
    normal = np.vstack([table.normal, np.full((m, 3), np.nan)])
    return NetworkPoints(
        name=names,
        position_mm=np.vstack([table.position_mm, np.full((m, 3), np.nan)]),
        kind=np.append(kind, np.full(m, "free")).astype(str),
        cov_mm2=np.concatenate([_cov(table, kind), np.full((m, 3, 3), np.nan)]),
        full_cov_mm2=_full_cov(table, kind),
        normal=normal,
        diameter_mm=diameter if np.isfinite(diameter).any() else None,
    ) if n + m else _no_point(file)  # fmt: skip


def _no_point(file: NetworkFile) -> NetworkPoints:
    raise TableError(f"{file.observations}: no observation names its point; fill the column point")


def _kinds(file: NetworkFile, table: NamedPoints) -> np.ndarray:
    """(N,) fixed, weighted or free."""
    kind = np.where(np.isnan(table.sigma_mm[:, 0]), "free", "weighted").astype("<U8")
    kind[table.sigma_mm[:, 0] == 0] = "fixed"
    kind[np.isin(np.array(table.name, dtype=object), np.array(file.fixed, dtype=object))] = "fixed"
    bare = np.isnan(table.position_mm[:, 0]) & (kind != "free")
    if bare.any():
        name = table.name[int(np.flatnonzero(bare)[0])]
        raise TableError(
            f"{file.points}: point {name} is {kind[bare][0]} and has no coordinates: give them, or "
            "take it out of fixed and its sigmas away"
        )
    return kind


def _cov(table: NamedPoints, kind: np.ndarray) -> FloatArray:
    cov = np.full((len(table), 3, 3), np.nan)
    weighted = kind == "weighted"
    cov[weighted] = np.eye(3) * (table.sigma_mm[weighted] ** 2)[:, None, :]
    if table.cov6_mm2 is not None:
        order = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
        cov[weighted] = table.cov6_mm2[weighted][:, order]
    return cov


def _full_cov(table: NamedPoints, kind: np.ndarray) -> FloatArray | None:
    """Of the points that stay weighted: those named in ``fixed`` leave it."""
    if table.full_cov_mm2 is None:
        return None
    had = np.flatnonzero(np.nan_to_num(table.sigma_mm).all(axis=1))
    keep = np.flatnonzero(kind[had] == "weighted")
    places = (3 * keep[:, None] + np.arange(3)).ravel()
    return np.asarray(table.full_cov_mm2[np.ix_(places, places)])


def _scale_bars(
    file: NetworkFile, bars: Sequence[NamedScaleBar], points: NetworkPoints
) -> ScaleBars:
    if not bars:
        return NO_SCALE_BARS
    number = {name: i for i, name in enumerate(points.name)}
    for row, bar in enumerate(bars):
        for end in (bar.point_a, bar.point_b):
            if end not in number:
                raise TableError(
                    f"{file.scale_bars}: bar {row + 1} ({bar.point_a}-{bar.point_b}) ends in point "
                    f"{end}, which is neither observed nor in the points table"
                    f"{nearest(end, points.name[:50])}"
                )
    return ScaleBars(
        point_a=np.array([number[bar.point_a] for bar in bars], np.int32),
        point_b=np.array([number[bar.point_b] for bar in bars], np.int32),
        length_mm=np.array([bar.length_mm for bar in bars]),
        sigma_mm=np.array([bar.sigma_mm for bar in bars]),
        certificate=tuple(bar.certificate for bar in bars),
    )
