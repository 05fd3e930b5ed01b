# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point cloud prepared for registration at several levels of detail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


#: Minimum ratio of the numbers of points of two levels that differ in resolution.
_MIN_RATIO = 2
#: Least number of points from which the median spacing is computed.
_SPACING_SAMPLE = 2000


class Level:
    """A cloud at one level of detail; normals and statistics are computed on first use."""

    def __init__(self, points_m: Float, normals_of: Callable[[Float], Float]) -> None:
        self.points_m = points_m
        self._normals_of = normals_of

    @cached_property
    def normals(self) -> Float:
        """Unit normals, shape (n, 3)."""
        return self._normals_of(self.points_m)

    @cached_property
    def spacing_m(self) -> float:
        """Median distance of a point to its nearest neighbour."""
        from cdff_common.geometry.kdtree import kd_tree, spacing

        return spacing(kd_tree(self.points_m), _SPACING_SAMPLE)

    def thinned(self, ratio: int) -> Level:
        """Return a level with about ``ratio`` times fewer points."""
        from cdff_common.geometry.voxels import downsampled

        return Level(downsampled(self.points_m, len(self.points_m) // ratio)[0], self._normals_of)

    @cached_property
    def centre_m(self) -> Float:
        """Mean of the points, shape (3,)."""
        return np.asarray(self.points_m.mean(axis=0))

    @cached_property
    def radius_m(self) -> float:
        """Root mean square distance of the points from their mean."""
        offset = self.points_m - self.centre_m
        return float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """The levels of a cloud, coarsest first."""

    levels: tuple[Level, ...]

    @property
    def points_m(self) -> Float:
        """Points (n, 3) of the finest level."""
        return self.levels[-1].points_m

    @property
    def is_thinned(self) -> bool:
        """True if the medium level has at most half the points of the fine one."""
        medium, fine = self.levels[-2:]
        return len(fine.points_m) >= _MIN_RATIO * len(medium.points_m)
