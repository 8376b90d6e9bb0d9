"""videogrammetry: pictures of synchronised cameras to 3-D motion."""

from videogrammetry.version import __version__

__all__ = ["__version__"]
