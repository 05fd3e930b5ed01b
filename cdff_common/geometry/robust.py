# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quantiles, robust scale, truncated least squares, and the rigid motion between weighted pairs of points."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3

#: Factor by which the loss approaches the truncated square at each step, and maximum number of steps.
GNC_GROWTH, _GNC_STEPS = 1.4, 200


def chi_squared_quantile(probability: float, freedoms: int) -> float:
    """Return the quantile of the chi-squared distribution without scipy.stats, which imports for a second."""
    from scipy.special import gammaincinv

    return 2.0 * float(gammaincinv(0.5 * freedoms, probability))


def median_sigma(residuals: FloatArray) -> float:
    """Return the standard deviation of Gaussian residuals about 0 from their median absolute value."""
    return 1.4826 * float(np.median(np.abs(residuals)))


def truncated_weights(squares: FloatArray, limit: float, mu: float) -> FloatArray:
    """Return the weights of squared residuals at one step of graduated non-convexity.

    ``mu`` grows from a convex problem near 0 to ``sum min(square, limit)``: Yang et al. (2020),
    doi:10.1109/LRA.2020.2965893, §III.B.
    """
    low, high = mu / (mu + 1.0) * limit, (mu + 1.0) / mu * limit
    between = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(squares, low)) - mu
    return np.where(squares <= low, 1.0, np.where(squares >= high, 0.0, between))


def rigid_fit(source: FloatArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted least-squares T_target_source: Umeyama (1991), doi:10.1109/34.88573."""
    w = weights / weights.sum()
    a, b = w @ source, w @ target
    U, _, Vt = np.linalg.svd(((target - b) * w[:, None]).T @ (source - a))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return se3.transform(se3.normalise_rotation(R), b - R @ a)


def graduated_fit(
    source: FloatArray, target: FloatArray, limit: float, sigmas: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return T_target_source of least ``sum min(square, limit^2)``, and the squared residuals over sigmas.

    Truncated least squares by graduated non-convexity, continued from a convex problem; squares are infinite
    where fewer than three pairs keep a weight.
    """
    variances, c2 = (1.0 if sigmas is None else sigmas**2), limit**2

    def fitted(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        T = rigid_fit(source, target, weights / variances)
        return T, np.sum((se3.transform_points(T, source) - target) ** 2, axis=1) / variances

    T, squares = fitted(np.ones(len(source)))
    mu = c2 / (2.0 * max(squares.max(), c2) - c2)
    for _ in range(_GNC_STEPS if squares.max() > c2 else 0):
        weights = truncated_weights(squares, c2, mu)
        if np.count_nonzero(weights > 1e-6) < 3:
            return T, np.full(len(source), np.inf)
        T, squares = fitted(weights)
        if np.all((weights < 1e-6) | (weights > 1.0 - 1e-6)):
            break
        mu *= GNC_GROWTH
    return T, squares
