"""Known lengths, measured: errors, what was predicted, and what VDI/VDE 2634 asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.accuracy.acceptance import AcceptanceCheck, acceptance_checks
from videogrammetry.accuracy.calibration_part import CalibrationPart
from videogrammetry.motion.motion import velocity
from videogrammetry.types import FloatArray, IntArray, Trajectories, matrix_from_cov6

_MAX_CLASSES = 4
_MIN_PER_CLASS = 5


@dataclass(frozen=True, kw_only=True)
class KnownLength:
    """A calibrated distance between two points, at the temperature of the measurement."""

    point_a: int
    point_b: int
    length_mm: float
    sigma_mm: float


@dataclass(frozen=True, kw_only=True)
class LengthStatistics:
    """Errors measured - calibrated of a set of lengths.

    Attributes
    ----------
    name, count : which lengths, and how many.
    mean_mm : the bias. ``mean_sigma_mm``: its predicted standard deviation with
        all correlations: the calibration and the bar's own error do not average
        out, the image noise does.
    sd_mm : sample standard deviation about the mean (n - 1): what the paper
        prints as "RMS". ``rms_mm``: sqrt(mean(error^2)), the true RMS.
    largest_mm : the error with the largest magnitude, signed.
    predicted_mm : sqrt(mean(sigma^2)) of the predicted standard deviations.
    ratio : rms_mm / predicted_mm; about 1 if the prediction holds. With one
        calibration behind all lengths its scatter is that of a few numbers.
    """

    name: str
    count: int
    mean_mm: float
    mean_sigma_mm: float
    sd_mm: float
    rms_mm: float
    largest_mm: float
    predicted_mm: float
    ratio: float


@dataclass(frozen=True, kw_only=True)
class ScaleBarTest:
    """Known lengths over the stages; arrays of one row a bar and stage.

    Attributes
    ----------
    bars : the known lengths. not_measured : indices of bars never measured whole.
    bar : (N,) index into ``bars``. stage, time_s : (N,).
    end_a_mm, end_b_mm : (N, 3).
    length_mm, error_mm : (N,) measured, and measured - calibrated.
    sigma_mm : (N,) predicted standard deviation of the error: image noise,
        calibration (with the correlation of both ends) and the bar's own.
    sigma_image_mm, sigma_rig_mm : (N,) the parts of noise and calibration alone;
        the latter 0 where the rig has no covariance.
    speed_mm_s : (N,) of the bar's middle, central differences; NaN at gaps.
    cameras : (N,) cameras of the two ends, "cam1+cam2 | cam3+cam4".
    total : statistics of all; by_bar, by_cameras, by_speed : of the parts.
    acceptance : what VDI/VDE 2634-1 asks for, and whether this set has it.
    """

    bars: tuple[KnownLength, ...]
    not_measured: tuple[int, ...]
    bar: IntArray
    stage: IntArray
    time_s: FloatArray
    end_a_mm: FloatArray
    end_b_mm: FloatArray
    length_mm: FloatArray
    error_mm: FloatArray
    sigma_mm: FloatArray
    sigma_image_mm: FloatArray
    sigma_rig_mm: FloatArray
    speed_mm_s: FloatArray
    cameras: tuple[str, ...]
    total: LengthStatistics
    by_bar: tuple[LengthStatistics, ...]
    by_cameras: tuple[LengthStatistics, ...]
    by_speed: tuple[LengthStatistics, ...]
    acceptance: tuple[AcceptanceCheck, ...]

    def __len__(self) -> int:
        return len(self.error_mm)


def length_statistics(
    error_mm: npt.ArrayLike,
    sigma_mm: npt.ArrayLike | None = None,
    *,
    mean_sigma_mm: float = float("nan"),
    name: str = "all",
) -> LengthStatistics:
    """Statistics of errors (N,), N >= 1; ``sigma_mm`` (N,) predicted.

    Examples
    --------
    The errors of eleven measured lengths of one bar that Hu et al. (2012) print,
    with "RMS: 0.235", which is their standard deviation of unrounded lengths:

    >>> printed = [0.279, 0.309, 0.257, 0.279, 0.367, 0.388, 0.545, 0.348, -0.113, -0.102, -0.170]
    >>> s = length_statistics(printed)
    >>> [round(v, 3) for v in (s.mean_mm, s.sd_mm, s.rms_mm, s.largest_mm)]
    [0.217, 0.236, 0.312, 0.545]
    """
    error = np.asarray(error_mm, dtype=float)
    if error.ndim != 1 or not len(error):
        raise ValueError(f"error_mm: expected (N,) with one error or more, got {error.shape}")
    rms = float(np.sqrt((error**2).mean()))
    predicted = float("nan")
    if sigma_mm is not None:
        predicted = float(np.sqrt((np.asarray(sigma_mm, dtype=float) ** 2).mean()))
    return LengthStatistics(
        name=name,
        count=len(error),
        mean_mm=float(error.mean()),
        mean_sigma_mm=mean_sigma_mm,
        sd_mm=float(error.std(ddof=1)) if len(error) > 1 else float("nan"),
        rms_mm=rms,
        largest_mm=float(error[np.abs(error).argmax()]),
        predicted_mm=predicted,
        ratio=rms / predicted if predicted > 0 else float("nan"),
    )


@dataclass(frozen=True, kw_only=True)
class _Rows:
    """Bars and stages as they are collected; ``effect`` (N, R) of the length."""

    bar: IntArray
    row: IntArray
    end_a_mm: FloatArray
    end_b_mm: FloatArray
    sigma_image_mm: FloatArray
    effect_mm: FloatArray
    speed_mm_s: FloatArray
    cameras: tuple[str, ...]


def check_scale_bars(
    trajectories: Trajectories,
    bars: Sequence[KnownLength],
    part: CalibrationPart,
    *,
    sigma_px: FloatArray | None = None,
) -> ScaleBarTest | None:
    """Measured lengths against known ones, at every stage where both ends were measured.

    With u the unit vector from end a to end b the length's error is
    u^T (dX_b - dX_a): the noise gives u^T (C_a + C_b) u, the calibration, whose
    errors both ends share, |u^T (B_b - B_a)|^2 (:class:`CalibrationPart`).

    Parameters
    ----------
    trajectories : the measured points.
    bars : known lengths that the calibration has not used.
    part : of the rig that measured, its cameras as in ``trajectories``.
    sigma_px : (S, P, C) weights of the sightings; None: all alike.

    Returns
    -------
    None if no bar was measured at any stage.
    """
    collected = [
        _collect(trajectories, index, bar, part, sigma_px) for index, bar in enumerate(bars)
    ]
    parts = [rows for rows in collected if rows is not None]
    if not parts:
        return None
    rows = _joined(parts)
    nominal = np.array([bar.length_mm for bar in bars])[rows.bar]
    own = np.array([bar.sigma_mm for bar in bars])[rows.bar]
    length = np.linalg.norm(rows.end_b_mm - rows.end_a_mm, axis=1)
    error = length - nominal
    sigma_rig = np.linalg.norm(rows.effect_mm, axis=1)
    sigma = np.sqrt(rows.sigma_image_mm**2 + sigma_rig**2 + own**2)

    def of(chosen: npt.NDArray[np.bool_], name: str) -> LengthStatistics:
        return length_statistics(
            error[chosen],
            sigma[chosen],
            mean_sigma_mm=_mean_sigma(rows, own, chosen),
            name=name,
        )

    everything = np.ones(len(error), dtype=bool)
    measured = np.unique(rows.bar).tolist()
    groups = list(dict.fromkeys(rows.cameras))
    return ScaleBarTest(
        bars=tuple(bars),
        not_measured=tuple(i for i in range(len(bars)) if i not in measured),
        bar=rows.bar,
        stage=trajectories.stage[rows.row],
        time_s=trajectories.time_s[rows.row],
        end_a_mm=rows.end_a_mm,
        end_b_mm=rows.end_b_mm,
        length_mm=length,
        error_mm=error,
        sigma_mm=sigma,
        sigma_image_mm=rows.sigma_image_mm,
        sigma_rig_mm=sigma_rig,
        speed_mm_s=rows.speed_mm_s,
        cameras=rows.cameras,
        total=of(everything, "all"),
        by_bar=tuple(of(rows.bar == i, f"{bars[i].point_a}-{bars[i].point_b}") for i in measured),
        by_cameras=tuple(of(np.array([c == g for c in rows.cameras]), g) for g in groups),
        by_speed=tuple(of(mask, name) for name, mask in speed_classes(rows.speed_mm_s)),
        acceptance=acceptance_checks(
            rows.end_a_mm, rows.end_b_mm, nominal, error, part.rig.volume_mm
        ),
    )


def _collect(
    table: Trajectories,
    index: int,
    bar: KnownLength,
    part: CalibrationPart,
    sigma_px: FloatArray | None,
) -> _Rows | None:
    """The stages where both ends of a bar were measured."""
    columns = [np.flatnonzero(table.point_id == end) for end in (bar.point_a, bar.point_b)]
    if not (len(columns[0]) and len(columns[1])):
        return None
    a, b = int(columns[0][0]), int(columns[1][0])
    ends = table.position_mm[:, [a, b]]
    row = np.flatnonzero(np.isfinite(ends).all(axis=(1, 2))).astype(np.int32)
    if not len(row):
        return None
    middle = ends.mean(axis=1)
    speed = np.linalg.norm(velocity(middle, np.zeros((len(middle), 6)), table.time_s)[0], axis=1)
    start, end = ends[row, 0], ends[row, 1]
    direction = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    noise = matrix_from_cov6(table.cov_image_mm2[row, a] + table.cov_image_mm2[row, b])
    effects = part.effects_at(table, row, np.array([a, b]), sigma_px)
    used = table.cameras_used[row][:, [a, b]]
    return _Rows(
        bar=np.full(len(row), index, dtype=np.int32),
        row=row,
        end_a_mm=start,
        end_b_mm=end,
        sigma_image_mm=np.sqrt(np.einsum("ni,nij,nj->n", direction, noise, direction)),
        effect_mm=np.einsum("ni,nir->nr", direction, effects[:, 1] - effects[:, 0]),
        speed_mm_s=speed[row],
        cameras=tuple(
            f"{camera_group(table.camera_names, u[0])} | {camera_group(table.camera_names, u[1])}"
            for u in used
        ),
    )


def camera_group(names: Sequence[str], used: npt.NDArray[np.bool_]) -> str:
    """The cameras that saw a point, joined by ``+``.

    Examples
    --------
    >>> camera_group(("left", "right", "top"), np.array([True, False, True]))
    'left+top'
    """
    return "+".join(name for name, there in zip(names, used.tolist(), strict=True) if there)


def _joined(parts: Sequence[_Rows]) -> _Rows:
    arrays = {
        name: np.concatenate([getattr(p, name) for p in parts])
        for name in _Rows.__dataclass_fields__
        if name != "cameras"
    }
    return _Rows(**arrays, cameras=tuple(c for p in parts for c in p.cameras))


def _mean_sigma(rows: _Rows, own: FloatArray, chosen: npt.NDArray[np.bool_]) -> float:
    """Standard deviation of the mean error: noise averages, calibration and bars do not."""
    n = int(chosen.sum())
    noise = float((rows.sigma_image_mm[chosen] ** 2).sum()) / n**2
    common = float((rows.effect_mm[chosen].mean(axis=0) ** 2).sum())
    bars, counts = np.unique(rows.bar[chosen], return_counts=True)
    of_bar = np.array([own[chosen][rows.bar[chosen] == b][0] for b in bars])
    return float(np.sqrt(noise + common + ((counts / n * of_bar) ** 2).sum()))


def speed_classes(speed_mm_s: FloatArray) -> list[tuple[str, npt.NDArray[np.bool_]]]:
    """At most four classes of speed with equal numbers of lengths, five or more each.

    Examples
    --------
    >>> [name for name, _ in speed_classes(np.linspace(0, 1000, 11))]
    ['0 to 500 mm/s', '500 to 1000 mm/s']
    """
    known = np.isfinite(speed_mm_s)
    count = min(_MAX_CLASSES, int(known.sum()) // _MIN_PER_CLASS)
    if count == 0:
        return []
    edges = np.quantile(speed_mm_s[known], np.linspace(0, 1, count + 1))
    place = np.clip(np.searchsorted(edges[1:-1], speed_mm_s, side="right"), 0, count - 1)
    return [
        (f"{edges[k]:.0f} to {edges[k + 1]:.0f} mm/s", mask)
        for k in range(count)
        if (mask := known & (place == k)).any()
    ]
