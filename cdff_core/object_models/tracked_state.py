# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State of a tracked body: pose, velocity, angular rate and their covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3

#: Errors of the state: position, rotation, velocity, rate.
ERRORS = 12


@dataclass(frozen=True, slots=True, eq=False)
class TrackedState:
    """State of a body in the frame of a sensor.

    Attributes
    ----------
    stamp_ns : int
    T : ndarray, shape (4, 4)
        T_sensor_body.
    velocity : ndarray, shape (3,)
        In the frame, m/s.
    rate : ndarray, shape (3,)
        Relative to the frame, in the body's axes, rad/s.
    covariance : ndarray, shape (12, 12)
        Of the errors x y z, rx ry rz (both in the frame), velocity, rate (in the body's axes).
    """

    stamp_ns: int
    T: FloatArray
    velocity: FloatArray
    rate: FloatArray
    covariance: FloatArray

    @classmethod
    def at_rest(
        cls,
        stamp_ns: int,
        T: FloatArray,
        pose_covariance: FloatArray,
        velocity_sigma_mps: float,
        rate_sigma_radps: float,
    ) -> TrackedState:
        """Return the state of a measured pose without knowledge of its motion."""
        covariance = np.zeros((ERRORS, ERRORS))
        covariance[:6, :6] = pose_covariance
        covariance[6:9, 6:9] = velocity_sigma_mps**2 * np.eye(3)
        covariance[9:, 9:] = rate_sigma_radps**2 * np.eye(3)
        return cls(stamp_ns, T, np.zeros(3), np.zeros(3), covariance)

    def corrected(self, correction: FloatArray, covariance: FloatArray) -> TrackedState:
        """Return the state plus an error (12,)."""
        R = se3.normalise_rotation(se3.exp_so3(correction[3:6]) @ self.T[:3, :3])
        return replace(
            self,
            T=se3.transform(R, self.T[:3, 3] + correction[:3]),
            velocity=self.velocity + correction[6:9],
            rate=self.rate + correction[9:],
            covariance=covariance,
        )

    @property
    def velocities(self) -> FloatArray:
        """Velocity and angular rate (6,) in the frame, m/s and rad/s."""
        return np.concatenate([self.velocity, self.T[:3, :3] @ self.rate])

    @property
    def velocity_covariance(self) -> FloatArray:
        """Covariance (6, 6) of ``velocities``: errors of the rate in the frame and of the attitude."""
        R = self.T[:3, :3]
        J = np.zeros((6, ERRORS))
        J[:3, 6:9] = np.eye(3)
        J[3:, 3:6] = -se3.skew(R @ self.rate)
        J[3:, 9:] = R
        return np.asarray(J @ self.covariance @ J.T)
