# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sun and Earth of a scenario: positions from the ephemeris, eclipse, light reflected by the Earth.

The ephemeris is that of astronomy-engine (VSOP87), accurate to 1'.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.clock import NS_PER_S
from cdff_common.extras import import_extra
from cdff_common.geometry.se3 import FloatArray
from cdff_common.stars.aberration import ASTRONOMICAL_UNIT_M
from cdff_dev.simulate.orbit.eclipse import EARTH_RADIUS_M

#: Apparent magnitude V of the Sun at 1 au. Source: Willmer (2018), doi:10.3847/1538-4365/aabfdf.
SUN_MAGNITUDE = -26.74
#: Epoch J2000 (2000-01-01 12:00) as seconds since 1970.
_J2000_UNIX_S = 946_728_000.0
_DAY_S = 86_400.0
#: Spacing of the times of the ephemeris, between which the position of the Sun is interpolated linearly,
#: seconds.
_STEP_S = 600.0


def sun_positions_m(stamps_ns: ArrayLike) -> FloatArray:
    """Return the geocentric positions ``(n, 3)`` of the Sun at times ``(n,)``, GCRF axes."""
    astronomy = import_extra("astronomy")
    t_s = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64)) / NS_PER_S
    first = np.floor(t_s.min() / _STEP_S)
    nodes_s = (first + np.arange(int(np.ceil(t_s.max() / _STEP_S) - first) + 1)) * _STEP_S
    positions = np.empty((len(nodes_s), 3))
    for i, node_s in enumerate(nodes_s):
        time = astronomy.Time((node_s - _J2000_UNIX_S) / _DAY_S)
        vector = astronomy.GeoVector(astronomy.Body.Sun, time, aberration=True)
        positions[i] = vector.x, vector.y, vector.z
    interpolated = [np.interp(t_s, nodes_s, positions[:, k]) for k in range(3)]
    return np.asarray(np.stack(interpolated, axis=1) * ASTRONOMICAL_UNIT_M)


def earth_rotation(stamp_ns: int) -> FloatArray:
    """Return ``R_inertial_earth`` (3, 3), by the Earth rotation angle (IERS 2010, eq. 5.15)."""
    days = (stamp_ns / NS_PER_S - _J2000_UNIX_S) / _DAY_S
    angle = 2.0 * np.pi * ((0.7790572732640 + 1.00273781191135448 * days) % 1.0)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def earth_light(normals: FloatArray, position_m: FloatArray, to_sun: FloatArray, albedo: float) -> FloatArray:
    """Return the irradiance ``(n,)`` of surfaces by the Earth, relative to that of the Sun at right angles.

    The Earth is a sphere that reflects diffusely. The irradiance is exact for a surface that faces it, for a
    near Earth that fills a half space, and for a distant one; between these cases it is interpolated by the
    sine of the angular radius.

    Parameters
    ----------
    normals : ndarray (n, 3)
        Inertial axes, as all vectors.
    position_m : ndarray (3,)
        Relative to the centre of the Earth.
    to_sun : ndarray (3,)
        Unit vector.
    """
    distance = float(np.linalg.norm(position_m))
    up = position_m / distance
    sine = min(EARTH_RADIUS_M / distance, 1.0)
    cosines = normals @ -up
    near = 0.5 * (1.0 + cosines)
    factor = sine**2 * (sine * near + (1.0 - sine) * np.maximum(cosines, 0.0))
    cos_phase = float(np.clip(up @ to_sun, -1.0, 1.0))
    phase = np.arccos(cos_phase)
    # Lambert's phase function of a distant sphere, 2/3 at full phase; below it, the local cosine.
    distant = 2.0 / (3.0 * np.pi) * (np.sin(phase) + (np.pi - phase) * cos_phase)
    lit = sine * max(cos_phase, 0.0) + (1.0 - sine) * distant
    return np.asarray(albedo * lit * factor)
