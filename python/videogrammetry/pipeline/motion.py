"""Motion of a measurement computed again: another reference stage, another centroid."""

from __future__ import annotations

import dataclasses

from videogrammetry.errors import MeasurementError
from videogrammetry.motion import MotionOptions, compute_motion
from videogrammetry.pipeline.measure_job import reference_stage, refuse_filter
from videogrammetry.project import Project, plain, provenance
from videogrammetry.types import Measurement


def recompute_motion(
    project: Project, measurement: Measurement, options: MotionOptions | None = None
) -> Measurement:
    """The measurement with displacement, velocity and centroid computed again.

    Parameters
    ----------
    project : its ``[motion]`` says the reference stage where ``options`` does not.
    measurement : positions and targets stay as they are.

    Returns
    -------
    Measurement
        Its provenance keeps the measurement's and has the motion's own under "motion".

    Raises
    ------
    ProjectFileError, MeasurementError
        The reference stage or a centroid's point was not measured.
    """
    refuse_filter(project)
    options = options or MotionOptions()
    stage = measurement.trajectories.stage
    if options.reference_stage is None:
        reference = reference_stage(project, (int(stage[0]), int(stage[-1])))
        options = dataclasses.replace(options, reference_stage=reference)
    if not options.leave_out:
        options = dataclasses.replace(options, leave_out=project.motion.leave_out)
    try:
        motion = compute_motion(measurement.trajectories, options)
    except ValueError as error:
        raise MeasurementError(str(error)) from error
    files = [p for p in (project.path, project.measurement_path) if p.is_file()]
    kept = measurement.provenance
    origin = {
        **kept,
        "options": {**kept.get("options", {}), "motion": plain(options)},
        "motion": provenance(options, files, project.folder),
    }
    return dataclasses.replace(measurement, motion=motion, provenance=origin)
