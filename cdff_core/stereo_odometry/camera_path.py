# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Path of the camera, and prediction of its next pose."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import PoseTrajectory
from cdff_core.stereo_odometry.motion_prior import (
    GYRO_RAD,
    GYRO_RAD_S,
    SLIP_RATIO,
    WHEEL_M,
    Increment,
)

#: Maximum number of stored poses.
_LENGTH = 100_000
#: Standard deviations of the motion in a gap without other sensors: constant parts, and rotation per second.
_BLIND_M, _BLIND_RAD, _BLIND_RAD_S = 0.1, 0.05, 0.1


class CameraPath:
    """Poses ``T_vo_left`` in order of time; ``prior`` returns the increment of other sensors."""

    def __init__(self, prior: Callable[[int, int], Increment]) -> None:
        self._prior = prior
        self._stamps_ns: deque[int] = deque(maxlen=_LENGTH)
        self._poses: deque[UncertainTransform] = deque(maxlen=_LENGTH)
        self._measured: tuple[int, UncertainTransform] | None = None
        self._twist = np.zeros(6)

    @property
    def is_empty(self) -> bool:
        """True before the first pose."""
        return not self._poses

    def add(self, stamp_ns: int, pose: UncertainTransform, *, after_gap: bool = False) -> None:
        """Add a measured pose and, except after a gap, update the velocity."""
        if self._measured is not None and not after_gap:
            previous_ns, previous = self._measured
            step = se3.log_se3(se3.inverse(previous.matrix) @ pose.matrix)
            self._twist = step / (1e-9 * (stamp_ns - previous_ns))
        self._measured = (stamp_ns, pose)
        self._append(stamp_ns, pose)

    def repeat(self, stamp_ns: int) -> UncertainTransform:
        """Add the last pose again, with the covariance of the unobserved motion since then."""
        pose = UncertainTransform(self._poses[-1].matrix, self.across_gap(stamp_ns).covariance)
        self._append(stamp_ns, pose)
        return pose

    def predict(self, stamp_ns: int) -> FloatArray:
        """Return ``T_vo_left`` (4, 4) by other sensors, otherwise at constant velocity for at most 1 s."""
        last_ns, last = self._last()
        increment = self._prior(last_ns, stamp_ns)
        return last.matrix @ self._predict_motion(increment, 1e-9 * (stamp_ns - last_ns))

    @property
    def has_velocity(self) -> bool:
        """True if the velocity is known: after two measured poses without a gap between them."""
        return bool(self._twist.any())

    def across_gap(self, stamp_ns: int) -> UncertainTransform:
        """Return the predicted pose with the covariance of the motion unobserved by the camera."""
        last_ns, last = self._last()
        elapsed_s = 1e-9 * (stamp_ns - last_ns)
        translation, rotation = self._prior(last_ns, stamp_ns)
        sigma_m = _BLIND_M + float(np.linalg.norm(self._twist[:3])) * elapsed_s
        sigma_rad = _BLIND_RAD + (_BLIND_RAD_S + float(np.linalg.norm(self._twist[3:]))) * elapsed_s
        if translation is not None:
            sigma_m = WHEEL_M + SLIP_RATIO * float(np.linalg.norm(translation))
        if rotation is not None:
            sigma_rad = GYRO_RAD + GYRO_RAD_S * elapsed_s
        growth = np.diag([sigma_m**2] * 3 + [min(sigma_rad, np.pi) ** 2] * 3)
        covariance = np.zeros((6, 6)) if last.covariance is None else last.covariance
        expected = self._predict_motion((translation, rotation), elapsed_s)
        return UncertainTransform(last.matrix @ expected, covariance + growth)

    def trajectory(self, parent: str, child: str) -> PoseTrajectory | None:
        """Return all poses; None before the first one."""
        if not self._poses:
            return None
        unknown = np.full((6, 6), np.nan)
        return PoseTrajectory.from_arrays(
            np.array(self._stamps_ns),
            np.stack([p.matrix for p in self._poses]),
            np.stack([unknown if p.covariance is None else p.covariance for p in self._poses]),
            parent=parent,
            child=child,
        )

    def _append(self, stamp_ns: int, pose: UncertainTransform) -> None:
        self._stamps_ns.append(stamp_ns)
        self._poses.append(pose)

    def _last(self) -> tuple[int, UncertainTransform]:
        """Return time and pose of the last measurement; raises RefusedError without one."""
        if self._measured is None:
            raise RefusedError("no pose was measured yet", ["no_pose"])
        return self._measured

    def _predict_motion(self, increment: Increment, elapsed_s: float) -> FloatArray:
        """Return ``T_left1_left2`` after ``elapsed_s``: measured parts, and the rest at constant velocity."""
        translation, rotation = increment
        T = se3.exp_se3(self._twist * min(elapsed_s, 1.0))
        return se3.transform(
            T[:3, :3] if rotation is None else rotation, T[:3, 3] if translation is None else translation
        )
