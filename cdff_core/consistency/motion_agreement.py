# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Agreement of the motions that two sensors measure: rotation between their mounts, offset of their clocks.

Over windows between samples of the slower stream, the motion by the faster stream is computed at each offset
of a grid. The likelihood of an offset is that at its most likely rotation, so that a wrong mount does not
look like a wrong clock, nor the reverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.robust import chi_squared_quantile
from cdff_common.geometry.se3 import FloatArray
from cdff_core.consistency.limits import Limits
from cdff_core.consistency.moments import Moments, fitted_rotation, rotation_information
from cdff_core.consistency.motion_stream import MotionStream

#: Grid of the offsets: step and bound, seconds.
STEP_S, BOUND_S = 0.05, 1.5
OFFSETS_S = np.linspace(-BOUND_S, BOUND_S, round(2 * BOUND_S / STEP_S) + 1)
_ZERO = len(OFFSETS_S) // 2
#: Shortest and longest window, seconds.
_SHORTEST_S, _LONGEST_S = 0.3, 2.0
#: Number of windows after which the weight of a window is 1/e.
_MEMORY = 150.0
#: Least number of windows of an estimate.
LEAST_WINDOWS = 8
#: Least motion of a window: rotation in rad and translation in m; windows at rest have no information.
_LEAST_ROTATION_RAD, _LEAST_TRANSLATION_M = 0.003, 0.02
#: Largest plausible rotation of a window, rad: an odometry that restarts is no motion.
_GREATEST_ROTATION_RAD = 1.0
#: Standard deviations of errors of the model: rotation in rad (bias of a gyro, products of small rotations)
#: and translation in m (lever arms).
_ROTATION_FLOOR_RAD, _TRANSLATION_FLOOR_M = 7e-4, 0.01
#: Number of consecutive windows whose errors are correlated, by which the information is divided: slip, bias
#: and terrain last for several windows.
CORRELATION = 4.0
#: Standard deviation of a rotation above which its axis counts as unobservable, rad.
_UNOBSERVABLE_RAD = float(np.radians(10.0))
_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class MotionEstimate:
    """Relation of two streams.

    Attributes
    ----------
    samples : float
        Number of windows.
    offset_s, offset_sigma_s : float
        Offset of the stamps of the second stream to those of the first, and its standard deviation.
    rotation : ndarray, shape (3, 3)
        Rotation from the base axes by the second sensor to those by the first one; the identity if the mounts
        agree.
    covariance : ndarray, shape (3, 3)
        Covariance of ``Log(rotation)``, rad².
    unobservable : tuple of str
        Axes of the base about which the rotation is not observable.
    offset_excess, rotation_excess : float
        Ratio of the test statistic to its limit; above 1 the offset, or rotation, is not admissible.
    offset_log_likelihood : ndarray, shape (k,)
        Logarithm of the likelihood of each offset in ``OFFSETS_S``.
    groups : tuple of Moments
        Moments at the most likely offset.
    """

    samples: float
    offset_s: float
    offset_sigma_s: float
    rotation: FloatArray
    covariance: FloatArray
    unobservable: tuple[str, ...]
    offset_excess: float
    rotation_excess: float
    offset_log_likelihood: FloatArray
    groups: tuple[Moments, ...]

    @property
    def angle_rad(self) -> float:
        """Angle of the rotation."""
        return float(np.linalg.norm(se3.log_so3(self.rotation)))


@dataclass(frozen=True, slots=True, eq=False)
class OffsetLikelihood:
    """Logarithm of the likelihood (k,) of each offset in ``OFFSETS_S`` of the second stream to the first."""

    first: str
    second: str
    values: FloatArray


class MotionAgreement:
    """Comparison of the motions of two streams of one robot.

    Parameters
    ----------
    first, second : MotionStream
        Motions in base axes. Of wheels, the first one, only the heading is compared.
    planar : bool
        True if the first stream measures the motion in the plane of the wheels only.
    """

    def __init__(self, first: MotionStream, second: MotionStream, *, planar: bool = False) -> None:
        self._first, self._second = first, second
        self._since_ns: int | None = None
        k, axes = len(OFFSETS_S), (2,) if planar else (0, 1, 2)
        self._rotation = Moments.empty(k, axes, _ROTATION_FLOOR_RAD**2)
        self._translation = Moments.empty(k, (0, 1, 2), _TRANSLATION_FLOOR_M**2)
        self._has_translation = first.has_translation and second.has_translation
        self._is_first_slower = True

    @property
    def groups(self) -> tuple[Moments, ...]:
        """Moments of the rotations and, if both measure it, the translations."""
        return (self._rotation, self._translation) if self._has_translation else (self._rotation,)

    def update(self) -> None:
        """Add the windows that both streams have completed."""
        first, second = self._first, self._second
        if first.newest_ns is None or second.newest_ns is None or min(len(first), len(second)) < 3:
            return
        is_first_slower = first.period_s >= second.period_s
        slow, fast = (first, second) if is_first_slower else (second, first)
        if self._since_ns is None:
            self._since_ns = max(first.newest_ns, second.newest_ns) - int(4 * BOUND_S * 1e9)
        origin_ns = self._since_ns
        slow_s, slow_sums, slow_breaks = slow.arrays(origin_ns, origin_ns)
        fast_s, fast_sums, fast_breaks = fast.arrays(origin_ns - int(BOUND_S * 1e9), origin_ns)
        edges = _window_edges(slow_s, fast_s)
        if len(edges) < 2:
            return
        self._since_ns = origin_ns + round(slow_s[edges[-1]] * 1e9)
        start, end = edges[:-1], edges[1:]
        length_s = slow_s[end] - slow_s[start]
        slow_motion = slow_sums[end] - slow_sums[start]
        fast_motion = _sums_at(fast_s, fast_sums, slow_s[end]) - _sums_at(fast_s, fast_sums, slow_s[start])
        usable = (length_s <= _LONGEST_S) & _is_moving(slow_motion, fast_motion)
        usable &= ~_is_interrupted(slow_s[start], slow_s[end], slow_breaks, 0.0)
        usable &= ~_is_interrupted(slow_s[start], slow_s[end], fast_breaks, BOUND_S)
        if not usable.any():
            return
        shape = (len(OFFSETS_S), int(usable.sum()), 6)
        slow_usable = np.broadcast_to(slow_motion[usable], shape)
        a, b = (
            (slow_usable, fast_motion[:, usable])
            if is_first_slower
            else (fast_motion[:, usable], slow_usable)
        )
        keep = float(np.exp(-shape[1] / _MEMORY))
        self._rotation = self._rotation.added(a[..., :3], b[..., :3], keep)
        if self._has_translation:
            self._translation = self._translation.added(a[..., 3:], b[..., 3:], keep)
        self._is_first_slower = is_first_slower

    def estimate(self, limits: Limits) -> MotionEstimate | None:
        """Return the relation of the streams; None with too few windows."""
        if self._rotation.n < LEAST_WINDOWS:
            return None
        R = fitted_rotation(self.groups)
        likelihood: FloatArray = np.sum([g.log_likelihood(R) for g in self.groups], axis=0) / CORRELATION
        weight = np.exp(likelihood - likelihood.max())
        weight /= weight.sum()
        # The faster stream is read later by the offset.
        sign = 1.0 if self._is_first_slower else -1.0
        mean_s = float(weight @ OFFSETS_S)
        sigma_s = float(np.sqrt(weight @ (OFFSETS_S - mean_s) ** 2 + STEP_S**2 / 12.0))
        best = int(np.argmax(likelihood))
        within = np.abs(OFFSETS_S) <= limits.offset_s + 1e-9
        gain = float(likelihood.max() - likelihood[within].max())
        groups = tuple(group.at(best) for group in self.groups)
        information = rotation_information(groups, R[best]) / CORRELATION
        covariance: FloatArray = np.linalg.inv(information + 1e-2 * np.eye(3)).astype(np.float64)
        d = se3.log_so3(R[best])
        admissible = covariance + limits.mount_sigma_rad**2 * np.eye(3)
        gain_of_rotation = sum(
            float(group.log_likelihood(R[best]) - group.log_likelihood(np.eye(3))) for group in groups
        )
        # Both tests must fail: Wald's with the admissible mount error, and the ratio of likelihoods, which
        # also compares rotations far from each other.
        statistic = min(float(d @ np.linalg.solve(admissible, d)), 2.0 * gain_of_rotation / CORRELATION)
        sigma = np.sqrt(np.diag(covariance))
        return MotionEstimate(
            samples=self._rotation.n,
            offset_s=sign * mean_s,
            offset_sigma_s=sigma_s,
            rotation=R[best],
            covariance=covariance,
            unobservable=tuple(axis for axis, s in zip(_AXES, sigma, strict=True) if s > _UNOBSERVABLE_RAD),
            offset_excess=gain / float(-np.log(limits.false_alarm)),
            rotation_excess=statistic / chi_squared_quantile(1.0 - limits.false_alarm, 3),
            offset_log_likelihood=likelihood if self._is_first_slower else likelihood[::-1],
            groups=groups,
        )


def _window_edges(slow_s: FloatArray, fast_s: FloatArray) -> np.ndarray:
    """Return the indices of slow samples that bound windows within the time of the fast stream."""
    edges: list[int] = []
    for i, t_s in enumerate(slow_s):
        if t_s - BOUND_S < fast_s[0] or t_s < 0.0:
            continue
        if t_s + BOUND_S > fast_s[-1]:
            break
        if not edges or t_s - slow_s[edges[-1]] >= _SHORTEST_S:
            edges.append(i)
    return np.array(edges, dtype=np.int64)


def _sums_at(t_s: FloatArray, sums: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return the sums (k, m, 6) of a stream at times (m,), each later by the offsets of the grid."""
    times = at_s[None, :] + OFFSETS_S[:, None]
    return np.stack([np.interp(times, t_s, sums[:, j]) for j in range(6)], axis=-1)


def _is_moving(slow: FloatArray, fast: FloatArray) -> np.ndarray:
    """Return whether the robot moves plausibly in windows (m, 6), (k, m, 6) according to both streams."""
    turn = np.maximum(np.linalg.norm(slow[:, :3], axis=1), np.linalg.norm(fast[..., :3], axis=2).max(axis=0))
    path = np.maximum(np.linalg.norm(slow[:, 3:], axis=1), np.linalg.norm(fast[..., 3:], axis=2).max(axis=0))
    is_moving = (turn > _LEAST_ROTATION_RAD) | (path > _LEAST_TRANSLATION_M)
    return np.asarray(is_moving & (turn < _GREATEST_ROTATION_RAD))


def _is_interrupted(
    start_s: FloatArray, end_s: FloatArray, breaks_s: FloatArray, margin_s: float
) -> np.ndarray:
    """Return whether an interruption lies in each window, extended by a margin."""
    if not len(breaks_s):
        return np.zeros(len(start_s), dtype=np.bool_)
    first = np.searchsorted(breaks_s, start_s - margin_s, side="right")
    return np.asarray(first < np.searchsorted(breaks_s, end_s + margin_s, side="right"))
