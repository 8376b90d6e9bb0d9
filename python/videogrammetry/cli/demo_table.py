"""The demo's table: paper, this run, truth; and what was lost."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from videogrammetry.accuracy import ErrorStatistics, ScaleBarTest, reprojection_statistics
from videogrammetry.cli.common import text_table
from videogrammetry.cli.demo_run import ACROSS, BAR, TYRE, DemoResults
from videogrammetry.report import ComparisonRow


def comparison_rows(results: DemoResults) -> list[ComparisonRow]:
    """All rows, as the page and the terminal show them."""
    return [
        *_calibration_rows(results),
        *_bar_rows(results, BAR, "within a pair"),
        *_bar_rows(results, ACROSS, "across the pairs"),
        *_tyre_rows(results),
        *_fall_rows(results),
        *_time_rows(results),
    ]


def _calibration_rows(results: DemoResults) -> list[ComparisonRow]:
    run = results.calibration
    used = run.observations.used
    s = reprojection_statistics(run.observations.residual_px[used], redundancy=run.redundancy)
    cameras, true = run.rig.cameras, results.truth_rig.cameras
    rows = [
        ComparisonRow(
            quantity="re-projection, mean distance",
            paper="< 0.05 px",
            run=f"{s.mean_distance_px:.4f} px",
            note="mean length of the residual vectors",
        ),
        ComparisonRow(
            quantity="re-projection, RMS of a coordinate",
            run=f"{s.rms_coordinate_px:.4f} px",
            note="the same residuals, per image coordinate",
        ),
        ComparisonRow(
            quantity="sigma0",
            paper="0.156 px",
            run=f"{s.sigma0_px:.4f} px",
            note="the same residuals, redundancy counted: the paper prints it beside a three times "
            "smaller mean distance, which normal errors do not allow",
        ),
        ComparisonRow(
            quantity="sigma0 over what recognition predicted",
            run=f"{run.sigma0:.3f}",
            truth="1",
            note="each target's own covariance as weight",
        ),
    ]
    names = list(cameras)
    note = (
        "a camera's distance and its f compensate each other, at 12 m almost wholly: points, not "
        "cameras, are what is determined"
    )
    for (a, b), remark in ((names[:2], note), (names[2:4], "")):
        measured = float(np.linalg.norm(cameras[a].centre_mm - cameras[b].centre_mm))
        exact = float(np.linalg.norm(true[a].centre_mm - true[b].centre_mm))
        rows.append(
            ComparisonRow(
                quantity=f"distance of {a} and {b}",
                paper=f"{exact:.1f} mm",
                run=f"{measured:.3f} mm",
                truth=f"{exact:.3f} mm",
                note=remark,
            )
        )
    return rows


def _bar_rows(results: DemoResults, name: str, kind: str) -> list[ComparisonRow]:
    check = results.scenes[name].verification
    bars = check.scale_bars
    if bars is None or not len(bars):
        return [ComparisonRow(quantity=f"scale bar {kind}", run="no length measured")]
    total = bars.total
    rows = [
        ComparisonRow(
            quantity=f"scale bar {kind}: lengths",
            paper="11" if name == BAR else "none",
            run=str(total.count),
            note=_cameras_of(bars),
        ),
        ComparisonRow(
            quantity="  mean error (bias)",
            paper="+0.217 mm" if name == BAR else "",
            run=f"{total.mean_mm:+.3f} mm",
            truth="0",
            note=f"predicted: 0 +- {total.mean_sigma_mm:.3f} mm",
        ),
        ComparisonRow(
            quantity="  standard deviation",
            paper="0.235 mm" if name == BAR else "",
            run=f"{total.sd_mm:.3f} mm",
            note='what the paper prints as "RMS"' if name == BAR else "",
        ),
        ComparisonRow(
            quantity="  RMS error",
            paper="0.312 mm" if name == BAR else "",
            run=f"{total.rms_mm:.3f} mm",
            note=f"predicted {total.predicted_mm:.3f} mm; ratio {total.ratio:.2f}",
        ),
        ComparisonRow(
            quantity="  largest error",
            paper="+0.545 mm" if name == BAR else "",
            run=f"{total.largest_mm:+.3f} mm",
        ),
    ]
    return [*rows, *_calibration_alone_rows(results, name, bars)]


def _cameras_of(bars: ScaleBarTest) -> str:
    return "; ".join(f"{s.name}: {s.count}" for s in bars.by_cameras)


def _calibration_alone_rows(
    results: DemoResults, name: str, bars: ScaleBarTest
) -> list[ComparisonRow]:
    """What exact pictures would still give, with this calibration and with the paper's."""
    errors = results.scenes[name].verification.scale_bar_rig_error_mm
    if errors is None:
        return []
    rms = float(np.sqrt(np.nanmean(errors**2)))
    predicted = float(np.sqrt(np.mean(bars.sigma_rig_mm**2)))
    return [
        ComparisonRow(
            quantity="  RMS from the calibration alone",
            run=f"{rms:.3f} mm",
            note=f"exact pictures; predicted {predicted:.3f} mm, ratio {rms / predicted:.2f} (one "
            "draw)",
        ),
        ComparisonRow(
            quantity="  the same with the paper's method",
            run=f"{results.bar_error_paper_mm[name]:.3f} mm",
            note="each camera by itself, mean of the poses (Eqs. 7-8), same pictures",
        ),
    ]


def _tyre_rows(results: DemoResults) -> list[ComparisonRow]:
    scene = results.scenes[TYRE]
    check = scene.verification.truth
    assert check is not None
    measurement = scene.measurement
    moved = np.linalg.norm(measurement.motion.displacement_mm, axis=2)
    rows = [
        ComparisonRow(
            quantity="tyre: points in one frame",
            paper="4-11, 21-30",
            run=_ranges(measurement.trajectories.point_id.tolist()),
            truth="4-11, 21-30",
            note=f"{check.measured} of {check.visible} positions that two cameras could see",
        ),
        _error_row("  3-D RMS error", check.total),
        *(_error_row(f"    by {group.name}", group) for group in check.groups),
        ComparisonRow(
            quantity="  largest displacement",
            run=f"{np.nanmax(moved):.2f} mm" if np.isfinite(moved).any() else "-",
            truth=f"{_largest_displacement(results):.2f} mm",
            note="against stage 1",
        ),
    ]
    c = check.centroid
    if c is not None and np.isfinite(c.velocity_rms_mm_s):
        rows.append(
            ComparisonRow(
                quantity="  centroid's velocity, RMS error",
                run=f"{c.velocity_rms_mm_s:.2f} mm/s",
                truth="0",
                note=f"predicted {c.velocity_predicted_mm_s:.2f} mm/s; central differences on "
                "both sides",
            )
        )
    return rows


def _largest_displacement(results: DemoResults) -> float:
    """Of the true points, against the first stage, mm."""
    scene = results.tyre
    rows = scene.marks.is_target
    times = [scene.time_s(stage) for stage in range(1, scene.num_stages + 1)]
    places = np.array([scene.place(t).centre_mm[rows] for t in times])
    return float(np.linalg.norm(places - places[0], axis=2).max())


def _error_row(quantity: str, errors: ErrorStatistics) -> ComparisonRow:
    return ComparisonRow(
        quantity=quantity,
        run=f"{errors.rms_mm:.3f} mm",
        truth="0",
        note=f"predicted {errors.predicted_mm:.3f} mm, ratio {errors.ratio:.2f}; normalised by "
        f"each covariance {errors.normalised_rms:.2f}; largest {errors.largest_mm:.2f} mm",
    )


def _fall_rows(results: DemoResults) -> list[ComparisonRow]:
    fall = results.scenes[TYRE].verification.free_fall
    if fall is None:
        return []
    line, fit = fall.regression, fall.fit
    return [
        ComparisonRow(
            quantity="free fall: slope of the line",
            paper="1.0188",
            run=f"{line.slope:.5f}",
            truth="1",
            note="y = -g t^2/2 over x = measured fall of the mean of the points",
        ),
        ComparisonRow(
            quantity="  offset", paper="0.9643 mm", run=f"{line.offset_mm:+.4f} mm", truth="0"
        ),
        ComparisonRow(
            quantity="  measured falls short by",
            paper="1.85 %",
            run=f"{line.short_percent:+.4f} %",
            truth="0",
            note="1 - 1/slope; the paper's text says 1.88 %",
        ),
        ComparisonRow(
            quantity="  acceleration",
            run=f"{fit.g_m_s2:.5f} +- {fit.sigma_m_s2:.5f} m/s^2",
            truth=f"{fall.gravity_m_s2:.5f} m/s^2",
            note=f"fit of s0 + v0 t + a t^2/2, calibration in the sigma; off by "
            f"{fit.deviation_percent:+.4f} %, {fit.deviation_sigmas:+.1f} sigmas",
        ),
    ]


def _time_rows(results: DemoResults) -> list[ComparisonRow]:
    stages = results.options.size.stages
    seconds = results.scenes[TYRE].measure_s
    return [
        ComparisonRow(
            quantity="time to measure the tyre",
            run=f"{seconds:.1f} s",
            note=f"{4 * stages} pictures of 1024x1024, 12 bit: {1e3 * seconds / (4 * stages):.1f} "
            "ms each, all cores, from reading to motion (the paper: 1-2 s a picture of "
            "3888x2592)",
        ),
        ComparisonRow(
            quantity="time to calibrate",
            run=f"{results.seconds['calibrate']:.1f} s",
            note=f"{4 * results.options.size.orientations} pictures, recognition included, by this "
            "and by the paper's method",
        ),
    ]


def _ranges(numbers: Sequence[int]) -> str:
    """Numbers in short.

    Examples
    --------
    >>> _ranges([4, 5, 6, 21, 30, 31])
    '4-6, 21, 30-31'
    """
    parts: list[list[int]] = []
    for n in sorted(numbers):
        if parts and n == parts[-1][1] + 1:
            parts[-1][1] = n
        else:
            parts.append([n, n])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in parts)


def losses(results: DemoResults) -> list[str]:
    """What was hidden, missing, not found or wrong, in sentences."""
    lines = []
    for name, scene in results.scenes.items():
        done, check = scene.simulated, scene.verification.truth
        if done.num_hidden:
            lines.append(f"{name}: {done.num_hidden} targets hidden, wholly or in part")
        if done.missing:
            where = ", ".join(f"{stage} ({camera})" for stage, camera in done.missing.items())
            lines.append(f"{name}: empty pictures at the stages {where}")
        if check is not None and check.measured < check.visible:
            lines.append(
                f"{name}: {check.visible - check.measured} of {check.visible} positions that two "
                "cameras could see were not measured"
            )
        if check is not None and check.wrong:
            worst = max(check.wrong, key=lambda w: w.error_mm)
            lines.append(
                f"{name}: {len(check.wrong)} positions beyond 6 sigmas + 0.5 mm, the worst "
                f"{worst.error_mm:.2f} mm (stage {worst.stage}, point {worst.point_id})"
            )
        lines += [f"{name}: {text}" for text in scene.measurement.warnings]
    return lines


def terminal_table(rows: Sequence[ComparisonRow]) -> str:
    """The rows as text, notes folded below where they would not fit."""
    table = text_table(
        ["", "paper", "this run", "truth"],
        [[row.quantity, row.paper, row.run, row.truth] for row in rows],
    ).splitlines()
    width = max(len(line) for line in table)
    lines = [table[0]]
    for line, row in zip(table[1:], rows, strict=True):
        notes = textwrap.wrap(row.note, 60) if row.note else [""]
        lines.append(f"{line.ljust(width)}   {notes[0]}".rstrip())
        lines += [" " * (width + 3) + note for note in notes[1:]]
    return "\n".join(lines) + "\n"
