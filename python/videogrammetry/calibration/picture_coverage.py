"""Where in the picture a camera saw points, and what is left in their residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.types import FloatArray

#: Names of the ninths of a picture, row by row.
NINTHS = (
    *("top left", "top", "top right"),
    *("left", "middle", "right"),
    *("bottom left", "bottom", "bottom right"),
)
#: Cells along a third of the picture's longer side: the share of its area is counted in them.
CELLS = 3
#: A mean of fewer residuals says little.
_FEWEST = 5


@dataclass(frozen=True, kw_only=True)
class PictureCoverage:
    """Used points over the picture: ``cells`` and ``ninths`` (3, 3) are counts, row by row.

    ``share``: part of the picture's area (of the cells) that holds points.
    """

    cells: npt.NDArray[np.int64]
    ninths: npt.NDArray[np.int64]

    @property
    def share(self) -> float:
        """Part of the cells with points, 0...1."""
        return float((self.cells > 0).mean())

    @property
    def empty(self) -> tuple[str, ...]:
        """Names of the ninths without a point."""
        return tuple(NINTHS[i] for i in np.flatnonzero(self.ninths.ravel() == 0))


def picture_coverage(image_size_px: tuple[int, int], xy_px: FloatArray) -> PictureCoverage:
    """Counts of points (N, 2) over a picture.

    Examples
    --------
    >>> coverage = picture_coverage((90, 60), np.array([[5.0, 5.0], [6.0, 5.0], [80.0, 50.0]]))
    >>> coverage.ninths.tolist(), coverage.empty[:2], coverage.cells.shape
    ([[2, 0, 0], [0, 0, 0], [0, 0, 1]], ('top', 'top right'), (6, 9))
    """
    width, height = image_size_px
    long = max(width, height)
    # Whole cells in each ninth, or the ninths' edges would cut through cells.
    cells = tuple(3 * max(1, round(CELLS * side / long)) for side in (height, width))
    both = []
    for shape in (cells, (3, 3)):
        counts = np.histogram2d(
            xy_px[:, 1] + 0.5, xy_px[:, 0] + 0.5, bins=shape, range=((0, height), (0, width))
        )[0]
        both.append(counts.astype(np.int64))
    return PictureCoverage(cells=both[0], ninths=both[1])


@dataclass(frozen=True, kw_only=True)
class RadialProfile:
    """Residuals in rings around the principal point, arrays of length K.

    ``radius_px``: mean radius; ``rms_px`` per coordinate; ``outward_px``: mean of the
    part along the radius, ``sigma_px`` its standard deviation; NaN in rings of few points.
    """

    radius_px: FloatArray
    rms_px: FloatArray
    outward_px: FloatArray
    sigma_px: FloatArray
    count: npt.NDArray[np.int64]


def radial_profile(
    xy_px: FloatArray, residual_px: FloatArray, centre_px: FloatArray, rings: int = 12
) -> RadialProfile:
    """Residuals (N, 2) of points (N, 2) in rings of equal width around a point (2,).

    Examples
    --------
    >>> xy = np.array([[10.0, 0], [0, 10], [-10, 0], [0, -10], [6, 8]])
    >>> profile = radial_profile(xy, 0.01 * xy, np.zeros(2), rings=1)
    >>> profile.outward_px.round(6).tolist(), profile.count.tolist()
    ([0.1], [5])
    """
    from_centre = xy_px - centre_px
    radius = np.hypot(*from_centre.T)
    outward = outward_px(from_centre, residual_px)
    edge = float(radius.max()) if len(radius) else 1.0
    ring = np.minimum((radius / (edge or 1.0) * rings).astype(int), rings - 1)
    count = np.bincount(ring, minlength=rings)
    safe = np.where(count >= _FEWEST, count, np.nan)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(ring, weights=values, minlength=rings) / safe)

    middle = mean(outward)
    scatter = np.maximum(mean(outward**2) - middle**2, 0.0)
    return RadialProfile(
        radius_px=mean(radius),
        rms_px=np.sqrt(mean((residual_px**2).mean(axis=1))),
        outward_px=middle,
        sigma_px=np.sqrt(scatter / np.maximum(safe - 1, 1)),
        count=count,
    )


def outward_px(from_centre_px: FloatArray, residual_px: FloatArray) -> FloatArray:
    """(N,) part of residuals (N, 2) along the radius, positive outwards."""
    radius = np.maximum(np.hypot(*from_centre_px.T), 1e-12)
    return np.asarray((from_centre_px * residual_px).sum(axis=1) / radius)


def evenly_over_picture(xy_px: FloatArray, most: int) -> npt.NDArray[np.int64]:
    """Rows of at most ``most`` points (N, 2), thinned where they are dense.

    A point in turn of each occupied cell of a fine grid, so that sparse corners stay.

    Examples
    --------
    >>> dense = np.stack([np.linspace(0, 1, 50), np.zeros(50)], axis=1)
    >>> rows = evenly_over_picture(np.concatenate([dense, [[100.0, 100.0]]]), 10)
    >>> len(rows), 50 in rows
    (10, True)
    """
    if len(xy_px) <= most:
        return np.arange(len(xy_px))
    low, high = xy_px.min(axis=0), xy_px.max(axis=0)
    side = max(1, int(np.sqrt(most)))
    cell = np.minimum(((xy_px - low) / np.maximum(high - low, 1e-9) * side).astype(int), side - 1)
    key = cell[:, 0] * side + cell[:, 1]
    order = np.argsort(key, kind="stable")
    begin = np.searchsorted(key[order], key[order], side="left")
    turn = np.empty(len(key), np.int64)
    turn[order] = np.arange(len(key)) - begin
    return np.sort(np.argsort(turn, kind="stable")[:most])
