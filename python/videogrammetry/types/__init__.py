"""The nouns that flow between the rooms: frozen dataclasses of arrays.

Frames and units as everywhere in this package: pixel (0, 0) is the centre of
the top-left pixel, x right, y down; camera axes z forward, x right, y down;
lengths in mm, times in s, angles in rad. ``a_from_b`` names a transform.
"""

from videogrammetry.types.arrays import (
    COV6_ORDER,
    FloatArray,
    IntArray,
    cov6_from_matrix,
    matrix_from_cov6,
)
from videogrammetry.types.frames import (
    FrameSource,
    PackedSamples,
)
from videogrammetry.types.matches import (
    FlatTargets,
    Matches,
    StageMatches,
    StagePoints,
)
from videogrammetry.types.measurements import (
    POINT_FLAGS,
    CameraSeries,
    Measurement,
    Motion,
    TargetRecords,
    Trajectories,
)
from videogrammetry.types.rigs import (
    INTERIOR_NAMES,
    FlatInterface,
    RigCamera,
    RigData,
)
from videogrammetry.types.targets import (
    Observations,
    PointSet,
    Targets,
)

__all__ = [
    "COV6_ORDER",
    "INTERIOR_NAMES",
    "POINT_FLAGS",
    "CameraSeries",
    "FlatInterface",
    "FlatTargets",
    "FloatArray",
    "FrameSource",
    "IntArray",
    "Matches",
    "Measurement",
    "Motion",
    "Observations",
    "PackedSamples",
    "PointSet",
    "RigCamera",
    "RigData",
    "StageMatches",
    "StagePoints",
    "TargetRecords",
    "Targets",
    "Trajectories",
    "cov6_from_matrix",
    "matrix_from_cov6",
]
