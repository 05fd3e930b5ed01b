# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of a sensor in the inertial frame at any time, from measured attitudes of its carrier."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import FrameNotFoundError, InputError, RefusedError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample

#: Number of stored attitudes.
_MAX_ATTITUDES = 1000
#: Standard deviation of an attitude without covariance, rad.
_DEFAULT_SIGMA_RAD = 1e-3
#: Standard deviation of the rate between attitudes, relative to this rate.
_RATE_ERROR = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """Attitude of a sensor.

    Attributes
    ----------
    R : ndarray, shape (3, 3)
        R_inertial_sensor.
    covariance : ndarray, shape (3, 3)
        Of its rotation vector in the inertial frame, square radians.
    frame : str
        Name of the inertial frame.
    id : str
        Id of the newest sample.
    """

    R: FloatArray
    covariance: FloatArray
    frame: str
    id: str

    def rotated(self, pose: UncertainTransform) -> UncertainTransform:
        """Return a pose in the frame of the sensor in the axes of the inertial frame, with the same origin.

        The covariance contains the error of the attitude; it is absent if that of the pose is.
        """
        T = se3.transform(self.R @ pose.matrix[:3, :3], self.R @ pose.matrix[:3, 3])
        if pose.covariance is None:
            return UncertainTransform(T)
        J, by_attitude = np.zeros((6, 6)), np.vstack([-se3.skew(T[:3, 3]), np.eye(3)])
        J[:3, :3] = J[3:, 3:] = self.R
        covariance = J @ pose.covariance @ J.T + by_attitude @ self.covariance @ by_attitude.T
        return UncertainTransform(T, covariance)


class SensorAttitude:
    """Attitudes of the last minutes, interpolated, and extrapolated with the rate of the newest two.

    Parameters
    ----------
    frames : FrameGraph
        Mounts, for attitudes of another frame than that of the sensor, such as a star tracker's.
    max_age_s : float
        Largest distance of a requested time from the nearest attitude.
    """

    def __init__(self, frames: FrameGraph, max_age_s: float) -> None:
        self._frames, self._max_age_s = frames, max_age_s
        self._names: tuple[str, str] | None = None
        self._stamps_ns: list[int] = []
        self._rotations: list[FloatArray] = []
        self._covariance = np.zeros((3, 3))
        self._id = ""

    @property
    def is_given(self) -> bool:
        """True if an attitude has arrived."""
        return self._names is not None

    def give(self, sample: Sample) -> None:
        """Store an attitude T_inertial_frame; only its rotation is used.

        Raises
        ------
        InputError
            If its frames differ from those of the earlier attitudes, or it is not newer.
        """
        value, stamps_ns = sample.value, self._stamps_ns
        names = (value.parent_frame or sample.frame or "inertial", value.child_frame or sample.child or "")
        if self._names not in (None, names):
            raise InputError(f"attitude: frames {names}, expected {self._names} as before")
        if stamps_ns and sample.stamp_ns <= stamps_ns[-1]:
            raise InputError(f"attitude at {sample.stamp_ns} ns, expected after {stamps_ns[-1]} ns")
        transform = value.transform
        covariance = _DEFAULT_SIGMA_RAD**2 * np.eye(3)
        if transform.covariance is not None and np.isfinite(transform.covariance[3:, 3:]).all():
            covariance = np.asarray(transform.covariance[3:, 3:])
        self._names, self._covariance, self._id = names, covariance, sample.id
        stamps_ns.append(sample.stamp_ns)
        self._rotations.append(transform.matrix[:3, :3])
        if len(stamps_ns) > _MAX_ATTITUDES:
            del stamps_ns[0], self._rotations[0]

    def at(self, stamp_ns: int, frame: str) -> Attitude:
        """Return the attitude of a frame at a time.

        Raises
        ------
        RefusedError
            ``attitude_missing`` without attitudes near this time, ``mount_of_attitude_unknown`` if the
            attitude is that of a frame that is not connected with the given one.
        """
        if self._names is None:
            raise RefusedError(f"no attitude of {frame}", ["attitude_missing"])
        parent, child = self._names
        R, sigma_rad = self._rotation_at(stamp_ns, frame)
        covariance = self._covariance + sigma_rad**2 * np.eye(3)
        if child and child != frame:
            try:
                R = R @ self._frames.lookup(child, frame, stamp_ns).matrix[:3, :3]
            except FrameNotFoundError as error:
                raise RefusedError(
                    f"attitude of {frame}: its mount on {child} is unknown", ["mount_of_attitude_unknown"]
                ) from error
        return Attitude(R, covariance, parent, self._id)

    def _rotation_at(self, stamp_ns: int, frame: str) -> tuple[FloatArray, float]:
        """Return the rotation (3, 3) of the carrier and the error of its interpolation, rad."""
        stamps_ns = self._stamps_ns
        row = min(bisect_left(stamps_ns, stamp_ns), len(stamps_ns) - 1)
        if stamps_ns[row] == stamp_ns:
            return self._rotations[row], 0.0
        # Between this attitude and the previous one, or after both.
        gap_s = 1e-9 * min(abs(stamp_ns - stamps_ns[row]), abs(stamp_ns - stamps_ns[row - 1]))
        if row == 0 or gap_s > self._max_age_s:
            raise RefusedError(
                f"attitude of {frame}: the nearest one is {gap_s:.3g} s away, expected at most "
                f"{self._max_age_s:g} s and one before",
                [f"attitude_missing:{gap_s:.3g}s"],
            )
        rate = self._rate(row)
        # The rate changes during the interval as it did since the previous one.
        change = np.linalg.norm(rate - self._rate(row - 1)) if row > 1 else 0.0
        sigma_rad = gap_s * (_RATE_ERROR * float(np.linalg.norm(rate)) + float(change))
        turned = se3.exp_so3(rate * 1e-9 * (stamp_ns - stamps_ns[row]))
        return np.asarray(self._rotations[row] @ turned), sigma_rad

    def _rate(self, row: int) -> FloatArray:
        """Return the rate (3,) of the carrier, rad/s, in its axes, from the attitude before a row to it."""
        interval_s = 1e-9 * (self._stamps_ns[row] - self._stamps_ns[row - 1])
        return np.asarray(se3.log_so3(self._rotations[row - 1].T @ self._rotations[row]) / interval_s)
