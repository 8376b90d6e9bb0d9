"""Export: measurements and rigs in other programs' formats, one file a format; rigs also back."""

from videogrammetry.export.lenses import LensCamera, convert_rig
from videogrammetry.export.read_lenses import read_lens_cameras, rig_of_lenses
from videogrammetry.export.rig_formats import (
    RIG_FORMATS,
    RigFormat,
    RigFormatName,
    convert_for,
    format_file,
    format_folder,
)
from videogrammetry.export.tables import TABLES, format_table, leave_out_flagged

__all__ = [
    "RIG_FORMATS",
    "TABLES",
    "LensCamera",
    "RigFormat",
    "RigFormatName",
    "convert_for",
    "convert_rig",
    "format_file",
    "format_folder",
    "format_table",
    "leave_out_flagged",
    "read_lens_cameras",
    "rig_of_lenses",
]
