# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hilly ground for localisation tests, with a map of its points and lidar scans at given poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3

Array = NDArray[np.float64]

#: Half the side length of the map.
HALF_M = 40.0


class Hills:
    """Ground as a sum of random waves of 2 to 30 m length; ``relief`` scales the heights."""

    def __init__(self, seed: int = 0, relief: float = 1.0) -> None:
        rng = np.random.default_rng(seed)
        length = np.exp(rng.uniform(np.log(2.0), np.log(30.0), 60))
        angle = rng.uniform(0, 2 * np.pi, 60)
        self._k = 2 * np.pi / length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        self._phase = rng.uniform(0, 2 * np.pi, 60)
        self._height = relief * 0.006 * length

    def height(self, xy: Array) -> Array:
        """Return the heights (n,) in metres at positions (n, 2)."""
        return np.cos(xy @ self._k.T + self._phase) @ self._height

    def map(self, rng: np.random.Generator, spacing_m: float = 0.25, noise_m: float = 0.005) -> Array:
        """Return points (n, 3) of the map in the site frame, one per cell of ``spacing_m`` on average."""
        n = round((2 * HALF_M / spacing_m) ** 2)
        xy = rng.uniform(-HALF_M, HALF_M, (n, 2))
        return np.column_stack([xy, self.height(xy) + rng.normal(0, noise_m, n)])

    def pose(self, x: float, y: float, heading_rad: float) -> Array:
        """Return ``T_site_base`` of a robot on the ground, z along the surface normal."""
        step_m = 0.5
        neighbours_xy = np.array([[x + step_m, y], [x - step_m, y], [x, y + step_m], [x, y - step_m]])
        z = self.height(neighbours_xy)
        normal = np.array([z[1] - z[0], z[3] - z[2], 2 * step_m])
        normal /= np.linalg.norm(normal)
        forward = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
        forward -= normal * (forward @ normal)
        forward /= np.linalg.norm(forward)
        R = np.column_stack([forward, np.cross(normal, forward), normal])
        return se3.transform(R, [x, y, float(z.mean())])

    def scan(
        self, rng: np.random.Generator, T_site_base: Array, n: int = 12_000, noise_m: float = 0.01
    ) -> Array:
        """Return ground points in the base frame, denser near the robot."""
        r, a = 1.0 + 17.0 * rng.random(n) ** 1.5, rng.uniform(-np.pi, np.pi, n)
        xy = T_site_base[:2, 3] + np.column_stack([r * np.cos(a), r * np.sin(a)])
        points = np.column_stack([xy, self.height(xy) + rng.normal(0, noise_m, n)])
        return se3.transform_points(se3.inverse(T_site_base), points)
