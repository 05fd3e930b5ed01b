# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude fixes, for example by the Sun: correction of the path by a Kalman update."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_core.stereo_odometry.consider_state import ConsiderState

#: Probability of a larger distance 1e-4 (chi-squared, 3 degrees of freedom): a fix beyond it is not used.
_GATE = 21.1
#: Largest difference between the times of a fix and of a pair.
_MAX_AGE_NS = 50_000_000


class AttitudeFixes:
    """The latest fix that was not used yet, and the attitude of the frame of the odometry by the first one.

    The first fix determines the rotation of the odometry's frame relative to the site; the covariance of a
    later fix contains that of the first one, since both relate to it.
    """

    def __init__(self) -> None:
        self._latest: tuple[int, UncertainTransform] | None = None
        self._R_site_vo: FloatArray | None = None
        self._first = np.zeros((3, 3))

    def add(self, stamp_ns: int, T_site_base: UncertainTransform) -> None:
        """Store a fix; raises InputError without a covariance, since a fix needs a weight."""
        if T_site_base.covariance is None:
            raise InputError("attitude: no covariance; expected one, with a large variance for an open axis")
        self._latest = (stamp_ns, T_site_base)

    def correct(
        self,
        state: ConsiderState,
        T_base_left: FloatArray,
        stamp_ns: int,
        calibration_covariance: FloatArray,
    ) -> tuple[ConsiderState, list[str]]:
        """Return ``T_vo_left`` at a time, corrected by a fix of that time, and reasons if it disagrees.

        ``calibration_covariance`` (k, k) is that of the estimated errors of the calibration.
        """
        if self._latest is None or abs(stamp_ns - self._latest[0]) > _MAX_AGE_NS:
            return state, []
        fix, self._latest = self._latest[1], None
        R_site_left = fix.matrix[:3, :3] @ T_base_left[:3, :3]
        fix_covariance = np.asarray(fix.covariance)[3:, 3:]
        if self._R_site_vo is None:
            self._R_site_vo = R_site_left @ state.matrix[:3, :3].T
            self._first = self._R_site_vo.T @ fix_covariance @ self._R_site_vo
            return state, []
        R_vo_left = self._R_site_vo.T @ R_site_left
        noise = self._first + self._R_site_vo.T @ fix_covariance @ self._R_site_vo
        innovation = se3.log_so3(R_vo_left @ state.matrix[:3, :3].T)
        return _updated(state, innovation, noise, calibration_covariance)


def _updated(
    state: ConsiderState, innovation: FloatArray, noise: FloatArray, calibration_covariance: FloatArray
) -> tuple[ConsiderState, list[str]]:
    """Return the Kalman update of a pose by a measured rotation error (3,); all errors are updated.

    The errors common to all motions and those of the calibration are considered: they contribute to the gain
    and keep their variance.
    """
    response = state.response
    P = np.asarray(state.to_transform(calibration_covariance).covariance)
    S = P[3:, 3:] + noise
    distance = float(innovation @ np.linalg.solve(S, innovation))
    if distance > _GATE:
        return state, [f"attitude_fix:{distance:.1f}>{_GATE}"]
    gain = np.linalg.solve(S, P[3:, :]).T
    error = gain @ innovation
    matrix = se3.transform(se3.exp_so3(error[3:]) @ state.matrix[:3, :3], state.matrix[:3, 3] + error[:3])
    keep = np.eye(6)
    keep[:, 3:] -= gain
    updated_noise = cov.symmetrised(keep @ state.noise @ keep.T + gain @ noise @ gain.T)
    return replace(state, matrix=matrix, noise=updated_noise, response=keep @ response), []
