"""The tables of ``videogrammetry verify``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from videogrammetry.accuracy import (
    DEFINITIONS,
    ErrorStatistics,
    FreeFallTest,
    LengthStatistics,
    ReprojectionStatistics,
    ScaleBarTest,
    TruthComparison,
)
from videogrammetry.cli.common import text_table
from videogrammetry.pipeline.verify import Verification
from videogrammetry.types import FloatArray

_MAX_ROWS = 40
_MAX_LISTED = 20
_MAX_SIGMA0 = 3.0


def verification_text(verification: Verification) -> str:
    """All tables, one blank line between them."""
    parts = []
    if verification.scale_bars is not None:
        parts.append(scale_bar_text(verification.scale_bars, verification.scale_bar_rig_error_mm))
    if verification.free_fall is not None:
        parts.append(free_fall_text(verification.free_fall))
    parts.append(reprojection_text(verification.reprojection))
    if verification.truth is not None:
        parts.append(truth_text(verification.truth))
    return "\n".join(parts)


def _n(value: float, digits: int, sign: bool = False) -> str:
    """A number, or "-" where there is none.

    Examples
    --------
    >>> _n(0.21649, 3, sign=True), _n(float("nan"), 3)
    ('+0.216', '-')
    """
    if not np.isfinite(value):
        return "-"
    return f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"


def scale_bar_text(test: ScaleBarTest, rig_error_mm: FloatArray | None = None) -> str:
    """Lengths, their statistics, and what VDI/VDE 2634-1 asks for."""
    return (
        "known lengths\n"
        + _lengths(test, rig_error_mm)
        + "\nerrors measured - calibrated; sigma is predicted: pictures, calibration and bar\n"
        + _length_summary(test)
        + "SD is about the mean error; RMS contains it. +- is the mean's predicted standard "
        "deviation:\nthe calibration's error is common to all lengths and does not average out\n\n"
        + _acceptance(test)
    )


def _lengths(test: ScaleBarTest, rig_error_mm: FloatArray | None) -> str:
    header = ["bar", "stage", "length mm", "error", "sigma", "of pictures", "of calibration"]
    header += ["speed mm/s", "cameras"]
    if rig_error_mm is not None:
        header.insert(7, "actual of calibration")
    rows = []
    for i in range(min(len(test), _MAX_ROWS)):
        bar = test.bars[int(test.bar[i])]
        row = [
            f"{bar.point_a}-{bar.point_b}",
            str(int(test.stage[i])),
            _n(test.length_mm[i], 3),
            _n(test.error_mm[i], 3, sign=True),
            _n(test.sigma_mm[i], 3),
            _n(test.sigma_image_mm[i], 3),
            _n(test.sigma_rig_mm[i], 3),
            _n(test.speed_mm_s[i], 1),
            test.cameras[i],
        ]
        if rig_error_mm is not None:
            row.insert(7, _n(rig_error_mm[i], 3, sign=True))
        rows.append(row)
    more = len(test) - len(rows)
    rest = f"... and {more} more, which --out writes\n" if more else ""
    return text_table(header, rows) + rest


def _length_summary(test: ScaleBarTest) -> str:
    header = ["lengths", "n", "mean mm", "+-", "SD", "RMS", "largest", "predicted", "RMS/predicted"]
    rows = [_length_row(test.total)]
    for group in (test.by_bar, test.by_cameras):
        if len(group) > 1 or group is test.by_cameras:
            rows += [_length_row(s) for s in group]
    rows += [_length_row(s) for s in test.by_speed]
    return text_table(header, rows)


def _length_row(s: LengthStatistics) -> list[str]:
    return [
        s.name,
        str(s.count),
        _n(s.mean_mm, 3, sign=True),
        _n(s.mean_sigma_mm, 3),
        _n(s.sd_mm, 3),
        _n(s.rms_mm, 3),
        _n(s.largest_mm, 3, sign=True),
        _n(s.predicted_mm, 3),
        _n(s.ratio, 2),
    ]


def _acceptance(test: ScaleBarTest) -> str:
    words = {True: "met", False: "not met", None: "not judged"}
    rows = [[check.condition, check.found, words[check.met]] for check in test.acceptance]
    failed = sum(check.met is False for check in test.acceptance)
    verdict = (
        "this is no VDI/VDE 2634-1 test\n"
        if failed
        else "the set of lengths is that of the test; its E is for the user to state\n"
    )
    return text_table(["VDI/VDE 2634-1 asks for", "this set", ""], rows) + verdict


def free_fall_text(test: FreeFallTest) -> str:
    """Regression and fit of a fall."""
    line, fit = test.regression, test.fit
    rows = [
        ["measured acceleration, m/s^2", _n(fit.g_m_s2, 5)],
        ["its sigma, m/s^2", _n(fit.sigma_m_s2, 5)],
        ["  of the pictures", _n(fit.sigma_image_m_s2, 5)],
        ["  of the calibration", _n(fit.sigma_rig_m_s2, 5)],
        ["local gravity, m/s^2", _n(test.gravity_m_s2, 5)],
        ["deviation, per cent", _n(fit.deviation_percent, 4, sign=True)],
        ["deviation, sigmas", _n(fit.deviation_sigmas, 2, sign=True)],
        ["sigma0 of the fit (1 expected)", _n(fit.sigma0, 3)],
        ["residual RMS per coordinate, mm", _n(fit.residual_rms_mm, 4)],
        ["coordinates, redundancy", f"{fit.observations}, {fit.redundancy}"],
        ["upwards in the rig's frame", " ".join(_n(v, 5, sign=True) for v in fit.up)],
        ["its sigma, mrad", _n(fit.up_sigma_rad * 1000, 3)],
    ]
    if np.isfinite(fit.tilt_rad):
        rows.append(["angle to the given vertical, mrad", _n(fit.tilt_rad * 1000, 3)])
    if fit.spin_rad_s.any():
        rows.append(["rotation taken out, rad/s", _n(float(np.linalg.norm(fit.spin_rad_s)), 4)])
        rows.append(
            ["  per cent of g a mm beside the centre of mass", _n(fit.spin_percent_per_mm, 5)]
        )
    if len(fit.rejected):
        rows.append(["positions left out as wrong", str(len(fit.rejected))])
    rows.append(["drag, 1/m", _drag_text(test)])
    doubt = (
        f"sigma0 is {fit.sigma0:.1f}: these points do not fall alike within their noise; choose "
        "the falling ones, or look for wrong ones\n"
        if fit.sigma0 > _MAX_SIGMA0
        else ""
    )
    dropped = f", {len(fit.dropped)} seen too rarely" if len(fit.dropped) else ""
    return (
        f"free fall, stages {test.first} to {test.last}\n"
        f"regression: y = {line.slope:.4f} x {line.offset_mm:+.4f} mm, measured falls are "
        f"{abs(line.short_percent):.3f} % too {'short' if line.short_percent > 0 else 'long'}, "
        f"residual RMS {line.residual_rms_mm:.3f} mm\n"
        f"  x: measured vertical displacement since stage {test.first}, mean of "
        f"{len(line.point_id)} points, {len(line.stage)} stages;\n  y = -g t^2/2, t from that "
        "stage; both negative downwards; supposes a start from rest there\n"
        f"fit: own start and velocity for each of {len(fit.point_id)} points{dropped}, one common "
        "acceleration\n" + text_table(["", "fit"], rows) + doubt
    )


def _drag_text(test: FreeFallTest) -> str:
    fit = test.fit
    if fit.drag_determined is None:
        return _n(fit.drag_per_m, 6)
    both = f"{fit.drag_per_m:.6f} +- {fit.drag_sigma_per_m:.6f}"
    return f"{both}, estimated" if fit.drag_determined else f"{both}: not determined, taken as 0"


def reprojection_text(statistics: Sequence[ReprojectionStatistics]) -> str:
    """Statistics by camera, and what each of them is."""
    header = ["re-projection, px", "points", *(name.removesuffix("_px") for name in DEFINITIONS)]
    rows = [
        [s.name, str(s.count), *(_n(getattr(s, name), 4) for name in DEFINITIONS)]
        for s in statistics
    ]
    meanings = "".join(
        f"  {name.removesuffix('_px')}: {text}\n" for name, text in DEFINITIONS.items()
    )
    return text_table(header, rows) + meanings


def truth_text(truth: TruthComparison) -> str:
    """Errors against the truth, by cameras, and what is missing or wrong."""
    header = ["cameras", "n", "RMS mm", "x", "y", "z", "bias x", "y", "z", "largest"]
    header += ["predicted", "ratio", "normalised"]
    split = ["cameras", "pictures RMS mm", "predicted", "normalised"]
    split += ["calibration RMS mm", "predicted", "normalised"]
    everything = (truth.total, *truth.groups)
    return (
        "against the truth\n"
        f"frame: carried over by the calibrated volume, which keeps {truth.frame_rms_mm:.4f} mm "
        f"RMS and a scale error of {truth.scale_error:+.2e}\n"
        + text_table(header, [_error_row(s) for s in everything])
        + "normalised: sqrt(mean(e' C^-1 e) / 3), 1 if the covariances are right\n"
        + text_table(split, [_split_row(s) for s in everything])
        + "the calibration's part is what exact pictures give: the same at all stages, one draw "
        "of few numbers\n" + _centroid_text(truth) + _found_text(truth)
    )


def _error_row(s: ErrorStatistics) -> list[str]:
    return [
        s.name,
        str(s.count),
        _n(s.rms_mm, 4),
        *(_n(v, 4) for v in s.axis_rms_mm),
        *(_n(v, 4, sign=True) for v in s.bias_mm),
        _n(s.largest_mm, 4),
        _n(s.predicted_mm, 4),
        _n(s.ratio, 2),
        _n(s.normalised_rms, 2),
    ]


def _split_row(s: ErrorStatistics) -> list[str]:
    return [
        s.name,
        *(_n(v, 4) for v in (s.image_rms_mm, s.image_predicted_mm)),
        _n(s.image_normalised_rms, 2),
        *(_n(v, 4) for v in (s.rig_rms_mm, s.rig_predicted_mm)),
        _n(s.rig_normalised_rms, 2),
    ]


def _centroid_text(truth: TruthComparison) -> str:
    c = truth.centroid
    if c is None:
        return ""
    rows = [
        ["position, mm", *map(_four, (c.position_rms_mm, c.position_largest_mm))],
        ["velocity, mm/s", *map(_four, (c.velocity_rms_mm_s, c.velocity_largest_mm_s))],
    ]
    rows[0].append(_four(c.position_predicted_mm))
    rows[1].append(_four(c.velocity_predicted_mm_s))
    return text_table(["centroid", "RMS", "largest", "predicted"], rows)


def _four(value: float) -> str:
    return _n(value, 4)


def _found_text(truth: TruthComparison) -> str:
    lines = [
        f"measured {truth.measured} of {truth.visible} positions that two cameras could see; "
        f"{len(truth.wrong)} wrong, {len(truth.unknown)} points that are not in the truth"
    ]
    lines += [
        f"  wrong: stage {w.stage}, point {w.point_id}, {w.error_mm:.3f} mm off, sigma "
        f"{w.sigma_mm:.3f} mm, {w.cameras}"
        for w in truth.wrong[:_MAX_LISTED]
    ]
    points, counts = np.unique(truth.missing[:, 1], return_counts=True)
    order = np.argsort(-counts, kind="stable")[:_MAX_LISTED]
    if len(points):
        named = ", ".join(f"{points[i]} ({counts[i]})" for i in order)
        more = ", ..." if len(points) > _MAX_LISTED else ""
        lines.append(f"  missing: point (stages): {named}{more}")
    return "\n".join(lines) + "\n"
