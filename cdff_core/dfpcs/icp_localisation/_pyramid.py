# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A cloud prepared for registration: three levels of detail, whose normals are estimated where they are needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Level:
    """One level of detail.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
    normals_of : callable
        Unit normals (n, 3) of points.
    """

    def __init__(self, points_m: FloatArray, normals_of: Callable[[FloatArray], FloatArray]) -> None:
        self.points_m = points_m
        self._normals_of = normals_of

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals, shape (n, 3)."""
        return self._normals_of(self.points_m)

    @cached_property
    def spacing_m(self) -> float:
        """Median distance of a point to its nearest neighbour."""
        from cdff_common.geometry.kdtree import kd_tree, spacing

        return spacing(kd_tree(self.points_m))

    @cached_property
    def centre_m(self) -> FloatArray:
        """Mean of the points, shape (3,)."""
        return np.asarray(self.points_m.mean(axis=0))

    @cached_property
    def radius_m(self) -> float:
        """Root mean square distance of the points from their mean."""
        offset = self.points_m - self.centre_m
        return float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """The levels, coarsest first, and what they were made from.

    Attributes
    ----------
    levels : tuple of Level
    frame : str
    stamp_ns : int
    sample_id : str
    """

    levels: tuple[Level, ...]
    frame: str
    stamp_ns: int
    sample_id: str

    @property
    def fine(self) -> Level:
        """The finest level."""
        return self.levels[-1]
