"""Reports: pages and pictures that show a result; no numerics beyond formatting."""

from videogrammetry.report.calibration_report import calibration_report
from videogrammetry.report.motion_view import motion_view_svg
from videogrammetry.report.overlay import draw_overlay, write_overlay

__all__ = ["calibration_report", "draw_overlay", "motion_view_svg", "write_overlay"]
