# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of a camera on a moving hand, from images of a fixed board (hand-eye and robot-world calibration).

``A`` is the pose of the hand relative to the base of the arm, and ``B`` that of the board relative to the
camera. The pose ``X`` of the camera relative to the hand and the pose ``Z`` of the board in the base fulfil
``A X B = Z`` [1]_. The start is the best of many solutions from two motions [2]_; then ``X`` and ``Z`` are
adjusted with Huber's weights. The errors of the poses of the hand are estimated with them, as variance
components [3]_, since the accuracy of an arm is rarely known.

References
----------
.. [1] Dornaika, F., Horaud, R. (1998). Simultaneous robot-world and hand-eye calibration. IEEE Transactions
  on Robotics and Automation 14(4). doi:10.1109/70.704233
.. [2] Park, F. C., Martin, B. J. (1994). Robot sensor calibration: solving AX = XB on the Euclidean group.
  IEEE Transactions on Robotics and Automation 10(5). doi:10.1109/70.326576
.. [3] Koch, K.-R. (1999). Parameter estimation and hypothesis testing in linear models, section 3.6.
  doi:10.1007/978-3-662-03976-2
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import compose_jacobians, inverse_covariance, inverse_jacobian
from cdff_core.calibration.board_poses import BoardPose
from cdff_core.calibration.relative_pose import RelativePose, undetermined_directions

#: Least number of poses.
LEAST_POSES = 5
#: Smallest rotation of the hand between two poses of a start solution, radians.
_LEAST_ROTATION = np.deg2rad(8.0)
#: Number of start solutions, and weight of a radian relative to a metre in their comparison.
_STARTS, _METRES_PER_RADIAN = 100, 0.5
#: Poses above this Mahalanobis distance (99.9 % of six degrees of freedom) contradict the others.
_GATE = 4.74
#: Threshold of Huber's loss, Mahalanobis distance (95 % of six degrees of freedom).
_HUBER = 3.55
_ITERATIONS = 30
#: Smallest standard deviations of a pose of the hand, metres and radians.
_FLOORS = np.array([1e-5, 1e-5])
#: Information of a weak prior (10 m and 180°).
_PRIOR = np.diag(np.tile([1e-2] * 3 + [1.0 / np.pi**2] * 3, 2))
#: Spread of the rotation axes, degrees, below which the hand has rotated about one axis only.
_LEAST_SPREAD_DEG = 20.0


def robot_world_calibration(
    hands: FloatArray, boards: Sequence[BoardPose], *, seed: int = 1
) -> tuple[RelativePose, FloatArray]:
    """Return the pose ``T_hand_camera`` and the pose ``T_base_board`` ``(4, 4)``.

    Parameters
    ----------
    hands : ndarray, shape (n, 4, 4)
        Poses ``T_base_hand`` at the times of the images.
    boards : sequence of BoardPose
        Pose of the board in each of the n images.
    seed : int
        Of the start solutions.

    Raises
    ------
    InputError
        If the numbers of poses differ.
    DegenerateGeometryError
        If there are fewer than ``LEAST_POSES`` poses, or the hand does not rotate.
    """
    if len(hands) != len(boards):
        raise InputError(
            f"{len(hands)} poses of the hand and {len(boards)} of the board: expected equal numbers"
        )
    if len(hands) < LEAST_POSES:
        raise DegenerateGeometryError(
            f"{len(hands)} images with a board and a pose of the hand: expected at least {LEAST_POSES}; "
            "take more images",
            ("motion",),
        )
    B = np.array([board.T_camera_board for board in boards])
    X, Z = _start(hands, B, seed)
    noise = np.array([0.002, np.deg2rad(0.2)])
    own = np.array([board.covariance for board in boards])
    is_used = np.ones(len(hands), dtype=bool)
    for _ in range(_ITERATIONS):
        errors, J, noise_of_board = _linearised(hands, B, X, Z, own)
        noise = _hand_noise(errors, noise_of_board, is_used, noise)
        information, gradient, distances = _normal_equations(errors, J, noise_of_board, noise)
        is_used = distances < _GATE * max(1.0, float(np.median(distances)) / np.sqrt(5.35))
        step = np.asarray(np.linalg.solve(information + 1e-4 * _PRIOR, -gradient), np.float64)
        step *= min(1.0, 0.3 / max(float(np.abs(step[[3, 4, 5, 9, 10, 11]]).max()), 1e-12))
        X, Z = _moved(X, step[:6]), _moved(Z, step[6:])
        if float(np.abs(step).max()) < 1e-9:
            break
    kept = np.flatnonzero(is_used)
    if len(kept) < LEAST_POSES:
        raise DegenerateGeometryError(
            f"{len(kept)} of {len(hands)} poses agree with each other: expected at least {LEAST_POSES}; "
            "check that each image has its own pose of the hand, and that the board did not move",
            ("motion",),
        )
    errors, J, noise_of_board = _linearised(hands[kept], B[kept], X, Z, own[kept])
    information, _, distances = _normal_equations(errors, J, noise_of_board, noise)
    # The variance components have errors of their own: few poses give a wider distribution than a normal one.
    freedom = max(6 * len(kept) - 12, 1)
    covariance = np.linalg.inv(information + _PRIOR)[:6, :6] * (freedom + 2.0) / freedom
    rms_m, rms_rad = (float(np.sqrt((e**2).sum(axis=1).mean())) for e in (errors[:, :3], errors[:, 3:]))
    result = RelativePose(
        UncertainTransform(se3.normalise_transform(X), covariance),
        undetermined_directions(covariance),
        tuple(_sentences(hands[kept], covariance, len(hands) - len(kept))),
        len(kept),
        len(hands) - len(kept),
        {
            "hand_sigma_m": float(noise[0]),
            "hand_sigma_deg": float(np.rad2deg(noise[1])),
            "rms_m": rms_m,
            "rms_deg": float(np.rad2deg(rms_rad)),
            "board_rms_px": float(np.median([board.rms_px for board in boards])),
        },
    )
    return result, se3.normalise_transform(Z)


def _moved(T: FloatArray, step: FloatArray) -> FloatArray:
    return se3.transform(se3.exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])


def park_martin(A: FloatArray, B: FloatArray) -> FloatArray:
    """Return the solution ``X`` (4, 4) of ``A X = X B`` for motions ``(n, 4, 4)`` without weights [2]_."""
    U, _, Vt = np.linalg.svd(se3.log_so3(A[:, :3, :3]).T @ se3.log_so3(B[:, :3, :3]))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    left = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (B[:, :3, 3] @ R.T - A[:, :3, 3]).reshape(-1)
    return se3.transform(R, np.linalg.lstsq(left, right, rcond=1e-6)[0])


def _start(hands: FloatArray, B: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return the start solution with the least median difference of the poses of the board in the base."""
    first, second = np.array(list(itertools.combinations(range(len(hands)), 2))).T
    # From A_i X B_i = A_j X B_j: (A_j^-1 A_i) X = X (B_j B_i^-1).
    A = se3.inverse(hands[second]) @ hands[first]
    motions_B = B[second] @ se3.inverse(B[first])
    is_large = se3.rotation_angle(A[:, :3, :3]) > _LEAST_ROTATION
    A, motions_B = A[is_large], motions_B[is_large]
    if len(A) < 2:
        raise DegenerateGeometryError(
            f"the hand rotates by less than {np.rad2deg(_LEAST_ROTATION):.0f}° between its poses: rotate it "
            "about two axes by 30° or more",
            ("roll", "pitch", "yaw"),
        )
    rng = np.random.default_rng(seed)
    best, result = np.inf, None
    for k in range(_STARTS + 1):
        rows = rng.choice(len(A), 2, replace=False) if k < _STARTS else np.arange(len(A))
        X = park_martin(A[rows], motions_B[rows])
        Z = hands @ X @ B
        centre = _median_transform(Z)
        score = float(np.median(_distance(Z, centre)))
        if score < best:
            best, result = score, (X, centre)
    assert result is not None
    return result


def _median_transform(T: FloatArray) -> FloatArray:
    """Return the transform of ``(n, 4, 4)`` with the least sum of distances to the others."""
    sums = [float(_distance(T, other).sum()) for other in T]
    return np.asarray(T[int(np.argmin(sums))])


def _distance(T: FloatArray, other: FloatArray) -> FloatArray:
    metres = np.linalg.norm(T[:, :3, 3] - other[:3, 3], axis=1)
    radians = se3.rotation_angle(other[:3, :3].T @ T[:, :3, :3])
    return np.asarray(metres + _METRES_PER_RADIAN * radians)


def _linearised(
    hands: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors ``(n, 6)``, Jacobians ``(n, 6, 12)`` and covariances by the images ``(n, 6, 6)``.

    The error is that of the pose of the hand, in the axes of the base: ``A`` differs from ``Z B^-1 X^-1``.
    """
    inverse_B, inverse_X = se3.inverse(B), se3.inverse(X)
    ZB = Z @ inverse_B
    computed = ZB @ inverse_X
    rotation = se3.log_so3(computed[:, :3, :3] @ np.swapaxes(hands[:, :3, :3], 1, 2))
    errors = np.concatenate([computed[:, :3, 3] - hands[:, :3, 3], rotation], axis=1)
    left, right = compose_jacobians(ZB, np.broadcast_to(inverse_X, ZB.shape))
    by_Z, by_B = compose_jacobians(np.broadcast_to(Z, B.shape), inverse_B)
    J = np.concatenate([right @ inverse_jacobian(X), left @ by_Z], axis=2)
    by_board = left @ by_B
    spread = by_board @ inverse_covariance(B, covariance) @ np.swapaxes(by_board, 1, 2)
    return errors, J, spread


def _hand_noise(errors: FloatArray, spread: FloatArray, is_used: BoolArray, start: FloatArray) -> FloatArray:
    """Return the standard deviations of a pose of the hand, metres and radians, of greatest likelihood."""

    def cost(logs: FloatArray) -> float:
        sigma = np.exp(logs)
        S = spread[is_used] + np.diag([sigma[0] ** 2] * 3 + [sigma[1] ** 2] * 3)
        squares = np.einsum(
            "ni,ni->n", errors[is_used], np.linalg.solve(S, errors[is_used][:, :, None])[..., 0]
        )
        capped = np.where(squares < _HUBER**2, squares, 2.0 * _HUBER * np.sqrt(squares) - _HUBER**2)
        return float(np.linalg.slogdet(S)[1].sum() * _freedom + capped.sum())

    count = max(int(is_used.sum()), 1)
    # Two poses were fitted to the errors: the likelihood is that of the remaining degrees of freedom.
    _freedom = max(6 * count - 12, 1) / (6 * count)
    result = minimize(cost, np.log(start), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-3})
    return np.asarray(np.maximum(np.exp(result.x), _FLOORS), np.float64)


def _normal_equations(
    errors: FloatArray, J: FloatArray, spread: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return information ``(12, 12)``, gradient ``(12,)`` and Mahalanobis distances ``(n,)``."""
    W = np.linalg.inv(spread + np.diag([noise[0] ** 2] * 3 + [noise[1] ** 2] * 3))
    distances = np.sqrt(np.einsum("ni,nij,nj->n", errors, W, errors))
    W = W * np.minimum(1.0, _HUBER / np.maximum(distances, 1e-12))[:, None, None]
    W[distances > 2.0 * _GATE] *= 1e-3
    information = np.einsum("nai,nab,nbj->ij", J, W, J)
    gradient = np.einsum("nai,nab,nb->i", J, W, errors)
    return information, gradient, distances


def _sentences(hands: FloatArray, covariance: FloatArray, dropped: int) -> list[str]:
    """Return the assessment."""
    sentences = []
    first, second = np.array(list(itertools.combinations(range(len(hands)), 2))).T
    vectors = se3.log_so3(np.swapaxes(hands[second, :3, :3], 1, 2) @ hands[first, :3, :3])
    vectors = vectors[np.linalg.norm(vectors, axis=1) > _LEAST_ROTATION]
    values = np.linalg.eigvalsh(vectors.T @ vectors) if len(vectors) else np.zeros(3)
    spread_deg = float(np.rad2deg(np.arctan2(np.sqrt(max(values[1], 0.0)), np.sqrt(max(values[2], 1e-12)))))
    missing = undetermined_directions(covariance)
    if spread_deg < _LEAST_SPREAD_DEG:
        sentences.append("the hand rotates about one axis: rotate it about a second axis by 30° or more")
    elif missing:
        sentences.append(f"{', '.join(missing)} not determined: take more images with larger rotations")
    if dropped:
        sentences.append(
            f"{dropped} images contradict the others: check that the board does not move, and that images "
            "and poses of the hand have the same time"
        )
    return sentences or ["good: all directions are determined"]
