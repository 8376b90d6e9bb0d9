"""Recognition: pictures to targets."""

from videogrammetry.recognition.camera_model import CameraModel
from videogrammetry.recognition.codes import CODE_FAMILIES, CodeFamily, code_family, mirror_images
from videogrammetry.recognition.learning import learn_camera, read_frame
from videogrammetry.recognition.options import RING_STATUS, RecognitionOptions, TrackedOptions
from videogrammetry.recognition.packed import PackedFrame
from videogrammetry.recognition.recognize import recognize
from videogrammetry.recognition.sequence import TargetSequence, recognize_sequence

__all__ = [
    "CODE_FAMILIES",
    "RING_STATUS",
    "CameraModel",
    "CodeFamily",
    "PackedFrame",
    "RecognitionOptions",
    "TargetSequence",
    "TrackedOptions",
    "code_family",
    "learn_camera",
    "mirror_images",
    "read_frame",
    "recognize",
    "recognize_sequence",
]
