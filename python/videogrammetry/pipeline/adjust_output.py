"""The files of an adjusted network: tables that need nothing of this library to be read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.calibration.network_result import (
    AdjustedCamera,
    AdjustedImages,
    AdjustedPoints,
    NetworkAdjustment,
    NetworkOptions,
)
from videogrammetry.geometry import vector_from_rotation
from videogrammetry.pipeline.adjust import AdjustRun
from videogrammetry.project import format_csv, plain, provenance, write_text
from videogrammetry.project.network_tables import write_point_covariance
from videogrammetry.project.tables import POINT_COLUMNS, POINT_NORMAL, POINT_SIGMAS

#: The layout of cameras.json and summary.json.
SCHEMA = 1
POINTS, COVARIANCE, CAMERAS, IMAGES = "points.csv", "points.npz", "cameras.json", "images.csv"
RESIDUALS, BARS, SUMMARY, REPORT = (
    "residuals.csv",
    "scale_bars.csv",
    "summary.json",
    "report.html",
)
#: All that ``adjust`` may write.
OUTPUTS = (POINTS, COVARIANCE, CAMERAS, IMAGES, RESIDUALS, BARS, SUMMARY, REPORT)
IMAGE_COLUMNS = (
    *("image", "camera", "rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm"),
    *("sigma_rx_rad", "sigma_ry_rad", "sigma_rz_rad"),
    *("sigma_tx_mm", "sigma_ty_mm", "sigma_tz_mm"),
    *("x_mm", "y_mm", "z_mm", "sigma_x_mm", "sigma_y_mm", "sigma_z_mm"),
    *("points", "rms_px"),
)
RESIDUAL_COLUMNS = (
    *("image", "point", "x_px", "y_px", "sigma_x_px", "sigma_y_px"),
    *("residual_x_px", "residual_y_px", "w_x", "w_y", "redundancy_x", "redundancy_y"),
    *("detectable_x_px", "detectable_y_px", "external_x", "external_y", "used"),
)
BAR_COLUMNS = (
    *("point_a", "point_b", "length_mm", "sigma_mm", "adjusted_mm", "residual_mm"),
    *("w", "redundancy", "used", "certificate"),
)
_LENGTHS = {"f": "f_px", "x0": "x0_px", "y0": "y0_px"}


def write_adjustment(
    folder: Path, run: AdjustRun, options: NetworkOptions, page: str
) -> Mapping[str, Any]:
    """Writes all files of an adjusted network into a folder; returns the summary.

    Every file is whole or not there; ``summary.json`` comes last. What an earlier
    adjustment wrote and this one does not have is removed.
    """
    result = run.result
    origin = provenance(
        {"network": _settings(run), "adjust": options}, run.file.inputs, run.file.path.parent
    )
    summary = summary_document(run, origin)
    stale = {BARS: bool(len(result.scale_bars)), COVARIANCE: result.points.full_cov_mm2 is not None}
    for name, wanted in stale.items():
        if not wanted:
            (folder / name).unlink(missing_ok=True)
    if result.points.full_cov_mm2 is not None:
        write_point_covariance(folder / COVARIANCE, result.points.name, result.points.full_cov_mm2)
    write_text(folder / POINTS, points_csv(result.points))
    write_text(folder / CAMERAS, _json(cameras_document(result, origin)))
    write_text(folder / IMAGES, images_csv(result.images, result.cameras))
    write_text(folder / RESIDUALS, residuals_csv(result))
    if len(result.scale_bars):
        write_text(folder / BARS, bars_csv(result))
    write_text(folder / REPORT, page)
    write_text(folder / SUMMARY, _json(summary))
    return summary


def _settings(run: AdjustRun) -> dict[str, Any]:
    """What the network file says beside the names of its tables, which provenance has."""
    file = run.file
    return {
        "cameras": file.cameras,
        "fixed": file.fixed,
        "sigma_px": run.network.sigma_px,
        "datum": run.network.datum,
        "critical_value": file.critical_value,
        "diameter_mm": file.diameter_mm,
    }


def _json(document: Mapping[str, Any]) -> str:
    return json.dumps(plain(document), indent=1, ensure_ascii=False) + "\n"


def points_csv(points: AdjustedPoints) -> str:
    """A points table: positions with their standard deviations; fixed points have 0."""
    header = [*POINT_COLUMNS, *POINT_SIGMAS]
    columns: list[Any] = [points.name, *points.position_mm.T, *points.sigma_mm.T]
    if points.normal is not None and np.isfinite(points.normal).any():
        header += POINT_NORMAL
        columns += [*points.normal.T]
    if points.diameter_mm is not None and np.isfinite(points.diameter_mm).any():
        header.append("diameter_mm")
        columns.append(points.diameter_mm)
    return format_csv(header, columns)


def images_csv(images: AdjustedImages, cameras: tuple[AdjustedCamera, ...]) -> str:
    """Poses cam_from_world as rotation vector and translation, and projection centres."""
    sigma = np.sqrt(np.diagonal(images.cov, axis1=1, axis2=2))
    vectors = np.array([vector_from_rotation(r) for r in images.rotation]).reshape(-1, 3)
    centre = np.sqrt(np.diagonal(images.cov_centre_mm2, axis1=1, axis2=2))
    columns: list[Any] = [
        images.name,
        [cameras[i].name for i in images.camera],
        *vectors.T,
        *images.translation_mm.T,
        *sigma.T,
        *images.centre_mm.T,
        *centre.T,
        images.points,
        images.rms_px,
    ]
    return format_csv(IMAGE_COLUMNS, columns)


def residuals_csv(result: NetworkAdjustment) -> str:
    """One row an image point, used or not: residual, test and reliability per coordinate."""
    table = result.observations
    columns: list[Any] = [
        [result.images.name[i] for i in table.image],
        [result.points.name[i] for i in table.point],
        *table.xy_px.T,
        *table.sigma_px.T,
        *table.residual_px.T,
        *table.normalised.T,
        *table.redundancy.T,
        *table.detectable_px.T,
        *table.external.T,
        [int(used) for used in table.used],
    ]
    return format_csv(RESIDUAL_COLUMNS, columns)


def bars_csv(result: NetworkAdjustment) -> str:
    """One row a scale bar that took part."""
    bars, names = result.scale_bars, result.points.name
    columns: list[Any] = [
        [names[i] for i in bars.point_a],
        [names[i] for i in bars.point_b],
        bars.length_mm,
        bars.sigma_mm,
        bars.length_mm - bars.residual_mm,
        bars.residual_mm,
        bars.normalised,
        bars.redundancy,
        [int(used) for used in bars.used],
        bars.certificate,
    ]
    return format_csv(BAR_COLUMNS, columns)


def cameras_document(result: NetworkAdjustment, origin: Mapping[str, Any]) -> dict[str, Any]:
    """What cameras.json holds: the keys of a rig's cameras, without a pose."""
    return {
        "schema": SCHEMA,
        "cameras": {camera.name: _camera(camera) for camera in result.cameras},
        "how": origin,
    }


def _camera(camera: AdjustedCamera) -> dict[str, Any]:
    return {
        "image_size_px": camera.image_size_px,
        "distortion": "measured" if camera.measured else "ideal",
        **{_LENGTHS.get(name, name): value for name, value in camera.values.items()},
        "r0_px": camera.r0_px,
        "sigma": {_LENGTHS.get(name, name): camera.sigma[name] for name in camera.free},
        "free": camera.free,
        "significance": camera.significance,
        "correlation": {"order": camera.free, "matrix": camera.correlation},
        "covariance": {"order": camera.free, "matrix": camera.cov},
        "dropped": camera.dropped,
        "images": camera.num_images,
        "points": camera.num_points,
        "rms_px": camera.rms_px,
    }


def summary_document(run: AdjustRun, origin: Mapping[str, Any]) -> dict[str, Any]:
    """What summary.json holds."""
    result = run.result
    bars, names = result.scale_bars, result.points.name
    return {
        "schema": SCHEMA,
        **{
            name: getattr(result.summary, name)
            for name in type(result.summary).__dataclass_fields__
        },
        "rejected": result.rejected,
        "warnings": result.warnings,
        "scale_bars": [
            {
                "point_a": names[bars.point_a[i]],
                "point_b": names[bars.point_b[i]],
                "length_mm": bars.length_mm[i],
                "residual_mm": bars.residual_mm[i],
                "w": bars.normalised[i],
                "used": bool(bars.used[i]),
            }
            for i in range(len(bars))
        ],
        "how": origin,
    }
