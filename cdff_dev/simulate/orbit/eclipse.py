# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Eclipse of the Sun by a spherical body, with penumbra.

Source: O. Montenbruck, E. Gill, Satellite Orbits, 2000, §3.4.2 (doi:10.1007/978-3-642-58351-3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.geometry.se3 import FloatArray

#: Radius of the photosphere (IAU 2015, resolution B3) and equatorial radius of the Earth (WGS 84), metres.
SUN_RADIUS_M, EARTH_RADIUS_M = 6.957e8, 6_378_137.0


def sunlit_fraction(
    positions_m: ArrayLike, sun_m: ArrayLike, body_radius_m: float = EARTH_RADIUS_M
) -> FloatArray:
    """Return the visible fraction (n,) of the Sun's disc, 0 in the umbra and 1 in full light.

    Parameters
    ----------
    positions_m : array_like (n, 3)
        Positions relative to the centre of the body, outside it.
    sun_m : array_like (n, 3) or (3,)
        Position of the Sun relative to the centre of the body, same axes.
    body_radius_m : float
    """
    positions = np.atleast_2d(np.asarray(positions_m, dtype=float))
    to_sun = np.asarray(sun_m, dtype=float) - positions
    sun_distances, distances = np.linalg.norm(to_sun, axis=1), np.linalg.norm(positions, axis=1)
    a = np.arcsin(np.minimum(SUN_RADIUS_M / sun_distances, 1.0))
    b = np.arcsin(np.minimum(body_radius_m / distances, 1.0))
    cross = np.linalg.norm(np.cross(to_sun, -positions), axis=1)
    c = np.arctan2(cross, np.einsum("ni,ni->n", to_sun, -positions))

    # Area of the intersection of two circles of radii a and b whose centres are c apart.
    separation = np.where(c > 0.0, c, 1.0)
    x = (separation**2 + a**2 - b**2) / (2.0 * separation)
    y = np.sqrt(np.maximum(a**2 - x**2, 0.0))
    overlap = a**2 * np.arccos(np.clip(x / a, -1.0, 1.0))
    overlap += b**2 * np.arccos(np.clip((separation - x) / b, -1.0, 1.0)) - separation * y
    partial = 1.0 - overlap / (np.pi * a**2)
    inside = np.where(a <= b, 0.0, 1.0 - (b / a) ** 2)
    fraction = np.where(c >= a + b, 1.0, np.where(c <= np.abs(b - a), inside, partial))
    return np.asarray(np.clip(fraction, 0.0, 1.0))
