# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mount of a sensor with a trajectory of its own, from motions of base and sensor (hand-eye calibration).

A motion ``A`` of the base and the motion ``B`` of the sensor over the same interval fulfil ``A X = X B`` with
the mount ``X``. Rotation and translation are estimated together [1]_: a planar drive, whose rotations have
one axis only, determines the yaw of the mount by its translations.

The distances of the base have an unknown scale, which is estimated too: slip, or a wrong radius, would
otherwise count as a lever arm in a drive with more curves to one side. Slip and slopes last longer than
a motion, so that the covariance contains the correlation of successive residuals [2]_.

References
----------
.. [1] Dornaika, F., Horaud, R. (1998). Simultaneous robot-world and hand-eye calibration. IEEE Transactions
  on Robotics and Automation 14(4). doi:10.1109/70.704233
.. [2] Newey, W. K., West, K. D. (1987). A simple, positive semi-definite, heteroskedasticity and
  autocorrelation consistent covariance matrix. Econometrica 55(3). doi:10.2307/1913610
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.calibration.estimate import WEAK_PRIOR, Mount
from cdff_core.calibration.motions import MotionPairs

#: Least number of motions.
LEAST_PAIRS = 10
#: Largest number of steps of the iteration.
_ITERATIONS = 100
#: Huber's constant: residuals above this number of standard deviations get less weight.
_HUBER = 1.345
#: Smallest standard deviation of a residual, metres and radians, so that exact data stay regular.
_FLOOR = np.array([1e-4] * 3 + [1e-5] * 3)
#: Prior standard deviation of the scale of the distances that the base measures, and limits of the scale: a
#: negative scale would be a mount that looks backwards.
_SCALE_SIGMA, _SCALES = 0.2, (0.5, 2.0)
#: Information of mount and scale before the drive.
_PRIOR = np.diag([*np.diag(WEAK_PRIOR), _SCALE_SIGMA**-2])
#: Number of successive motions over which residuals are correlated.
_LAGS = 4
#: Starts of the iteration: rotations about the vertical, and of a camera that looks ahead.
_STARTS = 8


def hand_eye(pairs: MotionPairs, guess: FloatArray | None = None) -> Mount:
    """Return the mount of a sensor.

    Parameters
    ----------
    pairs : MotionPairs
    guess : array, shape (4, 4), optional
        Approximate mount. Without it the iteration starts from several rotations, and the result with the
        smallest residuals is returned.

    Raises
    ------
    DegenerateGeometryError
        If there are fewer than ``LEAST_PAIRS`` motions.
    """
    if len(pairs) < LEAST_PAIRS:
        raise DegenerateGeometryError(
            f"{len(pairs)} motions of base and sensor: expected at least {LEAST_PAIRS}; drive longer",
            ("motion",),
        )
    starts = [guess] if guess is not None else [se3.transform(R, np.zeros(3)) for R in _start_rotations()]
    results = [_fit_from(pairs, start) for start in starts]
    fit = min(results, key=lambda result: float(np.log(result.sigmas).sum()))
    residuals = _residuals(pairs, fit.X, fit.scale)
    covariance = _covariance(_jacobians(pairs, fit.X), residuals, fit.weights)[:6, :6]
    return Mount.of_covariance(
        fit.X,
        covariance,
        len(pairs),
        rms_m=float(np.sqrt((residuals[:, :3] ** 2).sum(axis=1).mean())),
        rms_rad=float(np.sqrt((residuals[:, 3:] ** 2).sum(axis=1).mean())),
    )


class _Fit(NamedTuple):
    X: FloatArray  # mount (4, 4)
    scale: float
    sigmas: FloatArray  # (6,), standard deviations of the residuals
    weights: FloatArray  # (n, 6)


def _start_rotations() -> list[FloatArray]:
    """Return initial rotations: a sensor, camera axes and a sensor upside
    down, each at several yaw angles.
    """
    yaws = np.arange(_STARTS) * 2.0 * np.pi / _STARTS
    camera = se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5])
    down = se3.exp_so3([np.pi, 0.0, 0.0])
    turns = [se3.exp_so3([0.0, 0.0, yaw]) for yaw in yaws]
    return [turn @ R for R in (np.eye(3), camera, down) for turn in turns]


def _residuals(pairs: MotionPairs, X: FloatArray, scale: float) -> FloatArray:
    """Return the residuals ``(n, 6)`` of ``A X = X B``: of the translation, then of the rotation vector."""
    A, B = pairs.base, pairs.sensor
    left = A[:, :3, :3] @ X[:3, 3] + scale * A[:, :3, 3]
    rotation = se3.log_so3(A[:, :3, :3]) - se3.log_so3(B[:, :3, :3]) @ X[:3, :3].T
    return np.concatenate([left - (X @ B)[:, :3, 3], rotation], axis=1)


def _jacobians(pairs: MotionPairs, X: FloatArray) -> FloatArray:
    """Return the derivatives ``(n, 6, 7)`` with respect to translation and left rotation of ``X``, and the
    scale.
    """
    A, B, R = pairs.base, pairs.sensor, X[:3, :3]
    J = np.zeros((len(A), 6, 7))
    J[:, :3, :3] = A[:, :3, :3] - np.eye(3)
    J[:, :3, 3:6] = se3.skew(B[:, :3, 3] @ R.T)
    J[:, :3, 6] = A[:, :3, 3]
    J[:, 3:, 3:6] = se3.skew(se3.log_so3(B[:, :3, :3]) @ R.T)
    return J


def _fit_from(pairs: MotionPairs, start: FloatArray) -> _Fit:
    """Return the fit that starts at a mount ``(4, 4)``.

    The standard deviation of each component of the residuals is estimated with the mount: planar odometry has
    no tilt, and the residuals of a robot on rough ground are larger about x and y.
    """
    X, scale = start, 1.0
    for _ in range(_ITERATIONS):
        r, J = _residuals(pairs, X, scale), _jacobians(pairs, X)
        sigma = np.maximum(1.4826 * np.median(np.abs(r), axis=0), _FLOOR)
        weights = np.minimum(1.0, _HUBER / np.maximum(np.abs(r) / sigma, 1e-12)) / sigma**2
        information = np.einsum("nij,ni,nik->jk", J, weights, J)
        information[6, 6] += _SCALE_SIGMA**-2
        gradient = np.einsum("nij,ni,ni->j", J, weights, r)
        gradient[6] += (scale - 1.0) / _SCALE_SIGMA**2
        step = np.linalg.solve(information + _PRIOR * 1e-2, -gradient)
        angle = float(np.linalg.norm(step[3:6]))
        step *= min(1.0, 0.5 / max(angle, 1e-12))
        X = se3.transform(se3.exp_so3(step[3:6]) @ X[:3, :3], X[:3, 3] + step[:3])
        scale = float(np.clip(scale + step[6], *_SCALES))
        if float(np.abs(step).max()) < 1e-9:
            break
    return _Fit(X, scale, sigma, weights)


def _covariance(J: FloatArray, residuals: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the covariance ``(7, 7)`` of mount and scale from independent residuals, enlarged for each
    direction in which successive residuals are correlated.
    """
    independent = np.linalg.inv(np.einsum("nij,ni,nik->jk", J, weights, J) + _PRIOR)
    scores = np.einsum("nij,ni,ni->nj", J, weights, residuals)
    spread = scores.T @ scores
    for lag in range(1, min(_LAGS, len(scores) - 1) + 1):
        products = scores[lag:].T @ scores[:-lag]
        spread += (1.0 - lag / (_LAGS + 1.0)) * (products + products.T)
    correlated = independent @ spread @ independent * (len(J) / max(len(J) - J.shape[2], 1))
    ratios = np.diag(correlated) / np.diag(independent)
    enlarged = np.sqrt(np.maximum(ratios, 1.0))
    return np.asarray(independent * np.outer(enlarged, enlarged), dtype=np.float64)
