"""Export: a measurement in other programs' formats, one file a format."""

from videogrammetry.export.csv_file import motion_csv, points_csv, trajectories_csv

__all__ = ["motion_csv", "points_csv", "trajectories_csv"]
