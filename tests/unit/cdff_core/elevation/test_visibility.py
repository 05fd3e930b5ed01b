# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rays that pass below the lowest height of a cell, twice and later, clear it."""

from __future__ import annotations

import numpy as np

from cdff_core.elevation.visibility import _lowest_rays

Array = np.ndarray
RESOLUTION_M, XMIN_M, YMAX_M = 0.5, -1.0, 4.0


def two_lowest(rays: Array, shape: tuple[int, int], before: int) -> tuple[Array, Array]:
    """Return the two lowest heights of the rays over each cell, sampled at the middles of equal steps."""
    samples: dict[tuple[int, int], list[float]] = {}
    for ray in rays:
        start, end = ray[:3], ray[3:]
        steps = int(np.linalg.norm(end[:2] - start[:2]) / RESOLUTION_M)
        for k in range(steps - before):
            x, y, z = start + (k + 0.5) / steps * (end - start)
            cell = int(np.floor((YMAX_M - y) / RESOLUTION_M)), int(np.floor((x - XMIN_M) / RESOLUTION_M))
            samples.setdefault(cell, []).append(z)
    lowest, second = np.full(shape, np.inf), np.full(shape, np.inf)
    for (row, col), heights in samples.items():
        if 0 <= row < shape[0] and 0 <= col < shape[1]:
            heights = [*sorted(heights), np.inf]
            lowest[row, col], second[row, col] = heights[:2]
    return lowest, second


def test_each_cell_has_the_heights_of_its_two_lowest_rays() -> None:
    rng = np.random.default_rng(1)
    rays = np.column_stack([rng.uniform(-2.0, 5.0, (40, 2)), rng.normal(size=40),
                            rng.uniform(-2.0, 5.0, (40, 2)), rng.normal(size=40)])  # fmt: skip
    rays[0, 3:5] = rays[0, :2]  # vertical
    for before in (0, 3):
        lowest, second = np.full((9, 11), np.inf), np.full((9, 11), np.inf)
        _lowest_rays(rays, RESOLUTION_M, XMIN_M, YMAX_M, before, lowest, second)
        expected = two_lowest(rays, (9, 11), before)
        np.testing.assert_allclose(lowest, expected[0], rtol=1e-12)
        np.testing.assert_allclose(second, expected[1], rtol=1e-12)
        assert np.isfinite(second).any()
