"""Export: measurements in other programs' formats, one file a format."""

from videogrammetry.export.tables import TABLES, format_table

__all__ = ["TABLES", "format_table"]
