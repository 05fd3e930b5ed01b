# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mean and covariance of a distribution by adaptive importance sampling.

Cappé et al. (2008), doi:10.1007/s11222-008-9059-x.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdff_common.arrays import FloatArray

#: Inflation of the proposals, least effective sample size, and variance that is added to each component.
_INFLATION, _MIN_EFFECTIVE, _LEAST_VARIANCE = 1.2, 16.0, 1e-3


def mean_and_covariance(
    energy: Callable[[FloatArray], FloatArray],
    mean: FloatArray,
    covariance: FloatArray,
    *,
    rounds: int,
    samples: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return mean (n,) and covariance (n, n) of the density ``exp(-energy)``.

    Parameters
    ----------
    energy : callable
        Returns the energies (k,) of points (k, n); all directions should have similar scales.
    mean, covariance : ndarray, shapes (n,) and (n, n)
        First proposal.
    rounds, samples : int
        Number of proposals, and of points of each.
    """
    n = len(mean)
    points, energies = np.zeros((0, n)), np.zeros(0)
    proposals: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(rounds):
        root = np.asarray(_INFLATION * np.linalg.cholesky(covariance), np.float64)
        proposals.append((mean, root))
        points = np.concatenate([points, mean + rng.standard_normal((samples, n)) @ root.T])
        energies = np.concatenate([energies, energy(points[-samples:])])
        density = np.logaddexp.reduce([_log_density(points, *p) for p in proposals])
        weights = _temper_weights(energies.min() - energies - density)
        mean = weights @ points
        offset = points - mean
        covariance = (offset.T * weights) @ offset + _LEAST_VARIANCE * np.eye(n)
    return mean, covariance


def _log_density(points: FloatArray, mean: FloatArray, root: FloatArray) -> FloatArray:
    whitened = np.linalg.solve(root, (points - mean).T)
    return np.asarray(-0.5 * np.sum(whitened**2, axis=0) - np.log(np.diag(root)).sum())


def _temper_weights(log_weights: FloatArray) -> FloatArray:
    """Return weights (k,) with sum 1 that at least ``_MIN_EFFECTIVE`` samples share."""
    power = 1.0
    while True:
        weights = np.exp(power * (log_weights - log_weights.max()))
        weights /= weights.sum()
        if 1.0 / float(np.sum(weights**2)) >= _MIN_EFFECTIVE or power < 0.02:
            return np.asarray(weights)
        power *= 0.8
