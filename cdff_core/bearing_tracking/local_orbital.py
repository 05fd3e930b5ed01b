# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Local-vertical local-horizontal axes (LVLH) in orbit: z to the centre, y against the orbit normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.bearing_tracking.motion import BearingStates

#: Least sine of the angle between position and velocity that defines the plane of the orbit.
_MIN_SINE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class LocalOrbitalAxes:
    """LVLH axes of a body at a time.

    Attributes
    ----------
    rotation : ndarray (3, 3)
        R_inertial_lvlh; x is the horizontal direction of the motion.
    rate : ndarray (3,)
        Angular velocity of the axes, inertial axes, rad/s.
    sigma_rad : float
        Standard deviation of a rotation about each axis; NaN if that of the state is unknown.
    """

    rotation: FloatArray
    rate: FloatArray
    sigma_rad: float

    @classmethod
    def of_state(
        cls,
        position_m: FloatArray,
        velocity_m_s: FloatArray,
        interval_s: float,
        position_sigma_m: float,
        velocity_sigma_m_s: float,
    ) -> LocalOrbitalAxes:
        """Return the axes ``interval_s`` seconds after a state in inertial axes: (3,) in m, (3,) in m/s.

        The true anomaly is continued by its rate h / r^2 and the derivative of that; the next term is below
        1e-8 rad after a minute in a low orbit.

        Raises
        ------
        DegenerateGeometryError
            If the state does not define the plane of an orbit.
        """
        r, v = np.asarray(position_m, float), np.asarray(velocity_m_s, float)
        radius, speed, momentum = np.linalg.norm(r), np.linalg.norm(v), np.cross(r, v)
        h = float(np.linalg.norm(momentum))
        if not (np.isfinite(h) and h > _MIN_SINE * radius * speed):
            raise DegenerateGeometryError(
                f"position {r.tolist()} m, velocity {v.tolist()} m/s: expected the state of an orbit"
            )
        down, against = -r / radius, -momentum / h
        start = np.column_stack([np.cross(against, down), against, down])
        rate = h / radius**2
        slowing = -2.0 * rate * float(r @ v) / radius**2
        angle = rate * interval_s + 0.5 * slowing * interval_s**2
        rotation = se3.exp_so3(-angle * against) @ start
        sigma = float(np.hypot(position_sigma_m / radius, velocity_sigma_m_s / speed))
        return cls(rotation, -(rate + slowing * interval_s) * against, sigma)

    def state(self, direction: FloatArray, rate: FloatArray, covariance: FloatArray) -> BearingStates:
        """Return an inertial direction (3,), its rate (3,) and their covariance (6, 6) in the axes."""
        to_axes = self.rotation.T
        across = self.rate - (self.rate @ direction) * direction
        block_rotation = np.kron(np.eye(2), to_axes)
        rotated_covariance = block_rotation @ covariance @ block_rotation.T
        rotated_covariance[:3, :3] += np.eye(3) * self.sigma_rad**2
        return BearingStates(
            (to_axes @ direction)[None], (to_axes @ (rate - across))[None], rotated_covariance[None]
        )
