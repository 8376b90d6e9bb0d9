"""Sequences: the frames of one camera, from picture files, read one at a time.

``open_sequence`` takes a file, a folder, a pattern or a list of these and
gives a :class:`~videogrammetry.types.FrameSource`. A format is one file of
this folder; ``formats.py`` names them all.
"""

from videogrammetry.sequence.arrays import ArraySource, as_source
from videogrammetry.sequence.formats import known_suffixes
from videogrammetry.sequence.grey import grey_from_rgb
from videogrammetry.sequence.open import SequenceSpec, open_sequence
from videogrammetry.sequence.select import find_files, natural_key
from videogrammetry.sequence.source import JoinedSource, check_same_length

__all__ = [
    "ArraySource",
    "JoinedSource",
    "SequenceSpec",
    "as_source",
    "check_same_length",
    "find_files",
    "grey_from_rgb",
    "known_suffixes",
    "natural_key",
    "open_sequence",
]
