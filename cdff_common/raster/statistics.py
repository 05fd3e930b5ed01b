# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of the heights in each cell, and their exact pooling.

A cell holds the number of heights, their mean, the sum of squared differences from it (``m2``), the smallest, the
largest and the newest stamp. Pooling two cells gives what all their heights together would have given [1]_:

    n = na + nb,  d = mb - ma,  mean = ma + d nb / n,  m2 = m2a + m2b + d^2 na nb / n.

The last term is the disagreement between the two; without it two scans 0.3 m apart look as certain as one. Pooling is
associative and commutative (to rounding), so patches may come in any order.

Each height may carry a variance of its own (from the pose, say). It then stands for a distribution, ``m2`` also sums
those variances, and ``variance = m2 / n`` is that of the mixture: the law of total variance keeps pooling exact.

References
----------
.. [1] Chan, T. F., Golub, G. H., LeVeque, R. J. (1983). Algorithms for computing the sample variance. The American
   Statistician 37(3). doi:10.1080/00031305.1983.10483115, eq. 2.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry

#: ``newest_ns`` of a cell without measurement.
NEVER_NS = np.iinfo(np.int64).min
#: Layers of an elevation map, float32, NaN where unobserved (contract §7).
ELEVATION_LAYERS = ("mean", "variance", "min", "max", "count", "age_s")

FloatGrid = NDArray[np.float64]


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
        """All cells unobserved."""
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
        """Statistics of points in the grid's frame, in one compiled pass; points outside the window are left out.

        Parameters
        ----------
        points_m : array_like, shape (n, 3)
            Metres; rows that are not finite are left out.
        stamps_ns : int or array_like of int, shape (n,)
            When each was measured.
        height_variance_m2 : array_like, shape (n,), optional
            Variance of each height that the spread of the heights in a cell does not show, square metres.

        Raises
        ------
        InputError
            On arrays of the wrong shape, or a variance below 0.
        """
        from cdff_common.raster._kernels import accumulate

        points = np.ascontiguousarray(points_m, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points_m: shape {points.shape}, expected (n, 3)")
        n = len(points)
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        variances = np.zeros(1) if height_variance_m2 is None else np.asarray(height_variance_m2, dtype=np.float64)
        if len(stamps) not in (1, n) or (height_variance_m2 is not None and variances.shape != (n,)):
            raise InputError(f"{n} points, stamps {stamps.shape}, variances {variances.shape}: expected one of each")
        if height_variance_m2 is not None and np.any(variances < 0.0):
            raise InputError(f"height_variance_m2: smallest {variances.min():.3g}, expected none below 0")
        statistics = cls.empty(geometry)
        if n:
            accumulate(
                points, np.ascontiguousarray(stamps), np.ascontiguousarray(variances),
                geometry.resolution_m, geometry.left, geometry.top, geometry.cols,
                statistics.count.reshape(-1), statistics.mean.reshape(-1), statistics.m2.reshape(-1),
                statistics.minimum.reshape(-1), statistics.maximum.reshape(-1), statistics.newest_ns.reshape(-1),
            )  # fmt: skip
        return statistics

    @classmethod
    def from_layers(cls, geometry: GridGeometry, layers: Mapping[str, ArrayLike], t1_ns: int) -> CellStatistics:
        """Inverse of ``to_layers``; a cell counts as observed where count is above 0 and mean finite.

        Raises
        ------
        InputError
            If a layer is missing or has another shape than the grid.
        """
        arrays = {}
        for name in ELEVATION_LAYERS:
            if name not in layers:
                raise InputError(f"elevation map without layer {name!r}; expected {', '.join(ELEVATION_LAYERS)}")
            arrays[name] = np.asarray(layers[name])
            if arrays[name].shape != geometry.shape:
                raise InputError(f"layer {name}: shape {arrays[name].shape}, expected {geometry.shape}")
        seen = np.flatnonzero(np.isfinite(arrays["mean"]) & (arrays["count"] > 0))
        found = {name: arrays[name].reshape(-1)[seen].astype(np.float64) for name in ELEVATION_LAYERS}
        result = cls.empty(geometry)
        result.count.reshape(-1)[seen] = found["count"]
        result.mean.reshape(-1)[seen] = found["mean"]
        result.m2.reshape(-1)[seen] = found["variance"] * found["count"]
        result.minimum.reshape(-1)[seen] = found["min"]
        result.maximum.reshape(-1)[seen] = found["max"]
        result.newest_ns.reshape(-1)[seen] = t1_ns - np.rint(np.nan_to_num(found["age_s"]) * 1e9).astype(np.int64)
        return result

    def to_layers(self, t1_ns: int) -> dict[str, NDArray[np.float32]]:
        """The layers of contract §7, float32, NaN where unobserved; ``age_s`` counts back from ``t1_ns``."""
        from cdff_common.raster._kernels import fill_layers

        stack = np.empty((len(ELEVATION_LAYERS), *self.geometry.shape), dtype=np.float32)
        count, mean, m2 = self.count.reshape(-1), self.mean.reshape(-1), self.m2.reshape(-1)
        low, high, newest = self.minimum.reshape(-1), self.maximum.reshape(-1), self.newest_ns.reshape(-1)
        fill_layers(count, mean, m2, low, high, newest, t1_ns, stack.reshape(len(stack), -1))
        return dict(zip(ELEVATION_LAYERS, stack, strict=True))

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells hold a measurement."""
        return np.asarray(self.count > 0, dtype=np.bool_)

    @property
    def variance(self) -> FloatGrid:
        """``m2 / count``, square metres; NaN where unobserved."""
        seen = self.observed
        return np.where(seen, self.m2 / np.where(seen, self.count, 1.0), np.nan)

    @property
    def newest_stamp_ns(self) -> int | None:
        """Newest stamp of all cells, None for an empty grid."""
        newest = int(self.newest_ns.max())
        return None if newest == NEVER_NS else newest

    @property
    def oldest_stamp_ns(self) -> int | None:
        """Oldest of the cells' newest stamps, None for an empty grid."""
        seen = self.observed
        return int(self.newest_ns[seen].min()) if seen.any() else None

    def add(self, other: CellStatistics) -> None:
        """Pool ``other`` into this grid in place; what lies outside this grid is left out.

        Raises
        ------
        InputError
            If the two do not share cells.
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
        """A copy in another window of the same cells; cells outside this grid are unobserved there."""
        result = CellStatistics.empty(geometry)
        common = self.geometry.intersection(geometry)
        if common is not None:
            there, here = geometry.slices_of(common), self.geometry.slices_of(common)
            for name in ("count", "mean", "m2", "minimum", "maximum", "newest_ns"):
                getattr(result, name)[there] = getattr(self, name)[here]
        return result

    def masked(self, keep: NDArray[np.bool_]) -> CellStatistics:
        """A copy in which only the cells of ``keep`` ``(rows, cols)`` are observed."""
        return CellStatistics(
            self.geometry,
            np.where(keep, self.count, 0.0),
            np.where(keep, self.mean, 0.0),
            np.where(keep, self.m2, 0.0),
            np.where(keep, self.minimum, np.inf),
            np.where(keep, self.maximum, -np.inf),
            np.where(keep, self.newest_ns, NEVER_NS),
        )


def pool(first: CellStatistics, second: CellStatistics) -> CellStatistics:
    """Statistics of all measurements of both, on the smallest grid that holds both; raises InputError as ``add``."""
    result = first.window(first.geometry.union(second.geometry))
    result.add(second)
    return result
