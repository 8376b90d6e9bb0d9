"""Sequences: the frames of one camera, from picture files, read one at a time.

``open_sequence`` takes a file, a folder, a pattern or a list of these and
gives a :class:`~videogrammetry.types.FrameSource`. A format is one file of
this folder; ``formats.py`` names them all. ``create_sequence`` writes frames.
"""

from videogrammetry.sequence.arrays import ArraySource, as_source
from videogrammetry.sequence.formats import known_suffixes
from videogrammetry.sequence.grey import grey_from_rgb
from videogrammetry.sequence.open import SequenceSpec, open_sequence
from videogrammetry.sequence.parts import check_free_space
from videogrammetry.sequence.picture_write import picture_bytes
from videogrammetry.sequence.select import find_files, natural_key
from videogrammetry.sequence.source import JoinedSource, check_same_length
from videogrammetry.sequence.write import (
    SEQUENCE_FORMATS,
    SequenceFormat,
    SequenceWriter,
    create_sequence,
)

__all__ = [
    "SEQUENCE_FORMATS",
    "ArraySource",
    "JoinedSource",
    "SequenceFormat",
    "SequenceSpec",
    "SequenceWriter",
    "as_source",
    "check_free_space",
    "check_same_length",
    "create_sequence",
    "find_files",
    "grey_from_rgb",
    "known_suffixes",
    "natural_key",
    "open_sequence",
    "picture_bytes",
]
