# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gradient of a height grid and its shaded relief.

References
----------
.. [1] Horn, B. K. P. (1981). Hill shading and the reflectance map. Proceedings of the IEEE 69(1).
   doi:10.1109/PROC.1981.11918
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError


def horn_gradient(
    heights_m: ArrayLike, resolution_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the gradient by Horn's weighted central differences over 3 x 3 cells ([1]_).

    Parameters
    ----------
    heights_m : array_like, shape (rows, cols)
        Row 0 at ymax; NaN where unobserved.
    resolution_m : float
        Edge of a cell, metres.

    Returns
    -------
    dz_dx, dz_dy : NDArray[np.float64], shape (rows, cols)
        Metres per metre along +x and +y; NaN where any of the nine cells is unobserved or outside.
    """
    z = np.asarray(heights_m, dtype=np.float64)
    if z.ndim != 2:
        raise InputError(f"heights_m: shape {z.shape}, expected (rows, cols)")
    p = np.pad(z, 1, constant_values=np.nan)
    return _horn(p, resolution_m)


def slope_rad(heights_m: ArrayLike, resolution_m: float) -> NDArray[np.float64]:
    """Return the slope ``(rows, cols)`` by ``horn_gradient``, radians from the horizontal; NaN like the
    gradient.
    """
    dz_dx, dz_dy = horn_gradient(heights_m, resolution_m)
    return np.asarray(np.arctan(np.hypot(dz_dx, dz_dy)), dtype=np.float64)


def hillshade(
    heights_m: ArrayLike,
    resolution_m: float,
    *,
    azimuth_deg: float = 315.0,
    altitude_deg: float = 45.0,
    exaggeration: float = 1.0,
) -> NDArray[np.uint8]:
    """Return a shaded relief for display: 0 where unobserved, 1 (dark) to 255 (bright) elsewhere.

    Parameters
    ----------
    heights_m : array_like, shape (rows, cols)
        Row 0 at ymax; NaN where unobserved. A missing neighbour gets the height of the cell itself,
        since sparse maps of one scan would otherwise be blank.
    resolution_m : float
        Edge of a cell, metres.
    azimuth_deg : float
        Direction of the light source, degrees clockwise from +y.
    altitude_deg : float
        Elevation of the light source above the horizon, degrees.
    exaggeration : float
        Heights are multiplied by it.
    """
    z = np.asarray(heights_m, dtype=np.float64) * exaggeration
    if z.ndim != 2:
        raise InputError(f"heights_m: shape {z.shape}, expected (rows, cols)")
    p = np.pad(z, 1, constant_values=np.nan)
    dz_dx, dz_dy = _horn(p, resolution_m, fill=z)
    azimuth, altitude = np.radians(azimuth_deg), np.radians(altitude_deg)
    light = (np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude))
    shade = (light[2] - dz_dx * light[0] - dz_dy * light[1]) / np.sqrt(1.0 + dz_dx**2 + dz_dy**2)
    bright = 1.0 + 254.0 * np.clip(np.nan_to_num(shade), 0.0, 1.0)
    return np.where(np.isfinite(z), np.rint(bright), 0.0).astype(np.uint8)


def _horn(
    padded: NDArray[np.float64], resolution_m: float, fill: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives along x and y by Horn's method; ``fill`` replaces unobserved neighbours."""
    rows, cols = padded.shape[0] - 2, padded.shape[1] - 2

    def at(row: int, col: int) -> NDArray[np.float64]:
        part = padded[1 + row : 1 + row + rows, 1 + col : 1 + col + cols]
        return part if fill is None else np.where(np.isfinite(part), part, fill)

    centre = at(0, 0) * 0.0  # adds the NaN of an unobserved centre, which the differences do not contain
    dz_dx = (at(-1, 1) + 2 * at(0, 1) + at(1, 1) - at(-1, -1) - 2 * at(0, -1) - at(1, -1)) / (
        8 * resolution_m
    ) + centre
    dz_dy = (at(-1, -1) + 2 * at(-1, 0) + at(-1, 1) - at(1, -1) - 2 * at(1, 0) - at(1, 1)) / (
        8 * resolution_m
    ) + centre
    return dz_dx, dz_dy
