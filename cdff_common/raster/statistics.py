# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of the heights in each cell, and their exact pooling.

A cell holds the number of heights, their mean, the sum of squared differences from it (``m2``), the smallest,
the largest and the newest stamp. Pooling two cells gives the statistics of all their heights [1]_:

    n = na + nb,  d = mb - ma,  mean = ma + d nb / n,  m2 = m2a + m2b + d^2 na nb / n.

The last term is the disagreement of the two cells; without it two scans 0.3 m apart have the variance of one.
Pooling is associative and commutative (up to rounding), so the order of patches does not matter.

Each height may have its own variance, e.g. from the pose. It then represents a distribution, ``m2`` also
sums those variances, and ``variance = m2 / n`` is that of the mixture: by the law of total variance pooling
stays exact.

References
----------
.. [1] Chan, T. F., Golub, G. H., LeVeque, R. J. (1983). Algorithms for computing the sample variance.
   The American Statistician 37(3). doi:10.1080/00031305.1983.10483115, eq. 2.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry

#: ``newest_ns`` of a cell without measurement.
NEVER_NS = np.iinfo(np.int64).min
#: Layers of an elevation map, float32, NaN where unobserved.
ELEVATION_LAYERS = ("mean", "variance", "min", "max", "count", "age_s")
#: Largest rounding step of a height, in cells: a slope between neighbours is then exact to 6 degrees.
_MAX_ROUNDING_CELLS = 0.1

FloatGrid = NDArray[np.float64]
Arrays = tuple[FloatGrid, FloatGrid, FloatGrid, FloatGrid, FloatGrid, NDArray[np.int64]]


@dataclass(frozen=True, slots=True, eq=False)
class CellStatistics:
    """Statistics of a grid of cells, float64; arrays ``(rows, cols)``.

    Attributes
    ----------
    geometry : GridGeometry
    count : FloatGrid
        Number of heights; 0 where unobserved.
    mean : FloatGrid
        Mean height, metres; 0 where unobserved.
    m2 : FloatGrid
        Sum of squared differences from the mean and of the heights' own variances, square metres.
    minimum, maximum : FloatGrid
        Extreme heights, metres; +inf and -inf where unobserved.
    newest_ns : NDArray[np.int64]
        Stamp of the newest measurement; ``NEVER_NS`` where unobserved.
    """

    geometry: GridGeometry
    count: FloatGrid
    mean: FloatGrid
    m2: FloatGrid
    minimum: FloatGrid
    maximum: FloatGrid
    newest_ns: NDArray[np.int64]

    @classmethod
    def empty(cls, geometry: GridGeometry) -> CellStatistics:
        """Return a grid of unobserved cells."""
        shape = geometry.shape
        return cls(
            geometry,
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
            np.full(shape, np.inf),
            np.full(shape, -np.inf),
            np.full(shape, NEVER_NS, dtype=np.int64),
        )

    @classmethod
    def from_points(
        cls,
        geometry: GridGeometry,
        points_m: ArrayLike,
        *,
        stamps_ns: ArrayLike | int,
        height_variance_m2: ArrayLike | None = None,
    ) -> CellStatistics:
        """Return the statistics of points in the grid's frame; points outside the grid are ignored.

        Parameters
        ----------
        points_m : array_like, shape (n, 3)
            Metres; rows that are not finite are ignored.
        stamps_ns : int or array_like of int, shape (n,)
            Time of measurement.
        height_variance_m2 : array_like, shape (n,), optional
            Variance of each height that the sample variance in a cell does not include, square metres.

        Raises
        ------
        InputError
            If an array has the wrong shape, or a variance is below 0.
        """
        from cdff_common.raster._kernels import accumulate

        points = np.ascontiguousarray(points_m, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points_m: shape {points.shape}, expected (n, 3)")
        n = len(points)
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        variances = (
            np.zeros(1) if height_variance_m2 is None else np.asarray(height_variance_m2, dtype=np.float64)
        )
        if len(stamps) not in (1, n) or (height_variance_m2 is not None and variances.shape != (n,)):
            raise InputError(
                f"{n} points, stamps {stamps.shape}, variances {variances.shape}: expected 1 or {n} stamps and "
                f"{n} variances"
            )
        if height_variance_m2 is not None and np.any(variances < 0.0):
            raise InputError(f"height_variance_m2: smallest {variances.min():.3g}, expected none below 0")
        statistics = cls.empty(geometry)
        if n:
            accumulate(
                points,
                np.ascontiguousarray(stamps),
                np.ascontiguousarray(variances),
                geometry.resolution_m,
                geometry.left,
                geometry.top,
                geometry.cols,
                *statistics._flat,
            )
        return statistics

    @classmethod
    def from_layers(
        cls, geometry: GridGeometry, layers: Mapping[str, ArrayLike], t1_ns: int
    ) -> CellStatistics:
        """Return the statistics of layers, the inverse of ``to_layers``.

        A cell is observed if its count is above 0 and its mean finite.

        Raises
        ------
        InputError
            If a layer is missing or has another shape than the grid, or float32 rounds the heights.
        """
        arrays = checked_layers(geometry, layers, ELEVATION_LAYERS)
        observed = np.flatnonzero(np.isfinite(arrays["mean"]) & (arrays["count"] > 0))
        _check_rounding(arrays["mean"].reshape(-1)[observed], geometry.resolution_m)
        values = {name: arrays[name].reshape(-1)[observed].astype(np.float64) for name in ELEVATION_LAYERS}
        result = cls.empty(geometry)
        result.count.reshape(-1)[observed] = values["count"]
        result.mean.reshape(-1)[observed] = values["mean"]
        result.m2.reshape(-1)[observed] = values["variance"] * values["count"]
        result.minimum.reshape(-1)[observed] = values["min"]
        result.maximum.reshape(-1)[observed] = values["max"]
        result.newest_ns.reshape(-1)[observed] = t1_ns - np.rint(np.nan_to_num(values["age_s"]) * 1e9).astype(
            np.int64
        )
        return result

    def to_layers(self, t1_ns: int) -> dict[str, NDArray[np.float32]]:
        """Return the layers, float32, NaN where unobserved; ``age_s`` refers to ``t1_ns``.

        Raises InputError if float32 rounds the heights.
        """
        from cdff_common.raster._kernels import fill_layers

        _check_rounding(self.mean[self.observed], self.geometry.resolution_m)
        stack = np.empty((len(ELEVATION_LAYERS), *self.geometry.shape), dtype=np.float32)
        fill_layers(*self._flat, t1_ns, stack.reshape(len(stack), -1))
        return dict(zip(ELEVATION_LAYERS, stack, strict=True))

    @property
    def arrays(self) -> Arrays:
        """The six arrays, in the order of the fields."""
        return self.count, self.mean, self.m2, self.minimum, self.maximum, self.newest_ns

    @property
    def _flat(self) -> Arrays:
        count, mean, m2, minimum, maximum, newest = self.arrays
        floats = (count.reshape(-1), mean.reshape(-1), m2.reshape(-1))
        return (*floats, minimum.reshape(-1), maximum.reshape(-1), newest.reshape(-1))

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Cells with a measurement, shape (rows, cols)."""
        return np.asarray(self.count > 0, dtype=np.bool_)

    @property
    def variance(self) -> FloatGrid:
        """``m2 / count``, square metres; NaN where unobserved."""
        observed = self.observed
        return np.where(observed, self.m2 / np.where(observed, self.count, 1.0), np.nan)

    def add(self, other: CellStatistics) -> None:
        """Pool ``other`` into this grid in place; cells outside this grid are ignored.

        Raises
        ------
        InputError
            If the two grids differ in frame or cell size.
        """
        common = self.geometry.intersection(other.geometry)
        if common is None:
            return
        mine, theirs = self.geometry.slices_of(common), other.geometry.slices_of(common)
        na, nb = self.count[mine], other.count[theirs]
        n = na + nb
        share = np.divide(nb, n, out=np.zeros_like(n), where=n > 0)
        d = other.mean[theirs] - self.mean[mine]
        self.m2[mine] += other.m2[theirs] + d * d * na * share
        self.mean[mine] += d * share
        self.count[mine] = n
        np.minimum(self.minimum[mine], other.minimum[theirs], out=self.minimum[mine])
        np.maximum(self.maximum[mine], other.maximum[theirs], out=self.maximum[mine])
        np.maximum(self.newest_ns[mine], other.newest_ns[theirs], out=self.newest_ns[mine])

    def window(self, geometry: GridGeometry) -> CellStatistics:
        """Return a copy in another window of the same cells; cells outside this grid are unobserved."""
        result = CellStatistics.empty(geometry)
        common = self.geometry.intersection(geometry)
        if common is not None:
            there, here = geometry.slices_of(common), self.geometry.slices_of(common)
            for target, source in zip(result.arrays, self.arrays, strict=True):
                target[there] = source[here]
        return result

    def masked(self, keep: NDArray[np.bool_]) -> CellStatistics:
        """Return a copy in which only the cells of ``keep`` ``(rows, cols)`` are observed."""
        return CellStatistics(
            self.geometry,
            np.where(keep, self.count, 0.0),
            np.where(keep, self.mean, 0.0),
            np.where(keep, self.m2, 0.0),
            np.where(keep, self.minimum, np.inf),
            np.where(keep, self.maximum, -np.inf),
            np.where(keep, self.newest_ns, NEVER_NS),
        )


def _check_rounding(heights_m: NDArray[np.floating], resolution_m: float) -> None:
    """Raise InputError if heights (n,) are so large that float32 rounds them by more than the limit."""
    largest_m = min(float(np.abs(heights_m).max(initial=0.0)), float(np.finfo(np.float32).max))
    step_m, limit_m = np.spacing(np.float32(largest_m)), _MAX_ROUNDING_CELLS * resolution_m
    if step_m > limit_m:
        raise InputError(
            f"height {largest_m:.4g} m: float32 has steps of {step_m:.2g} m there, expected at most "
            f"{limit_m:.2g} m in cells of {resolution_m:g} m; use a datum near the terrain"
        )


def checked_layers(
    geometry: GridGeometry, layers: Mapping[str, ArrayLike], names: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Return layers by name; raises InputError if one is missing or has another shape than the grid."""
    arrays = {}
    for name in names:
        if name not in layers:
            raise InputError(f"elevation map without layer {name!r}; expected {', '.join(names)}")
        arrays[name] = np.asarray(layers[name])
        if arrays[name].shape != geometry.shape:
            raise InputError(f"layer {name}: shape {arrays[name].shape}, expected {geometry.shape}")
    return arrays
