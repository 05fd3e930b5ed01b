# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces for registration tests. Each call samples new points, so that two clouds share no point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def plane(rng: np.random.Generator, n: int = 4000, noise_m: float = 0.01) -> Points:
    """Return points of flat ground, 20 m × 20 m."""
    return np.c_[rng.uniform(-10, 10, (n, 2)), rng.normal(0, noise_m, n)]


def terrain(rng: np.random.Generator, n: int = 6000, noise_m: float = 0.01) -> Points:
    """Return points of non-periodic hills of 0.5 m height and 3 to 9 m wavelength, 20 m × 20 m."""
    xy = rng.uniform(-10, 10, (n, 2))
    x, y = xy.T
    z = (
        0.3 * np.sin(0.7 * x + 0.2 * y**2 / 5)
        + 0.2 * np.cos(1.3 * y + 0.3 * x)
        + 0.1 * np.sin(2.1 * x - 1.7 * y)
    )
    return np.c_[xy, z + rng.normal(0, noise_m, n)]


def corridor(rng: np.random.Generator, n: int = 4000, noise_m: float = 0.01) -> Points:
    """Return points of a floor and two walls along x, 30 m long: translation along x is unconstrained."""
    x = rng.uniform(-15, 15, n)
    across = rng.uniform(-3, 3, n)
    points = np.c_[x, across, np.zeros(n)]
    wall = rng.random(n) < 0.5
    points[wall, 2] = np.abs(across[wall])
    points[wall, 1] = 3.0 * np.sign(across[wall])
    return points + rng.normal(0, noise_m, (n, 3))
