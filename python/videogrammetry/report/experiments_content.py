"""What the page of the experiments shows: plain dataclasses that the caller fills.

Every part may be left out (None or empty): its section is then not on the page.
Nothing is calculated from these but what a drawing needs; regressions,
distances and statistics come in as numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy.typing as npt

from videogrammetry.report.experiment_figures import CentroidTruth
from videogrammetry.report.recognised_pictures import Crop
from videogrammetry.report.space import Scene
from videogrammetry.types import Measurement, RigData, TargetRecords, Targets


@dataclass(frozen=True, kw_only=True)
class ComparisonRow:
    """A row of the table that sets this run beside the paper; texts, with units.

    Attributes
    ----------
    quantity : "Slope of the free fall".
    paper, run, truth : what each says, "" where it says nothing.
    note : a sentence on why they differ or what it means.
    """

    quantity: str
    paper: str = ""
    run: str = ""
    truth: str = ""
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class CalibrationPart:
    """The calibration in short.

    Attributes
    ----------
    facts : name -> number as text, such as {"RMS residual, px": "0.031"}.
    text : a sentence or two.
    columns, rows : a table, such as one row a camera; the first column is its name.
    report : relative path of the full report.
    """

    facts: Mapping[str, str] = field(default_factory=dict)
    text: str = ""
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    report: str = ""


@dataclass(frozen=True, kw_only=True)
class RecognitionPart:
    """Pictures with what was recognised in them (Fig. 14).

    Attributes
    ----------
    pictures : (stage, camera's name) -> (height, width), uint8 or uint16.
    targets : None = those of the page's measurement; or all records; or
        (stage, camera's name) -> Targets.
    crops : camera's name -> left, top, right, bottom in pixels, right and
        bottom exclusive; None = around the numbered targets of all stages.
    stages : rows; () = the page's.
    """

    pictures: Mapping[tuple[int, str], npt.NDArray[Any]]
    targets: TargetRecords | Mapping[tuple[int, str], Targets] | None = None
    crops: Mapping[str, Crop] | None = None
    stages: Sequence[int] = ()


@dataclass(frozen=True, kw_only=True)
class FreeFallPart:
    """The regression of the free fall (Fig. 17); arguments of ``free_fall_figure``.

    Attributes
    ----------
    measured_mm : (N,) vertical displacement of the centroid, up positive.
    theoretical_mm : (N,) -g t^2 / 2.
    slope, offset_mm : theoretical = slope * measured + offset, and their sigmas.
    sigma_mm : (N,) of the measured displacement, or None.
    text : a sentence or two on the result.
    """

    measured_mm: npt.ArrayLike
    theoretical_mm: npt.ArrayLike
    slope: float
    offset_mm: float
    slope_sigma: float | None = None
    offset_sigma_mm: float | None = None
    sigma_mm: npt.ArrayLike | None = None
    text: str = ""


@dataclass(frozen=True, kw_only=True)
class ScaleBarPart:
    """A scale bar's errors; arguments of ``scale_bar_figure``.

    Attributes
    ----------
    error_mm : (N,) measured less certified length, NaN = not measured.
    sigma_mm : (N,) predicted standard deviation, image noise and calibration.
    sigma_calibration_mm : (N,) the calibration's part of it, or None.
    speed_mm_s : (N,) of the bar's middle, or None.
    limit_mm : largest error that is stated, drawn as +- lines, or None.
    text : a sentence or two on the result.
    """

    error_mm: npt.ArrayLike
    sigma_mm: npt.ArrayLike
    sigma_calibration_mm: npt.ArrayLike | None = None
    speed_mm_s: npt.ArrayLike | None = None
    limit_mm: float | None = None
    text: str = ""


@dataclass(frozen=True, kw_only=True)
class DeformationPart:
    """Distances of the points from the centroid; arguments of ``deformation_figure``.

    Attributes
    ----------
    radial_change_mm : (S, P) distance less that of the reference, at the
        measurement's stages, NaN = unknown.
    point_id : (P,) in the order of the map's rows, such as around the object.
    text : a sentence or two on the result.
    """

    radial_change_mm: npt.ArrayLike
    point_id: Sequence[int]
    text: str = ""


@dataclass(frozen=True, kw_only=True)
class FileLink:
    """A file of the run: path relative to the page, and what it holds."""

    path: str
    what: str = ""


@dataclass(frozen=True, kw_only=True)
class ExperimentsPage:
    """All that is on the page.

    Attributes
    ----------
    title, summary : heading and one sentence below it.
    facts : name -> large number as text, four to eight of them.
    comparison : rows of the table "quantity, paper, this run, truth".
    comparison_text : a sentence above that table.
    calibration, scale_bar, recognition, free_fall, deformation : the parts.
    measurement : of the falling object; gives the views in space, the
        trajectory, displacement and speed. None = none of these.
    rig : its cameras, for the view in space.
    scene : what is up and away, ground and outline in the measurement's frame.
    truth : of the centroid, from a simulation.
    stages : numbers of the stages to show, three in the paper (1, 60, 120).
    stage_notes : stage -> a few words, such as {120: "impact"}.
    markers : (stage, word) in the drawings over time, such as (116, "impact").
    files : with relative links. commands : how to repeat, one a line.
    remarks : sentences on limits and on what is simulated.
    provenance : version, options, hashes; shown folded.
    """

    title: str
    summary: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    comparison: Sequence[ComparisonRow] = ()
    comparison_text: str = ""
    calibration: CalibrationPart | None = None
    scale_bar: ScaleBarPart | None = None
    recognition: RecognitionPart | None = None
    measurement: Measurement | None = None
    rig: RigData | None = None
    scene: Scene = field(default_factory=Scene)
    truth: CentroidTruth | None = None
    free_fall: FreeFallPart | None = None
    deformation: DeformationPart | None = None
    stages: Sequence[int] = ()
    stage_notes: Mapping[int, str] = field(default_factory=dict)
    markers: Sequence[tuple[int, str]] = ()
    files: Sequence[FileLink] = ()
    commands: Sequence[str] = ()
    remarks: Sequence[str] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
