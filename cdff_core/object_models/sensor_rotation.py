# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotation of a sensor between measurements: the state of a tracked body in axes that do not rotate.

With an attitude, velocity and rate of a state are relative to inertial axes that coincide with those of the
sensor at the time of the state. Without any attitude, they are relative to the sensor.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import FrameGraph, se3
from cdff_common.geometry.covariance import symmetrised
from cdff_common.interfaces.dfpc import Sample
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState
from cdff_core.rigid_body.sensor_attitude import Attitude, SensorAttitude

#: Largest number of attitudes during a scan; the rotation between them is interpolated.
_MAX_KNOTS = 16


class SensorRotation:
    """Rotation of a sensor between two times, computed from its measured attitudes.

    Parameters
    ----------
    frames : FrameGraph
        Mounts, see ``SensorAttitude``.
    max_age_s : float
        Largest distance of a requested time from the nearest attitude.
    rate_sigma_radps : float
        Standard deviation of the rate of the sensor while its attitude is missing.
    """

    def __init__(self, frames: FrameGraph, max_age_s: float, rate_sigma_radps: float) -> None:
        self._attitude = SensorAttitude(frames, max_age_s)
        self._rate_sigma = rate_sigma_radps

    def give(self, sample: Sample) -> None:
        """Store an attitude."""
        self._attitude.give(sample)

    def reason(self, stamp_ns: int, frame: str) -> str:
        """Return why the attitude at a time is not used; empty if it is, or if none was ever given."""
        if not self._attitude.is_given:
            return ""
        try:
            self._attitude.at(stamp_ns, frame)
        except RefusedError as error:
            return str(error.reasons[0])
        return ""

    @property
    def is_inertial(self) -> bool:
        """True if velocities are relative to inertial axes."""
        return self._attitude.is_given

    def at_stamp(self, points_m: FloatArray, times_s: FloatArray, stamp_ns: int, frame: str) -> FloatArray:
        """Return points (n, 3), measured at times (n,) relative to the stamp, in the axes of the sensor at
        the stamp; unchanged without attitudes.
        """
        if not times_s.any():
            return points_m
        knots_s = np.linspace(min(float(times_s.min()), 0.0), max(float(times_s.max()), 0.0), _MAX_KNOTS)
        end = self._at(stamp_ns, frame)
        attitudes = [self._at(stamp_ns + round(1e9 * t), frame) for t in knots_s]
        if end is None or any(attitude is None for attitude in attitudes):
            return points_m
        turns = np.array([se3.log_so3(end.R.T @ a.R) for a in attitudes if a is not None])
        vectors = np.column_stack([np.interp(times_s, knots_s, turns[:, axis]) for axis in range(3)])
        return np.asarray(np.einsum("nij,nj->ni", se3.exp_so3(vectors), points_m))

    def applied(self, predicted: TrackedState, start_ns: int, frame: str) -> TrackedState:
        """Return a prediction from an earlier time in the axes of the sensor at its time."""
        if not self._attitude.is_given:
            return predicted
        start, end = self._at(start_ns, frame), self._at(predicted.stamp_ns, frame)
        if start is None or end is None:
            return self._with_unknown_rotation(predicted, 1e-9 * (predicted.stamp_ns - start_ns))
        R = end.R.T @ start.R
        T = se3.transform(R @ predicted.T[:3, :3], R @ predicted.T[:3, 3])
        velocity = R @ predicted.velocity
        J = np.eye(STATE_ERROR_DIM)
        for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
            J[rows, rows] = R
        # Both attitudes have errors; in the axes of the sensor at the end.
        noise = end.R.T @ (start.covariance + end.covariance) @ end.R
        by_rotation = _by_rotation(T, velocity)
        covariance = J @ predicted.covariance @ J.T + by_rotation @ noise @ by_rotation.T
        return replace(predicted, T=T, velocity=velocity, covariance=symmetrised(covariance))

    def _at(self, stamp_ns: int, frame: str) -> Attitude | None:
        with suppress(RefusedError):
            return self._attitude.at(stamp_ns, frame)
        return None

    def _with_unknown_rotation(self, predicted: TrackedState, duration_s: float) -> TrackedState:
        """Return a prediction whose covariance covers an unknown rate of the sensor."""
        by_rotation = _by_rotation(predicted.T, predicted.velocity)
        by_rate = np.zeros((STATE_ERROR_DIM, 3))
        by_rate[6:9], by_rate[9:12] = -se3.skew(predicted.T[:3, 3]), predicted.T[:3, :3].T
        J = duration_s * by_rotation + by_rate
        covariance = predicted.covariance + self._rate_sigma**2 * (J @ J.T)
        return replace(predicted, covariance=symmetrised(covariance))


def _by_rotation(T: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the derivative (20, 3) of the errors of a state by a rotation of the axes of the sensor."""
    J = np.zeros((STATE_ERROR_DIM, 3))
    J[:3], J[3:6], J[6:9] = -se3.skew(T[:3, 3]), np.eye(3), -se3.skew(velocity)
    return J
