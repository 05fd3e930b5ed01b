# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State of a tracked body: pose, velocity, angular rate and their covariance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error, symmetrised
from cdff_core.object_models.inertia import changed_inertia, inertia_difference

#: Number of components of the error of a state: position (3), rotation (3), velocity (3), rate (3), centre of
#: mass (3), inertia (5).
STATE_ERROR_DIM = 20


@dataclass(frozen=True, slots=True, eq=False)
class TrackedState:
    """State of a body in the frame of a sensor.

    Attributes
    ----------
    stamp_ns : int
    T : ndarray, shape (4, 4)
        T_sensor_body.
    velocity : ndarray, shape (3,)
        Velocity of the centre of mass in the frame, m/s.
    rate : ndarray, shape (3,)
        Angular rate relative to the frame, in the body's axes, rad/s.
    centre_of_mass_m : ndarray, shape (3,)
        In the frame of the body.
    inertia : ndarray, shape (3, 3)
        Known up to a factor only; scaled to trace 3.
    covariance : ndarray, shape (20, 20)
        Of the errors x y z, rx ry rz (both in the frame), velocity, rate and centre of mass (both in the
        body), inertia along ``inertia.BASIS``.
    noise_scales : ndarray, shape (2,)
        Factors of the noise of acceleration and angular acceleration.
    """

    stamp_ns: int
    T: FloatArray
    velocity: FloatArray
    rate: FloatArray
    centre_of_mass_m: FloatArray
    inertia: FloatArray
    covariance: FloatArray
    noise_scales: FloatArray = field(default_factory=lambda: np.ones(2))

    def corrected(self, correction: FloatArray, covariance: FloatArray) -> TrackedState:
        """Return the state plus a correction (20,), with a new covariance (20, 20)."""
        R = se3.normalise_rotation(se3.exp_so3(correction[3:6]) @ self.T[:3, :3])
        return replace(
            self,
            T=se3.transform(R, self.T[:3, 3] + correction[:3]),
            velocity=self.velocity + correction[6:9],
            rate=self.rate + correction[9:12],
            centre_of_mass_m=self.centre_of_mass_m + correction[12:15],
            inertia=changed_inertia(self.inertia, correction[15:]),
            covariance=covariance,
        )

    def with_pose(self, T: FloatArray, covariance: FloatArray) -> TrackedState:
        """Return the state with a pose that is the result of a measurement and of the prediction.

        The other components follow by their correlation with the pose.

        Parameters
        ----------
        T : ndarray, shape (4, 4)
            T_sensor_body.
        covariance : ndarray, shape (6, 6)
            Of x y z rx ry rz, in the frame of the sensor.
        """
        prior = self.covariance
        gain = np.linalg.lstsq(prior[:6, :6], prior[:6], rcond=1e-12)[0].T
        correction = gain @ pose_error(T, self.T)
        updated = prior - gain @ (prior[:6, :6] - covariance) @ gain.T
        return self.corrected(correction, symmetrised(updated))

    def difference(self, other: TrackedState) -> FloatArray:
        """Return the error (20,) that ``corrected`` adds to the other state to obtain this one."""
        return np.concatenate(
            [
                pose_error(self.T, other.T),
                self.velocity - other.velocity,
                self.rate - other.rate,
                self.centre_of_mass_m - other.centre_of_mass_m,
                inertia_difference(self.inertia, other.inertia),
            ]
        )

    def squared_distance(self, prediction: TrackedState) -> float:
        """Return the squared Mahalanobis distance from a prediction, with the
        covariance of the prediction.
        """
        error = self.difference(prediction)
        return float(error @ np.linalg.lstsq(prediction.covariance, error, rcond=1e-12)[0])

    @property
    def velocities(self) -> FloatArray:
        """Velocity of the origin and angular rate (6,) in the frame, m/s and rad/s."""
        R = self.T[:3, :3]
        rate = R @ self.rate
        return np.concatenate([self.velocity - np.cross(rate, R @ self.centre_of_mass_m), rate])

    @property
    def velocity_jacobian(self) -> FloatArray:
        """Derivative (6, 20) of ``velocities`` with respect to the errors."""
        R = self.T[:3, :3]
        rate, arm = R @ self.rate, R @ self.centre_of_mass_m
        J = np.zeros((6, STATE_ERROR_DIM))
        J[3:, 3:6] = -se3.skew(rate)
        J[3:, 9:12] = R
        J[:3] = se3.skew(arm) @ J[3:]
        J[:3, 3:6] += se3.skew(rate) @ se3.skew(arm)
        J[:3, 6:9] = np.eye(3)
        J[:3, 12:15] = -se3.skew(rate) @ R
        return J

    @property
    def velocity_covariance(self) -> FloatArray:
        """Covariance (6, 6) of ``velocities``."""
        J = self.velocity_jacobian
        return np.asarray(J @ self.covariance @ J.T)

    def relative_poses(self, times_s: FloatArray) -> FloatArray:
        """Return T_sensor_body (n, 4, 4) at times (n,) relative to the stamp, at
        constant velocity and rate.
        """
        R = self.T[:3, :3] @ se3.exp_so3(np.asarray(times_s)[:, None] * self.rate)
        centre = self.T[:3, 3] + self.T[:3, :3] @ self.centre_of_mass_m
        positions = centre + np.outer(times_s, self.velocity) - R @ self.centre_of_mass_m
        return se3.transform(R, positions)
