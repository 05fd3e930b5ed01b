# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kalman filter of directions that rotate with a constant angular velocity, for many objects at once.

The state of an object is the unit vector to it and the angular velocity of this vector in a frame that
does not
rotate, its error a rotation vector and a difference of angular velocity: ``true = Exp(phi) estimate``.
With three
components of angular velocity the direction describes any circle on the sphere, not only great circles:
the line of
sight from one object in a circular orbit to another one rotates about the orbit normal.

References
----------
.. [1] Bar-Shalom, Y., Li, X. R., Kirubarajan, T. (2001). Estimation with applications to tracking and
   navigation,
   §5.2 (filter), §6.2 (white noise acceleration). doi:10.1002/0471221279
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry import se3


@dataclass(frozen=True, slots=True, eq=False)
class BearingStates:
    """States of ``n`` objects.

    Attributes
    ----------
    directions : ndarray (n, 3)
        Unit vectors.
    rates : ndarray (n, 3)
        Angular velocities, radians per second.
    covariances : ndarray (n, 6, 6)
        Covariances of rotation vector and angular velocity, both in the frame of the directions.
    """

    directions: FloatArray
    rates: FloatArray
    covariances: FloatArray

    def __len__(self) -> int:
        return len(self.directions)

    def selected(self, indices: IntArray | BoolArray | list[int]) -> BearingStates:
        """Return the states of the chosen objects."""
        return BearingStates(self.directions[indices], self.rates[indices], self.covariances[indices])


def join_states(parts: list[BearingStates]) -> BearingStates:
    """Return the states of several sets, one after the other."""
    return BearingStates(
        np.concatenate([p.directions for p in parts]).reshape(-1, 3),
        np.concatenate([p.rates for p in parts]).reshape(-1, 3),
        np.concatenate([p.covariances for p in parts]).reshape(-1, 6, 6),
    )


def tangents(directions: FloatArray) -> FloatArray:
    """Return two orthogonal unit vectors across each direction, shape (n, 2, 3)."""
    axis = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = _cross(directions, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, _cross(directions, first)], axis=1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of arrays (..., 3); for few vectors much faster than ``numpy.cross``."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def states_at_rest(directions: FloatArray, covariances: FloatArray, rate_sigma: float) -> BearingStates:
    """Return states of measured directions at rest, with a standard deviation of each rate, rad/s.

    Parameters
    ----------
    directions : ndarray (n, 3)
    covariances : ndarray (n, 3, 3)
        Covariances of the unit vectors.
    """
    n = len(directions)
    P = np.zeros((n, 6, 6))
    # A difference d of unit vectors is the rotation u x d.
    turn = se3.skew(directions) if n else np.zeros((0, 3, 3))
    P[:, :3, :3] = turn @ covariances @ np.swapaxes(turn, 1, 2)
    P[:, 3:, 3:] = np.eye(3) * rate_sigma**2
    return BearingStates(directions.copy(), np.zeros((n, 3)), P)


def predict_states(
    states: BearingStates, interval_s: float, noise_rad2_s3: float | FloatArray
) -> BearingStates:
    """Return the states after an interval, with white noise of angular acceleration for all or for each."""
    n = len(states)
    if n == 0 or interval_s == 0.0:
        return states
    R = se3.exp_so3(states.rates * interval_s)
    F = np.zeros((n, 6, 6))
    F[:, :3, :3] = R
    F[:, :3, 3:] = se3.left_jacobian_so3(states.rates * interval_s) * interval_s
    F[:, 3:, 3:] = np.eye(3)
    dt = interval_s
    Q = np.zeros((6, 6))
    Q[:3, :3] = np.eye(3) * dt**3 / 3.0
    Q[:3, 3:] = Q[3:, :3] = np.eye(3) * dt**2 / 2.0
    Q[3:, 3:] = np.eye(3) * dt
    P = F @ states.covariances @ np.swapaxes(F, 1, 2) + np.reshape(noise_rad2_s3, (-1, 1, 1)) * Q
    directions = np.einsum("nij,nj->ni", R, states.directions)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # A rotation about the direction does not move it, now or later: its variance would only grow.
    across_only = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    P[:, :3] = across_only @ P[:, :3]
    P[:, :, :3] = P[:, :, :3] @ across_only
    return BearingStates(directions, states.rates, P)


def innovations(
    states: BearingStates, measured: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return innovations (n, 2), their covariances (n, 2, 2) and the measurement matrices (n, 2, 6).

    The measured vector z is projected on two tangents e of the direction u: e (z - u), with
    ``e (phi x u) = phi (u x e)``.
    """
    e = tangents(states.directions)
    innovation = np.einsum("nij,nj->ni", e, measured - states.directions)
    H = np.zeros((len(states), 2, 6))
    H[:, :, :3] = _cross(states.directions[:, None, :], e)
    noise = e @ covariances @ np.swapaxes(e, 1, 2)
    S = H @ states.covariances @ np.swapaxes(H, 1, 2) + noise
    return innovation, S, H


def update_states(
    states: BearingStates, measured: FloatArray, covariances: FloatArray
) -> tuple[BearingStates, FloatArray, FloatArray]:
    """Return the states corrected with one measurement each, the squared normalised innovations and ln det S.

    Joseph's form keeps the covariances positive.
    """
    innovation, S, H = innovations(states, measured, covariances)
    S_inverse = np.linalg.inv(S)
    K = states.covariances @ np.swapaxes(H, 1, 2) @ S_inverse
    correction = np.einsum("nij,nj->ni", K, innovation)
    directions = np.einsum("nij,nj->ni", se3.exp_so3(correction[:, :3]), states.directions)
    A = np.eye(6) - K @ H
    e = tangents(states.directions)
    noise = e @ covariances @ np.swapaxes(e, 1, 2)
    P = A @ states.covariances @ np.swapaxes(A, 1, 2) + K @ noise @ np.swapaxes(K, 1, 2)
    P = 0.5 * (P + np.swapaxes(P, 1, 2))
    nis = np.einsum("ni,nij,nj->n", innovation, S_inverse, innovation)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    log_det = np.log(np.linalg.det(S))
    return BearingStates(directions, states.rates + correction[:, 3:], P), nis, log_det


def across(states: BearingStates) -> tuple[FloatArray, FloatArray]:
    """Return the covariances (n, 2, 2) of direction and of angular velocity on the tangents of the
    directions.

    The rotation along the direction itself does not move it.
    """
    e = tangents(states.directions)
    H = _cross(states.directions[:, None, :], e)
    P = states.covariances
    return H @ P[:, :3, :3] @ np.swapaxes(H, 1, 2), H @ P[:, 3:, 3:] @ np.swapaxes(H, 1, 2)


def motion_significance(states: BearingStates) -> FloatArray:
    """Return the squared rate (n,) across the directions in standard deviations."""
    e = tangents(states.directions)
    velocity = np.einsum("nij,nj->ni", e, _cross(states.rates, states.directions))
    _, covariance = across(states)
    return np.asarray(np.einsum("ni,nij,nj->n", velocity, np.linalg.inv(covariance), velocity))


def is_observed(measured: FloatArray) -> BoolArray:
    """Return which measurements (n, 3) exist: those without NaN."""
    return np.asarray(np.isfinite(measured).all(axis=1))
