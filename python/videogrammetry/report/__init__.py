"""Reports: pages and pictures that show a result; no numerics beyond formatting."""

from videogrammetry.report.accuracy_figures import deformation_figure, scale_bar_figure
from videogrammetry.report.calibration_report import calibration_report
from videogrammetry.report.chart import Marker, Series, chart
from videogrammetry.report.displacement_view import displacement_figure, displacement_view
from videogrammetry.report.experiment_figures import (
    CentroidTruth,
    free_fall_figure,
    trajectory_figures,
)
from videogrammetry.report.experiments_content import (
    CalibrationPart,
    ComparisonRow,
    DeformationPart,
    ExperimentsPage,
    FileLink,
    FreeFallPart,
    RecognitionPart,
    ScaleBarPart,
)
from videogrammetry.report.experiments_page import experiments_page
from videogrammetry.report.html import Figure
from videogrammetry.report.motion_view import motion_view_svg
from videogrammetry.report.overlay import draw_overlay, write_overlay
from videogrammetry.report.plan_page import plan_page
from videogrammetry.report.recognised_pictures import recognised_pictures
from videogrammetry.report.space import Scene
from videogrammetry.report.space_view import interactive_view

__all__ = [
    "CalibrationPart",
    "CentroidTruth",
    "ComparisonRow",
    "DeformationPart",
    "ExperimentsPage",
    "Figure",
    "FileLink",
    "FreeFallPart",
    "Marker",
    "RecognitionPart",
    "ScaleBarPart",
    "Scene",
    "Series",
    "calibration_report",
    "chart",
    "deformation_figure",
    "displacement_figure",
    "displacement_view",
    "draw_overlay",
    "experiments_page",
    "free_fall_figure",
    "interactive_view",
    "motion_view_svg",
    "plan_page",
    "recognised_pictures",
    "scale_bar_figure",
    "trajectory_figures",
    "write_overlay",
]
