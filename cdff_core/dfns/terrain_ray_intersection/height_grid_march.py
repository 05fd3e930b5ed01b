# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""First crossing of lines of sight with bilinearly interpolated heights.

References
----------
.. [1] Musgrave, F. K. (1988). Grid tracing: fast ray tracing for height fields. Yale University, RR-639.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.terrain_ray_intersection.interface import Inputs, Interface, Outputs

#: Step along a line of sight, cells.
_STEP_CELLS = 0.5


class HeightGridMarchConfig(DfnConfig):
    """Parameters of HeightGridMarch."""

    max_range_m: float = Field(500.0, gt=0.0, le=1e5, description="Largest range, m")
    max_unknown_m: float = Field(
        1.0, ge=0.0, le=100.0, description="Largest distance over unknown cells in front of the terrain, m"
    )


class HeightGridMarch(Interface[HeightGridMarchConfig]):
    """The height above the terrain is computed at steps of half a cell; its first change of sign is
    interpolated [1]_.

    The standard deviation is half the difference of the ranges of the directions that are one standard
    deviation higher and lower, plus that of the height of the cell.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return range and standard deviation of each line of sight."""
        n = len(inputs.directions)
        ranges, sigmas = np.full(n, np.nan), np.full(n, np.nan)
        for i in range(n):
            u, tilt = inputs.directions[i], float(inputs.elevation_sigmas[i])
            ranges[i] = self._range(inputs, u)
            if not np.isfinite(ranges[i]):
                continue
            high, low = (self._range(inputs, _tilt_direction(u, angle)) for angle in (tilt, -tilt))
            spread = [abs(r - ranges[i]) for r in (high, low) if np.isfinite(r)]
            # A higher direction that misses the terrain leaves the range unbounded.
            by_angle = max(spread) if len(spread) == 2 else self.config.max_range_m
            sigmas[i] = np.hypot(by_angle, self._by_height(inputs, u, float(ranges[i]), by_angle, tilt))
        return Outputs(ranges=ranges, sigmas=sigmas)

    def _range(self, inputs: Inputs, u: FloatArray) -> float:
        """Return the range at which a ray along ``u`` (3,) meets the terrain, metres; NaN without an
        intersection.
        """
        step = _STEP_CELLS * inputs.resolution
        across = float(np.hypot(u[0], u[1]))
        if across < 1e-6:
            return float("nan")
        t = np.arange(step, self.config.max_range_m, step / across)
        points = inputs.origin + t[:, None] * u
        ground = _heights(inputs.heights, inputs.corner, inputs.resolution, points)
        above = points[:, 2] - ground
        hit = np.flatnonzero(above <= 0.0)
        if len(hit) == 0:
            return float("nan")
        k = int(hit[0])
        known = np.isfinite(above[:k])
        # Cells below the camera are often unknown: the last ones before the terrain must be known.
        reach = int(np.ceil(self.config.max_unknown_m / step))
        if k == 0 or not known[max(k - reach, 0) :].any():
            return float("nan")
        last = int(np.flatnonzero(known)[-1])
        fraction = above[last] / (above[last] - above[k])
        return float(t[last] + fraction * (t[k] - t[last]))

    def _by_height(
        self, inputs: Inputs, u: FloatArray, range_m: float, by_angle: float, tilt: float
    ) -> float:
        """Return the standard deviation of the range due to the height of the terrain."""
        if inputs.variances is None:
            return 0.0
        point = (inputs.origin + range_m * u)[None]
        variance = float(_heights(inputs.variances, inputs.corner, inputs.resolution, point)[0])
        if not (np.isfinite(variance) and variance > 0.0):
            return 0.0
        # A difference of height is a difference of elevation at this range.
        return by_angle * float(np.sqrt(variance)) / (range_m * tilt)


def _tilt_direction(u: FloatArray, angle: float) -> FloatArray:
    """Return a direction whose elevation is larger by an angle."""
    across = np.hypot(u[0], u[1])
    elevation = np.arctan2(u[2], across) + angle
    return np.array([*(u[:2] / across * np.cos(elevation)), np.sin(elevation)])


def _heights(cells: FloatArray, corner: FloatArray, resolution: float, points: FloatArray) -> FloatArray:
    """Return values at points, interpolated between the centres of cells; NaN outside or next to NaN."""
    rows, cols = cells.shape
    x = (points[:, 0] - corner[0]) / resolution - 0.5
    y = (corner[1] - points[:, 1]) / resolution - 0.5
    inside = (x >= 0.0) & (y >= 0.0) & (x <= cols - 1) & (y <= rows - 1)
    j = np.clip(np.floor(x).astype(int), 0, max(cols - 2, 0))
    i = np.clip(np.floor(y).astype(int), 0, max(rows - 2, 0))
    a, b = x - j, y - i
    i1, j1 = np.minimum(i + 1, rows - 1), np.minimum(j + 1, cols - 1)
    top = cells[i, j] * (1.0 - a) + cells[i, j1] * a
    bottom = cells[i1, j] * (1.0 - a) + cells[i1, j1] * a
    return np.where(inside, top * (1.0 - b) + bottom * b, np.nan)
