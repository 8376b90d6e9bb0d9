"""Sequences: the frames of one camera, from picture files, read one at a time.

``open_sequence`` takes a file, a folder, a pattern or a list of these and
gives a :class:`~videogrammetry.types.FrameSource`. A format is one file of
this folder; ``formats.py`` names them all. ``create_sequence`` writes frames.
"""

from videogrammetry.sequence.arrays import ArraySource, as_source
from videogrammetry.sequence.formats import known_suffixes, register_format
from videogrammetry.sequence.grey import grey_from_rgb
from videogrammetry.sequence.growing import (
    GrowingFolder,
    GrowingMraw,
    GrowingSource,
    open_growing,
)
from videogrammetry.sequence.lenient import LenientSource
from videogrammetry.sequence.open import SequenceSpec, open_sequence
from videogrammetry.sequence.parts import check_free_space
from videogrammetry.sequence.photron_session import photron_session
from videogrammetry.sequence.picture_write import picture_bytes
from videogrammetry.sequence.select import find_files, natural_key
from videogrammetry.sequence.source import JoinedSource
from videogrammetry.sequence.synchronous import (
    RangeSource,
    Synchrony,
    align,
    check_same_length,
    check_synchronous,
    irregular_times,
)
from videogrammetry.sequence.write import (
    SEQUENCE_FORMATS,
    SequenceFormat,
    SequenceWriter,
    create_sequence,
)

__all__ = [
    "SEQUENCE_FORMATS",
    "ArraySource",
    "GrowingFolder",
    "GrowingMraw",
    "GrowingSource",
    "JoinedSource",
    "LenientSource",
    "RangeSource",
    "SequenceFormat",
    "SequenceSpec",
    "SequenceWriter",
    "Synchrony",
    "align",
    "as_source",
    "check_free_space",
    "check_same_length",
    "check_synchronous",
    "create_sequence",
    "find_files",
    "grey_from_rgb",
    "irregular_times",
    "known_suffixes",
    "natural_key",
    "open_growing",
    "open_sequence",
    "photron_session",
    "picture_bytes",
    "register_format",
]
