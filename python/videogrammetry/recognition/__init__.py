"""Recognition: pictures to targets."""

from videogrammetry.recognition.codes import CODE_FAMILIES, CodeFamily, code_family, mirror_images
from videogrammetry.recognition.options import RING_STATUS, RecognitionOptions
from videogrammetry.recognition.recognize import recognize
from videogrammetry.recognition.sequence import TargetSequence, recognize_sequence

__all__ = [
    "CODE_FAMILIES",
    "RING_STATUS",
    "CodeFamily",
    "RecognitionOptions",
    "TargetSequence",
    "code_family",
    "mirror_images",
    "recognize",
    "recognize_sequence",
]
