# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a window being assembled knows of its cells, and how a map gets into it; ``mosaic`` checks the arguments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.raster import _kernels
from cdff_common.raster._further_kernels import pool_further, pool_further_moved
from cdff_common.raster.choice import Choice
from cdff_common.raster.further_layers import SUMS, FurtherLayers
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.statistics import CellStatistics

_NO_COVARIANCE: NDArray[np.float64] = np.zeros((6, 6))


@dataclass(slots=True, eq=False)
class Cells:
    """Statistics of cells, and what else is known of them once a map says it."""

    statistics: CellStatistics
    further: FurtherLayers | None = None

    def with_further(self) -> FurtherLayers:
        """The further layers; of what was pooled before the first map that has some they are unknown."""
        if self.further is None:
            self.further = FurtherLayers.unknown(self.statistics.geometry, self.statistics.observed)
        return self.further

    def add(self, part: Cells) -> None:
        """Pool a part of the window."""
        if part.further is not None:
            self.with_further().add(part.further)
        self.statistics.add(part.statistics)

    def take(self, here: tuple[slice, slice], part: Cells, choice: Choice) -> None:
        """Let the cells of a part replace those that it is chosen over."""
        mine, theirs = self.statistics, part.statistics
        if choice is Choice.NEWEST:
            better = theirs.newest_ns >= mine.newest_ns[here]
        elif choice is Choice.OLDEST:
            better = (mine.count[here] == 0) | (theirs.newest_ns < mine.newest_ns[here])
        else:
            better = (mine.count[here] == 0) | (_certainty(theirs) < _certainty(mine, here))
        self.replace(part, better & (theirs.count > 0), here)

    def replace(self, part: Cells, which: NDArray[np.bool_], here: Any = ...) -> None:
        """Put the flagged cells of a part in the place of those that are ``here``."""
        if part.further is not None:
            further = self.with_further()
            for name in SUMS:
                np.copyto(getattr(further, name)[here], getattr(part.further, name), where=which)
        for name in ("count", "mean", "m2", "minimum", "maximum", "newest_ns"):
            np.copyto(getattr(self.statistics, name)[here], getattr(part.statistics, name), where=which)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A map on its way into cells.

    Attributes
    ----------
    geometry : GridGeometry
    arrays : tuple of array
        The six layers.
    further : tuple of array or None
        Those of ``further_layers.SUMMED``; None where nothing of them is wanted or known yet.
    t1_ns : int
    factor : int or None
        Of ``mosaic.fitting_factor``; None for a map that is resampled.
    T_window_map : UncertainTransform or None
        Of a map in another frame.
    """

    geometry: GridGeometry
    arrays: tuple[Any, ...]
    further: tuple[Any, ...] | None
    t1_ns: int
    factor: int | None
    T_window_map: UncertainTransform | None

    def pool_into(self, cells: Cells, within: NDArray[np.float64]) -> None:
        """Pool all of it that lies in the cells."""
        g, window, s = self.geometry, cells.statistics.geometry, cells.statistics
        sums: tuple[Any, ...] = (s.count, s.mean, s.m2, s.minimum, s.maximum, s.newest_ns, within)
        known: tuple[Any, ...] = ()
        if self.further is not None:
            known = tuple(getattr(cells.with_further(), name) for name in SUMS)
        layers = (*self.arrays, *(self.further or ()))
        if self.factor is not None:
            offset = window.top * self.factor - g.top, g.left - window.left * self.factor
            _kernels.pool_layers(self.arrays, self.t1_ns, self.factor, *offset, *sums)
            if known:
                pool_further(layers, self.t1_ns, self.factor, *offset, *known)
            return
        T = self.T_window_map
        matrix: NDArray[np.float64] = np.eye(4) if T is None else np.ascontiguousarray(T.matrix)
        covariance = _NO_COVARIANCE
        if T is not None and T.covariance is not None:
            covariance = np.ascontiguousarray(T.covariance)
        there, here = (g.resolution_m, g.left, g.top), (window.resolution_m, window.left, window.top)
        _kernels.pool_moved(self.arrays, self.t1_ns, *there, matrix, covariance, *here, *sums)
        if known:
            pool_further_moved(layers, self.t1_ns, *there, matrix, covariance, *here, *known)


def _certainty(cells: CellStatistics, here: Any = ...) -> NDArray[np.float64]:
    """Variance to compare by: of one height without a variance of its own nothing is known."""
    count, m2 = cells.count[here], cells.m2[here]
    variance = m2 / np.where(count > 0, count, 1.0)
    return np.where((count <= 1.0) & (m2 == 0.0), np.inf, variance)
