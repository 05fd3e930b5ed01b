# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the filter knows at one time: the robot's state, poses it was at, and the covariance of all of it.

Errors, in this order: position and rotation of ``T_site_base`` (world side, as all covariances here), velocity in the
site, gyro bias, accelerometer bias (base axes), slip ahead, aside and up as shares of the way; then six for each clone.
A clone is the pose at which an odometry last said where it was (Roumeliotis and Burdick 2002,
doi:10.1109/ROBOT.2002.1014801): an increment is measured between two poses, and so corrects both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray

POSITION, ROTATION, VELOCITY, GYRO, FORCE, SLIP = (slice(k, k + 3) for k in range(0, 18, 3))
POSE = slice(0, 6)
CORE = 18
#: Errors that the time line keeps of each estimate: pose and gyro bias, whose motion in time is nearly their own.
LINE = np.r_[0:6, 9:12]


@dataclass(frozen=True, slots=True, eq=False)
class Clone:
    """Where the robot was when a source last spoke.

    Attributes
    ----------
    pose : array, shape (4, 4)
        ``T_site_base`` then; of an anchor ``T_site_origin`` of the source's own frame.
    measured : UncertainTransform
        What the source said then: ``T_origin_sensor``.
    stamp_ns : int
    """

    pose: FloatArray
    measured: UncertainTransform
    stamp_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """State and covariance at one time; never changed, only replaced.

    Attributes
    ----------
    pose : array, shape (4, 4)
        ``T_site_base``.
    velocity, slip : array, shape (3,)
    biases : array, shape (6,)
        Of gyro (rad/s) and accelerometer (m/s^2).
    covariance : array, shape (18 + 6 c, 18 + 6 c)
    since : array, shape (18 + 6 c, 9)
        Covariance of the errors with those of ``LINE`` at the estimate before.
    clones : dict of str to Clone
        In the order of their errors.
    refused : int
        Increments that were refused one after the other.
    """

    stamp_ns: int
    pose: FloatArray
    velocity: FloatArray
    biases: FloatArray
    slip: FloatArray
    covariance: FloatArray
    since: FloatArray
    clones: dict[str, Clone]
    refused: int = 0

    def index(self, name: str) -> slice:
        """Errors of a clone."""
        first = CORE + 6 * list(self.clones).index(name)
        return slice(first, first + 6)

    @property
    def transform(self) -> UncertainTransform:
        """``T_site_base`` with its covariance."""
        return UncertainTransform(self.pose, self.covariance[POSE, POSE])

    def moved(self, correction: FloatArray) -> Estimate:
        """The state with a correction of its errors added; covariances stay."""
        errors = np.concatenate([correction[POSE], correction[CORE:]]).reshape(-1, 6)
        poses = np.array([self.pose, *(clone.pose for clone in self.clones.values())])
        poses[:, :3, :3] = se3.exp_so3(errors[:, 3:]) @ poses[:, :3, :3]
        poses[:, :3, 3] += errors[:, :3]
        return replace(
            self,
            pose=poses[0],
            velocity=self.velocity + correction[VELOCITY],
            biases=self.biases + correction[9:15],
            slip=self.slip + correction[SLIP],
            clones={
                name: Clone(pose, clone.measured, clone.stamp_ns)
                for pose, (name, clone) in zip(poses[1:], self.clones.items(), strict=True)
            },
        )

    def cloned(self, name: str, measured: UncertainTransform) -> Estimate:
        """With the pose of now as the clone ``name``."""
        clones = {**self.clones, name: Clone(self.pose, measured, self.stamp_ns)}
        n, size = len(self.covariance), CORE + 6 * len(clones)
        covariance, since = np.empty((size, size)), np.empty((size, len(LINE)))
        covariance[:n, :n], since[:n] = self.covariance, self.since
        first = CORE + 6 * list(clones).index(name)
        at = slice(first, first + 6)
        covariance[at], since[at] = covariance[POSE], since[POSE]
        covariance[:, at] = covariance[:, POSE]
        return replace(self, covariance=covariance, since=since, clones=clones)
