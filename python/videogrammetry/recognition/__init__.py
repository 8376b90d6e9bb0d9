"""Recognition: pictures to targets."""

from videogrammetry.recognition.codes import CODE_FAMILIES, CodeFamily, code_family
from videogrammetry.recognition.options import RING_STATUS, RecognitionOptions
from videogrammetry.recognition.recognize import recognize

__all__ = [
    "CODE_FAMILIES",
    "RING_STATUS",
    "CodeFamily",
    "RecognitionOptions",
    "code_family",
    "recognize",
]
