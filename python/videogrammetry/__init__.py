"""videogrammetry: pictures of synchronised cameras to 3-D motion."""

__version__ = "0.1.0"
