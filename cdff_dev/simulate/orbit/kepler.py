# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Orbits of two bodies about a third, and motion relative to one of them, without linearisation.

Both spacecraft follow elliptic orbits, whose difference is the relative motion; the equations of Clohessy and
Wiltshire approximate it. Relative states are given in local-vertical local-horizontal axes (LVLH): z points
to the central body (R-bar), y against the orbit normal, x completes them (V-bar, along the velocity on a
circular orbit).

Sources: R. H. Battin, An Introduction to the Mathematics and Methods of Astrodynamics, 1999, §4.3
(doi:10.2514/4.861543); W. Fehse, Automated Rendezvous and Docking of Spacecraft, 2003, §3.1
(doi:10.1017/CBO9780511543388).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Gravitational parameter of the Earth (WGS 84), m³/s².
MU_EARTH = 3.986004418e14
#: Largest number of Newton iterations.
_ITERATIONS = 60


class EllipticOrbit:
    """Orbit of a body about a central body.

    Parameters
    ----------
    position_m, velocity_m_s : array_like (3,)
        State at ``epoch_s``, relative to the central body, inertial axes.
    mu_m3_s2 : float
        Gravitational parameter of the central body.
    epoch_s : float

    Raises
    ------
    InputError
        If the state is not finite, or is not that of an ellipse.
    """

    def __init__(
        self,
        position_m: ArrayLike,
        velocity_m_s: ArrayLike,
        mu_m3_s2: float = MU_EARTH,
        epoch_s: float = 0.0,
    ) -> None:
        self._r0 = np.asarray(position_m, dtype=float)
        self._v0 = np.asarray(velocity_m_s, dtype=float)
        self.mu_m3_s2, self.epoch_s = mu_m3_s2, epoch_s
        if self._r0.shape != (3,) or self._v0.shape != (3,):
            raise InputError(f"position_m={position_m!r}, velocity_m_s={velocity_m_s!r}: expected (3,) each")
        radius_m = float(np.linalg.norm(self._r0))
        if not (np.isfinite([*self._r0, *self._v0]).all() and mu_m3_s2 > 0.0 and radius_m > 0.0):
            raise InputError(
                f"position_m={self._r0.tolist()}, velocity_m_s={self._v0.tolist()}, mu_m3_s2={mu_m3_s2}: "
                "expected finite values, away from the centre, and mu above 0"
            )
        inverse_m = 2.0 / radius_m - float(self._v0 @ self._v0) / mu_m3_s2
        if inverse_m <= 0.0 or not np.cross(self._r0, self._v0).any():
            raise InputError(
                f"position_m={self._r0.tolist()}, velocity_m_s={self._v0.tolist()}: expected an elliptic "
                f"orbit; the speed is {np.linalg.norm(self._v0):g} m/s, that of escape "
                f"{math.sqrt(2.0 * mu_m3_s2 / radius_m):g} m/s"
            )
        self.semi_major_axis_m = 1.0 / inverse_m
        self._radius_m = radius_m
        self.mean_motion_rad_s = math.sqrt(mu_m3_s2 * inverse_m**3)

    @classmethod
    def from_elements(
        cls,
        *,
        semi_major_axis_m: float,
        eccentricity: float = 0.0,
        inclination_deg: float = 0.0,
        node_deg: float = 0.0,
        periapsis_deg: float = 0.0,
        true_anomaly_deg: float = 0.0,
        mu_m3_s2: float = MU_EARTH,
    ) -> EllipticOrbit:
        """Return the orbit with classical elements at epoch 0.

        ``node_deg`` is the right ascension of the ascending node, ``periapsis_deg`` the argument of the
        periapsis.
        """
        if not (semi_major_axis_m > 0.0 and 0.0 <= eccentricity < 1.0):
            raise InputError(
                f"semi_major_axis_m={semi_major_axis_m}, eccentricity={eccentricity}: expected above 0, and "
                "0 to below 1"
            )
        parameter_m = semi_major_axis_m * (1.0 - eccentricity**2)
        anomaly = math.radians(true_anomaly_deg)
        radius_m = parameter_m / (1.0 + eccentricity * math.cos(anomaly))
        speed_m_s = math.sqrt(mu_m3_s2 / parameter_m)
        R = (
            _about_z(math.radians(node_deg))
            @ np.asarray(se3.exp_so3([math.radians(inclination_deg), 0.0, 0.0]))
            @ _about_z(math.radians(periapsis_deg))
        )
        position_m = R @ [radius_m * math.cos(anomaly), radius_m * math.sin(anomaly), 0.0]
        velocity_m_s = R @ [
            -speed_m_s * math.sin(anomaly),
            speed_m_s * (eccentricity + math.cos(anomaly)),
            0.0,
        ]
        return cls(position_m, velocity_m_s, mu_m3_s2)

    @property
    def period_s(self) -> float:
        """Period, seconds."""
        return 2.0 * math.pi / self.mean_motion_rad_s

    def states(self, t_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, 3), metres, and velocities (n, 3), m/s, at times (n,), inertial axes."""
        elapsed_s = np.mod(np.atleast_1d(np.asarray(t_s, dtype=float)) - self.epoch_s, self.period_s)
        a, r0 = self.semi_major_axis_m, self._radius_m
        sigma = float(self._r0 @ self._v0) / math.sqrt(self.mu_m3_s2 * a)
        mean = self.mean_motion_rad_s * elapsed_s
        E = self._eccentric_differences(mean, sigma)
        cosine, sine = np.cos(E), np.sin(E)
        radii_m = a + (r0 - a) * cosine + sigma * a * sine
        f = 1.0 - a / r0 * (1.0 - cosine)
        g_s = elapsed_s - (E - sine) / self.mean_motion_rad_s
        f_rate = -math.sqrt(self.mu_m3_s2 * a) / (radii_m * r0) * sine
        g_rate = 1.0 - a / radii_m * (1.0 - cosine)
        positions_m = np.outer(f, self._r0) + np.outer(g_s, self._v0)
        velocities_m_s = np.outer(f_rate, self._r0) + np.outer(g_rate, self._v0)
        return positions_m, velocities_m_s

    def _eccentric_differences(self, mean: FloatArray, sigma: float) -> FloatArray:
        """Solve Kepler's equation for the change (n,) of the eccentric anomaly since the epoch."""
        e_cosine = 1.0 - self._radius_m / self.semi_major_axis_m
        E = mean.copy()
        for _ in range(_ITERATIONS):
            residual = E + sigma * (1.0 - np.cos(E)) - e_cosine * np.sin(E) - mean
            step = residual / (1.0 + sigma * np.sin(E) - e_cosine * np.cos(E))
            E -= np.clip(step, -1.0, 1.0)
            if np.abs(step).max(initial=0.0) < 1e-15 * (1.0 + np.abs(E).max(initial=0.0)):
                break
        return E


def lvlh_axes(positions_m: FloatArray, velocities_m_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotations ``R_inertial_lvlh`` (n, 3, 3) and their angular rates (n, 3), rad/s, inertial axes.

    Parameters
    ----------
    positions_m, velocities_m_s : ndarray (n, 3)
        States relative to the central body, inertial axes.
    """
    normals = np.cross(positions_m, velocities_m_s)
    radii_m = np.linalg.norm(positions_m, axis=1, keepdims=True)
    z = -positions_m / radii_m
    y = -normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=2), normals / radii_m**2


def relative_states(
    reference: EllipticOrbit, other: EllipticOrbit, t_s: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return positions (n, 3), metres, and velocities (n, 3), m/s, of a body in the rotating LVLH axes of
    ``reference``.
    """
    r, v = reference.states(t_s)
    r_other, v_other = other.states(t_s)
    R, rates = lvlh_axes(r, v)
    offset_m = r_other - r
    velocity_m_s = v_other - v - np.cross(rates, offset_m)
    return np.einsum("nji,nj->ni", R, offset_m), np.einsum("nji,nj->ni", R, velocity_m_s)


def relative_orbit(
    reference: EllipticOrbit, position_m: ArrayLike, velocity_m_s: ArrayLike, t_s: float
) -> EllipticOrbit:
    """Return the orbit of a body from its state (3,), (3,) in the LVLH axes of ``reference`` at a time."""
    r, v = reference.states(t_s)
    R, rates = lvlh_axes(r, v)
    offset_m = R[0] @ np.asarray(position_m, dtype=float)
    velocity = v[0] + R[0] @ np.asarray(velocity_m_s, dtype=float) + np.cross(rates[0], offset_m)
    return EllipticOrbit(r[0] + offset_m, velocity, reference.mu_m3_s2, t_s)


def transfer(
    reference: EllipticOrbit, start_m: ArrayLike, end_m: ArrayLike, start_s: float, end_s: float
) -> EllipticOrbit:
    """Return the orbit from one position (3,) in the LVLH axes of ``reference`` to another in a given time.

    The velocity is solved by Newton's method; a transfer takes less than a period.

    Raises
    ------
    InputError
        If the times do not allow it, or no orbit is found, as after half a period out of the orbital plane.
    """
    if not 0.0 < end_s - start_s < reference.period_s:
        raise InputError(
            f"transfer from {start_s:g} to {end_s:g} s: expected above 0 and below the period of "
            f"{reference.period_s:g} s"
        )
    start, end = np.asarray(start_m, dtype=float), np.asarray(end_m, dtype=float)
    velocity_m_s = (end - start) / (end_s - start_s)
    tolerance_m = 1e-6 + 1e-9 * max(np.linalg.norm(start), np.linalg.norm(end))

    def end_of(velocity: FloatArray) -> FloatArray:
        orbit = relative_orbit(reference, start, velocity, start_s)
        return np.asarray(relative_states(reference, orbit, end_s)[0][0])

    for _ in range(_ITERATIONS):
        error_m = end_of(velocity_m_s) - end
        if np.linalg.norm(error_m) <= tolerance_m:
            return relative_orbit(reference, start, velocity_m_s, start_s)
        step_m_s = 1e-3 * np.eye(3)
        J = np.stack([(end_of(velocity_m_s + d) - end_of(velocity_m_s - d)) / 2e-3 for d in step_m_s], axis=1)
        if np.linalg.cond(J) > 1e9:
            break
        velocity_m_s = velocity_m_s - np.linalg.solve(J, error_m)
    raise InputError(
        f"transfer from {start.tolist()} to {end.tolist()} m in {end_s - start_s:g} s: no orbit found; "
        "choose another duration"
    )


def _about_z(angle_rad: float) -> FloatArray:
    return np.asarray(se3.exp_so3([0.0, 0.0, angle_rad]))
