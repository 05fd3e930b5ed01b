# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start of the calibration of a camera and an inertial measurement unit by their angular rates.

The offset is that at which the rates of both correlate most; images whose rotation contradicts the IMU are
dropped, for example those with the wrong one of the two poses that a view of a plane permits.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.calibration.imu_integrals import Readings, has_readings

#: Least number of connected pairs of images, and longest time between two connected images, seconds.
LEAST_INTERVALS, LONGEST_INTERVAL_S = 20, 0.5
#: Largest offset of the clocks that is tried by default, and step of the search, seconds.
LARGEST_OFFSET_S, _OFFSET_STEP_S = 1.0, 0.004
#: Least RMS of the angular rate of the camera, rad/s, and least correlation of both rates.
_LEAST_RATE, _LEAST_CORRELATION = 0.1, 0.7
#: Largest difference of the rotation between two images by unit and camera, radians, or number of medians;
#: a run of fewer images than the last number that agrees with no neighbour is dropped.
_LEAST_GATE, _GATE_MEDIANS, _SHORTEST_RUN = np.deg2rad(2.0), 8.0, 4
#: Largest number of passes in which the set of pairs that agree may change.
_LARGEST_PASSES = 30
#: Gaps of the readings longer than this number of periods are not integrated.
_GAP_PERIODS = 4.0


def require_intervals(count: int, images: int) -> None:
    """Raise DegenerateGeometryError if there are too few connected pairs of images."""
    if count < LEAST_INTERVALS:
        raise DegenerateGeometryError(
            f"{count} pairs of successive images, at most {LONGEST_INTERVAL_S:g} s apart, of {images} images "
            f"with the board have readings of the IMU between them: expected at least {LEAST_INTERVALS}; "
            "record images at 10 Hz or more, with the board in view",
            ("motion",),
        )


def connected(
    t_s: FloatArray, readings: Readings, offset_s: float, margin_s: float = 0.0
) -> NDArray[np.int64]:
    """Return the indices k of the images that readings without gaps connect to image k + 1.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Times of the images, seconds.
    offset_s : float
        Time to add to the stamps of the readings.
    margin_s : float
        Time before and after both images for which there must be readings, too.
    """
    duration_s = np.diff(t_s)
    gap_s = _GAP_PERIODS * float(np.median(np.diff(readings.t_s)))
    own = has_readings(readings, t_s[:-1] - offset_s - margin_s, duration_s + 2 * margin_s, gap_s)
    is_short = (duration_s > 1e-4) & (duration_s <= LONGEST_INTERVAL_S)
    return np.flatnonzero(is_short & own)


def agreed_rotation(
    t_s: FloatArray, T_camera_board: FloatArray, readings: Readings, largest_offset_s: float
) -> tuple[float, FloatArray, BoolArray]:
    """Return the offset, the rotation ``R_camera_imu``, and a mask of the images whose rotations agree.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Times of the images, seconds.
    T_camera_board : ndarray, shape (n, 4, 4)
    readings : Readings
    largest_offset_s : float
        Largest absolute offset that is tried.

    Raises
    ------
    DegenerateGeometryError
        If fewer than ``LEAST_INTERVALS`` pairs of images are connected, the camera does not rotate, its
        rotation is not that of the IMU, or the set of the images that agree does not become constant.
    """
    is_kept = np.ones(len(t_s), dtype=bool)
    offset_s, R = 0.0, np.eye(3)
    # Each pass drops images, so that it ends at the latest when too few pairs remain.
    for attempt in itertools.count():
        kept = np.flatnonzero(is_kept)
        duration_s = np.diff(t_s[kept])
        pairs = np.flatnonzero((duration_s > 1e-4) & (duration_s <= LONGEST_INTERVAL_S))
        require_intervals(len(pairs), len(t_s))
        R_camera_board = T_camera_board[kept, :3, :3]
        motions = R_camera_board[pairs] @ np.swapaxes(R_camera_board[pairs + 1], 1, 2)
        start_s, duration_s = t_s[kept][pairs], duration_s[pairs]
        rates = se3.log_so3(motions) / duration_s[:, None]
        limit = 1.5 * float(np.linalg.norm(readings.rate_rad_s, axis=1).max()) + 0.5
        is_known = np.isin(pairs, connected(t_s[kept], readings, offset_s)) if attempt else pairs >= 0
        is_used = is_known & (np.linalg.norm(rates, axis=1) < limit)
        if attempt == 0:
            require_intervals(int(is_used.sum()), len(t_s))
            offset_s = _best_offset(start_s, duration_s, rates, is_used, readings, largest_offset_s)
            is_known = np.isin(pairs, connected(t_s[kept], readings, offset_s))
            is_used &= is_known
        own = _mean_rates(readings, start_s - offset_s, duration_s)
        R, bias = _rotation(rates[is_used], own[is_used])
        # Again with the pairs that agree, until they do not change.
        for _ in range(_LARGEST_PASSES):
            previous = is_used
            difference = np.linalg.norm(own @ R.T + bias - rates, axis=1) * duration_s
            gate = max(_LEAST_GATE, _GATE_MEDIANS * float(np.median(difference[is_used])))
            is_used = is_known & (difference < gate)
            require_intervals(int(is_used.sum()), len(t_s))
            R, bias = _rotation(rates[is_used], own[is_used])
            if (is_used == previous).all():
                break
        else:
            raise DegenerateGeometryError(
                f"the pairs of images whose rotation agrees with the IMU still change after "
                f"{_LARGEST_PASSES} passes ({int(is_used.sum())} of {len(pairs)}): expected a constant set; "
                "check the poses of the board and that camera and IMU are rigidly connected",
                ("roll", "pitch", "yaw"),
            )
        is_wrong = np.zeros(len(kept) - 1, dtype=bool)
        is_wrong[pairs[is_known & ~is_used]] = True
        runs = np.split(np.arange(len(kept)), np.flatnonzero(is_wrong) + 1)
        isolated = [run for run in runs if len(run) < _SHORTEST_RUN and is_wrong.any()]
        if not isolated:
            break
        is_kept[kept[np.concatenate(isolated)]] = False
    return offset_s, R, is_kept


def _mean_rates(readings: Readings, t_s: FloatArray, duration_s: FloatArray) -> FloatArray:
    """Return the mean angular rates ``(k, 3)`` over intervals."""
    step = 0.5 * (readings.rate_rad_s[1:] + readings.rate_rad_s[:-1]) * np.diff(readings.t_s)[:, None]
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    ends = [
        np.stack([np.interp(t, readings.t_s, a) for a in angle.T], axis=-1) for t in (t_s, t_s + duration_s)
    ]
    return np.asarray((ends[1] - ends[0]) / duration_s[:, None])


def _rotation(rates: FloatArray, own: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation and the constant of ``rates = R own + constant`` (least squares)."""
    a, b = rates - rates.mean(axis=0), own - own.mean(axis=0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return R, np.asarray(rates.mean(axis=0) - R @ own.mean(axis=0))


def _best_offset(
    start_s: FloatArray,
    duration_s: FloatArray,
    rates: FloatArray,
    is_used: BoolArray,
    readings: Readings,
    largest_offset_s: float,
) -> float:
    """Return the offset at which the angular rates correlate most."""
    rms = float(np.sqrt((rates[is_used] ** 2).sum(axis=1).mean()))
    if rms < _LEAST_RATE:
        raise DegenerateGeometryError(
            f"the camera rotates with {rms:.3f} rad/s (RMS): expected at least {_LEAST_RATE:g}; rotate "
            "camera and IMU together about all axes, with the board in view",
            ("roll", "pitch", "yaw"),
        )
    best, result = -1.0, 0.0
    steps = int(np.ceil(largest_offset_s / _OFFSET_STEP_S))
    for offset_s in _OFFSET_STEP_S * np.arange(-steps, steps + 1):
        at = start_s - offset_s
        has_own = is_used & (at >= readings.t_s[0]) & (at + duration_s <= readings.t_s[-1])
        if has_own.sum() < max(LEAST_INTERVALS, is_used.sum() // 2):
            continue
        a, b = rates[has_own], _mean_rates(readings, at[has_own], duration_s[has_own])
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        s = np.linalg.svd(a.T @ b, compute_uv=False)
        sign = np.sign(np.linalg.det(a.T @ b)) or 1.0
        score = float((s[0] + s[1] + sign * s[2]) / max(np.sqrt((a**2).sum() * (b**2).sum()), 1e-12))
        if score > best:
            best, result = score, float(offset_s)
    if best < _LEAST_CORRELATION:
        raise DegenerateGeometryError(
            f"the angular rates of camera and IMU correlate by {max(best, 0.0):.2f} at most, with offsets of "
            f"the clocks up to {largest_offset_s:g} s: expected at least {_LEAST_CORRELATION:g}; check that "
            "both are fixed to each other and that the rates are in rad/s, or allow a larger offset",
            ("roll", "pitch", "yaw"),
        )
    return result
