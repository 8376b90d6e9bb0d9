"""Errors that name the cause, the place and the remedy.

The caller's own mistakes are :class:`ValueError`; one item that fails gives
``None`` or a status; a task that fails as a whole raises one of these. The
command prints the message as one paragraph and exits with status 1.
"""

from __future__ import annotations


class VideogrammetryError(RuntimeError):
    """A task failed: the message says why, where, and what to do."""


class SequenceError(VideogrammetryError):
    """A picture or a sequence file cannot be read, or does not fit the others."""


class TableError(VideogrammetryError):
    """A CSV table is malformed: file, line and column are named."""


class ProjectFileError(VideogrammetryError):
    """A project, rig or measurement file is wrong, damaged, or too new."""


class CalibrationError(VideogrammetryError):
    """The cameras cannot be calibrated from what was given."""


class MeasurementError(VideogrammetryError):
    """The sequences cannot be measured with what was given."""


class SequenceWarning(UserWarning):
    """A sequence is not as it should be, but can be measured in: the message says how."""


class MeasurementWarning(UserWarning):
    """What was kept of a measurement is not as it should be, but the work can go on."""
