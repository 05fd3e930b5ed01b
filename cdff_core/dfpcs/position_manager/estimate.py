# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State of the error-state filter: motion of the robot, cloned poses, and their joint covariance.

Order of the errors: position and rotation of ``T_site_base`` (perturbation in the site), velocity in the
site, gyro bias, accelerometer bias (base axes), slip forward, left and up relative to the path length,
rotations of the mounts of IMU, visual and lidar odometry (base axes), offsets of the stamps of odometries;
then six for each clone. A clone is a copy of the pose at the last measurement of an odometry [1]_: the next
increment is measured between the clone and the current pose, and corrects both.

References
----------
.. [1] S. Roumeliotis, J. Burdick, Stochastic cloning, 2002, doi:10.1109/ROBOT.2002.1014801
.. [2] A. Barrau, S. Bonnabel, The invariant extended Kalman filter as a stable observer, 2017,
   doi:10.1109/TAC.2016.2594085
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import relative_jacobians, rotate_covariance, symmetrised
from cdff_common.geometry.se3 import FloatArray

POSITION, ROTATION, VELOCITY, GYRO, FORCE, SLIP = (slice(k, k + 3) for k in range(0, 18, 3))
POSE = slice(0, 6)
#: Rows of the rotation errors of the mounts, three for each source.
MOUNTS = {"imu": slice(18, 21), "visual_odometry": slice(21, 24), "lidar_odometry": slice(24, 27)}
#: Row of the error of the offset of the stamps to the clock of the IMU, for each odometry.
OFFSETS = {"odometry": 27, "visual_odometry": 28, "lidar_odometry": 29}
#: Number of errors without clones.
CORE_SIZE = 30
#: Errors stored in the timeline: pose and gyro bias, which evolve nearly independently of the others.
TIMELINE_ERRORS = np.r_[0:6, 9:12]


@dataclass(frozen=True, slots=True, eq=False)
class Clone:
    """Pose of the robot at the last measurement of a source."""

    pose: FloatArray  # (4, 4), ``T_site_base`` at that time
    measured: UncertainTransform  # measurement ``T_origin_sensor`` at that time
    stamp_ns: int
    velocity: FloatArray  # (3,), m/s in the site at that time
    refusals: int = 0  # number of increments since this clone that were refused
    #: Factor on the variances of the source, estimated from its innovations.
    noise_factor: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """State and covariance at one time; immutable."""

    stamp_ns: int
    pose: FloatArray  # (4, 4), ``T_site_base``
    velocity: FloatArray  # (3,), m/s in the site
    biases: FloatArray  # (6,), gyro (rad/s) and accelerometer (m/s^2)
    slip: FloatArray  # (3,), per metre of path length
    #: (12,), estimated rotation errors of the mounts and offsets of the stamps, in the order of their errors
    calibration: FloatArray
    covariance: FloatArray  # (30 + 6 c, 30 + 6 c)
    #: (30 + 6 c, 9), covariance of these errors with the ``TIMELINE_ERRORS`` of the previous estimate
    cross_covariance: FloatArray
    clones: dict[str, Clone]  # in the order of their errors
    consecutive_refusals: int = 0  # number of increments refused one after the other
    #: Speed from the wheels, m/s, averaged over about a second; negative backwards.
    wheel_speed_m_s: float = 0.0
    #: Squared Mahalanobis norm of the last innovation relative to its expected value.
    innovation_ratio: float = 1.0

    @classmethod
    def at_start(
        cls,
        stamp_ns: int,
        pose: UncertainTransform,
        speed_sigma_m_s: float,
        biases: FloatArray,
        sigmas: FloatArray,
    ) -> Estimate:
        """Return an estimate at rest without clones; ``sigmas`` (9,) are the standard deviations of biases
        and slip.
        """
        P = np.zeros((CORE_SIZE, CORE_SIZE))
        P[POSE, POSE] = 0.0 if pose.covariance is None else pose.covariance
        P[6:18, 6:18] = np.diag(np.square(np.concatenate([np.full(3, speed_sigma_m_s), sigmas])))
        zero, cross = np.zeros(3), P[:, TIMELINE_ERRORS].copy()
        return cls(stamp_ns, pose.matrix, zero, biases, zero, np.zeros(12), P, cross, {})

    def mount_error(self, source: str) -> FloatArray:
        """Return the estimated rotation error (3,) of the mount of a source, rad in base axes."""
        return self.calibration[MOUNTS[source].start - 18 :][:3]

    def stamp_offset_s(self, source: str) -> float:
        """Return the estimated offset of the clock of an odometry: stamp plus
        offset is the time of the IMU.
        """
        return float(self.calibration[OFFSETS[source] - 18])

    def clone_errors(self, name: str) -> slice:
        """Return the indices of the errors of a clone."""
        first = CORE_SIZE + 6 * list(self.clones).index(name)
        return slice(first, first + 6)

    def relative_motion(self, name: str, end: str | None = None) -> tuple[FloatArray, FloatArray]:
        """Return ``T_clone_base`` (4, 4) and the Jacobian (6, n) of its error with respect to the errors.

        With ``end`` the motion ends at that clone instead of the current pose.
        """
        clone, end_pose = self.clones[name].pose, self.clones[end].pose if end else self.pose
        H = np.zeros((6, len(self.covariance)))
        end_errors = self.clone_errors(end) if end else POSE
        H[:, self.clone_errors(name)], H[:, end_errors] = relative_jacobians(clone, end_pose)
        return se3.inverse(clone) @ end_pose, H

    def corrected(
        self, correction: FloatArray, covariance: FloatArray, gain_H: FloatArray, *, is_relative: bool
    ) -> Estimate:
        """Return the estimate after a correction (n,) with its covariance; ``gain_H`` is K H (n, n).

        A rotation of the whole trajectory about the vertical changes no measured motion, so that increments
        must not reduce its variance. Its errors ``(phi x p, phi, phi x v)`` depend on position and velocity:
        if the covariance after a correction referred to the previous state, the next correction would reduce
        it. The covariance of the right-invariant errors ``dp - phi x p`` and ``dv - phi x v`` [2]_, which do
        not change with the state, is therefore preserved after a measurement that ``is_relative``. An
        absolute pose measures the position itself; its covariance does not depend on the corrected rotation.
        """
        corrected_estimate = self.with_correction(correction)
        cross = self.cross_covariance - gain_H @ self.cross_covariance
        if not is_relative:
            return replace(corrected_estimate, covariance=covariance, cross_covariance=cross)
        J = np.eye(len(correction))
        J[POSITION, ROTATION] = -se3.skew(corrected_estimate.pose[:3, 3] - self.pose[:3, 3])
        J[VELOCITY, ROTATION] = -se3.skew(corrected_estimate.velocity - self.velocity)
        for name, clone in self.clones.items():
            first = self.clone_errors(name).start
            translation_change = corrected_estimate.clones[name].pose[:3, 3] - clone.pose[:3, 3]
            J[first : first + 3, first + 3 : first + 6] = -se3.skew(translation_change)
        return replace(
            corrected_estimate, covariance=symmetrised(J @ covariance @ J.T), cross_covariance=J @ cross
        )

    def with_correction(self, correction: FloatArray) -> Estimate:
        """Return the state after adding a correction (n,) to it; the covariances do not change."""
        errors = np.concatenate([correction[POSE], correction[CORE_SIZE:]]).reshape(-1, 6)
        poses = np.array([self.pose, *(clone.pose for clone in self.clones.values())])
        poses[:, :3, :3] = se3.exp_so3(errors[:, 3:]) @ poses[:, :3, :3]
        poses[:, :3, 3] += errors[:, :3]
        clones = zip(self.clones.items(), poses[1:], strict=True)
        return replace(
            self,
            pose=poses[0],
            velocity=self.velocity + correction[VELOCITY],
            biases=self.biases + correction[9:15],
            slip=self.slip + correction[SLIP],
            calibration=self.calibration + correction[18:CORE_SIZE],
            clones={name: replace(clone, pose=pose) for (name, clone), pose in clones},
        )

    def with_clone(
        self, name: str, measured: UncertainTransform, pose_covariance: FloatArray | None = None
    ) -> Estimate:
        """Return the estimate with a clone ``name`` of its pose, which replaces an earlier one.

        ``pose_covariance`` (6, 6), in axes of the base, is that of the noise of the measured pose. The clone
        contains this noise, because the increments that end and start at the pose have it in common.
        """
        factor = self.noise_factor(name)
        clones = {
            **self.clones,
            name: Clone(self.pose, measured, self.stamp_ns, self.velocity, noise_factor=factor),
        }
        n, size = len(self.covariance), CORE_SIZE + 6 * len(clones)
        covariance, cross = np.empty((size, size)), np.empty((size, len(TIMELINE_ERRORS)))
        covariance[:n, :n], cross[:n] = self.covariance, self.cross_covariance
        first = CORE_SIZE + 6 * list(clones).index(name)
        clone_errors = slice(first, first + 6)
        covariance[clone_errors], cross[clone_errors] = covariance[POSE], cross[POSE]
        covariance[:, clone_errors] = covariance[:, POSE]
        if pose_covariance is not None:
            covariance[clone_errors, clone_errors] += rotate_covariance(pose_covariance, self.pose[:3, :3])
        return replace(self, covariance=covariance, cross_covariance=cross, clones=clones)

    def noise_factor(self, name: str) -> float:
        """Return the factor on the variances of a source; 1 before its first increment."""
        return self.clones[name].noise_factor if name in self.clones else 1.0

    def with_noise_factor(self, name: str, factor: float) -> Estimate:
        """Return the estimate with another factor on the variances of a source."""
        return replace(self, clones={**self.clones, name: replace(self.clones[name], noise_factor=factor)})

    def with_refusal(self, name: str) -> Estimate:
        """Return the estimate with one more refused increment since a clone."""
        clone = self.clones[name]
        return replace(self, clones={**self.clones, name: replace(clone, refusals=clone.refusals + 1)})

    def with_renamed_clone(self, name: str, new_name: str) -> Estimate:
        """Return the estimate whose clone ``name`` replaces the clone ``new_name``."""
        clones = dict(self.clones)
        order = np.arange(len(self.covariance))
        order[self.clone_errors(new_name)] = order[self.clone_errors(name)]
        order = np.delete(order, self.clone_errors(name))
        clones[new_name] = clones.pop(name)
        return replace(
            self,
            covariance=self.covariance[np.ix_(order, order)],
            cross_covariance=self.cross_covariance[order],
            clones=clones,
        )

    def with_velocity_sigma(self, sigma_m_s: float, interval_s: float = 0.0) -> Estimate:
        """Return the estimate with a velocity of standard deviation ``sigma_m_s``, uncorrelated with the
        past.

        The error of the velocity results from unknown accelerations during ``interval_s`` before the estimate
        (white noise), which have displaced the position: otherwise a position measured a moment later would
        attribute the displacement of the whole interval to that moment.
        """
        P, cross = self.covariance.copy(), self.cross_covariance.copy()
        variance = sigma_m_s**2 * np.eye(3)
        P[VELOCITY] = P[:, VELOCITY] = 0.0
        P[VELOCITY, VELOCITY] = variance
        P[POSITION, VELOCITY] = P[VELOCITY, POSITION] = variance * interval_s / 2.0
        P[POSITION, POSITION] += variance * interval_s**2 / 3.0
        cross[VELOCITY] = 0.0
        return replace(self, covariance=P, cross_covariance=cross, consecutive_refusals=0)
