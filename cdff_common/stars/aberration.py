# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stellar aberration: the shift of stars towards the velocity of the observer, up to 26″ in orbit.

A body that moves with the observer is not shifted. Directions to it, measured relative to stars, therefore
need the correction of the stars.

References
----------
.. [1] The Astronomical Almanac, 2010, page C5: position of the Sun to 0.01° between 1950 and 2050.
.. [2] Urban, S. E., Seidelmann, P. K. (eds.) (2013). Explanatory Supplement to the Astronomical Almanac,
   §7.2.3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

#: Speed of light, m/s, and the astronomical unit, m.
LIGHT_M_S, ASTRONOMICAL_UNIT_M = 299_792_458.0, 149_597_870_700.0
#: 1 January 2000, 12:00 TT, nanoseconds since the UNIX epoch (TT - UTC was 64.184 s).
_J2000_NS, _DAY_NS = 946_727_935_816_000_000, 86_400_000_000_000
_HOUR_NS = 3_600_000_000_000
#: Rate of the general precession in longitude, degrees per day.
_PRECESSION_DEG_DAY = 1.39697 / 36_525.0


def sun_position_m(stamp_ns: int) -> FloatArray:
    """Return the geocentric position ``(3,)`` of the Sun, metres, GCRF axes, to 0.01° [1]_."""
    days = (stamp_ns - _J2000_NS) / _DAY_NS
    anomaly = np.radians(357.528 + 0.9856003 * days)
    longitude_deg = 280.460 + 0.9856474 * days + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly)
    longitude = np.radians(longitude_deg - _PRECESSION_DEG_DAY * days)
    obliquity = np.radians(23.4393)
    distance_au = 1.00014 - 0.01671 * np.cos(anomaly) - 0.00014 * np.cos(2.0 * anomaly)
    sine = np.sin(longitude)
    direction = np.array([np.cos(longitude), np.cos(obliquity) * sine, np.sin(obliquity) * sine])
    return np.asarray(distance_au * ASTRONOMICAL_UNIT_M * direction)


def earth_velocity_m_s(stamp_ns: int) -> FloatArray:
    """Return the velocity ``(3,)`` of the Earth relative to the Sun, m/s, GCRF axes, to 15 m/s."""
    before, after = sun_position_m(stamp_ns - _HOUR_NS), sun_position_m(stamp_ns + _HOUR_NS)
    return np.asarray((before - after) / 7200.0)


def aberrated(directions: ArrayLike, velocity_m_s: ArrayLike) -> FloatArray:
    """Return the apparent unit vectors ``(n, 3)`` of stars for a moving observer [2]_.

    Parameters
    ----------
    directions : array_like (n, 3)
        Geometric unit vectors.
    velocity_m_s : array_like (3,)
        Velocity of the observer relative to the Sun, m/s, same axes: that of the Earth plus that of the
        orbit.
    """
    u = np.asarray(directions, dtype=float).reshape(-1, 3)
    beta = np.asarray(velocity_m_s, dtype=float) / LIGHT_M_S
    gamma = 1.0 / np.sqrt(1.0 - beta @ beta)
    along = u @ beta
    apparent = (u / gamma + beta + np.outer(along, beta) * gamma / (1.0 + gamma)) / (1.0 + along)[:, None]
    return np.asarray(apparent / np.linalg.norm(apparent, axis=1, keepdims=True))


def geometric(directions: ArrayLike, velocity_m_s: ArrayLike) -> FloatArray:
    """Return the geometric unit vectors ``(n, 3)`` of apparent ones: the inverse of ``aberrated``."""
    return aberrated(directions, -np.asarray(velocity_m_s, dtype=float))
