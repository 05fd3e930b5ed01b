# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points of a surface with their normals, their roughness and a thinned copy."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cdff_core.cloud_matching.roughness import roughness_m

Float = NDArray[np.float64]

#: Ratio of the number of points of a surface to that of its thinned copy.
_COARSER = 3


class Surface:
    """Points of a surface; normals, roughness and the thinned copy are computed when they are first read.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        Points, metres.
    normals_of : callable
        Function that returns the unit normals (m, 3) of points (m, 3).
    """

    def __init__(self, points_m: Float, normals_of: Callable[[Float], Float]) -> None:
        self.points_m, self._normals_of = points_m, normals_of

    @cached_property
    def normals(self) -> Float:
        """Unit normals ``(n, 3)``."""
        return self._normals_of(self.points_m)

    @cached_property
    def roughness_m(self) -> float:
        """Standard deviation of distances of points from the planes of their neighbours, metres."""
        return roughness_m(self.points_m, self.normals)

    @cached_property
    def coarser(self) -> Surface:
        """The surface with a third of the points."""
        from cdff_common.geometry.voxels import downsampled

        return Surface(downsampled(self.points_m, len(self.points_m) // _COARSER)[0], self._normals_of)


def joint_roughness_m(first: Surface, second: Surface, range_resolution_m: float) -> float:
    """Return the standard deviation, metres, of the distances between surfaces with independent roughness.

    It is at least the range resolution of the sensor, which residuals of exact planes do not fall below.
    """
    return max(float(np.hypot(first.roughness_m, second.roughness_m)), range_resolution_m)
