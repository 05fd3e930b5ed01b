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
        clones = {
            name: replace(clone, pose=_moved(clone.pose, correction[CORE + 6 * k : CORE + 6 * k + 6]))
            for k, (name, clone) in enumerate(self.clones.items())
        }
        return replace(
            self,
            pose=_moved(self.pose, correction[POSE]),
            velocity=self.velocity + correction[VELOCITY],
            biases=self.biases + correction[9:15],
            slip=self.slip + correction[SLIP],
            clones=clones,
        )

    def cloned(self, name: str, measured: UncertainTransform) -> Estimate:
        """With the pose of now as the clone ``name``."""
        kept = self.without(name)
        n = len(kept.covariance)
        pick = np.r_[0:n, 0:6]
        return replace(
            kept,
            covariance=kept.covariance[np.ix_(pick, pick)],
            since=kept.since[pick],
            clones={**kept.clones, name: Clone(self.pose, measured, self.stamp_ns)},
        )

    def without(self, name: str) -> Estimate:
        """With the clone ``name`` forgotten, where there is one."""
        if name not in self.clones:
            return self
        gone = self.index(name)
        pick = np.r_[0 : gone.start, gone.stop : len(self.covariance)]
        clones = {key: clone for key, clone in self.clones.items() if key != name}
        return replace(self, covariance=self.covariance[np.ix_(pick, pick)], since=self.since[pick], clones=clones)


def _moved(T: FloatArray, error: FloatArray) -> FloatArray:
    return se3.transform(se3.exp_so3(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])
