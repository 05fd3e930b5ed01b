# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance matrix adaptation evolution strategy: minimisation of functions without derivatives.

Hansen (2016), "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, with its default parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cdff_common.arrays import FloatArray


def minimise(
    function: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    deviation: float,
    *,
    population: int,
    generations: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the final mean of the search, and all points with their values.

    Parameters
    ----------
    function : callable
        Returns the values (k,) of points (k, n), in coordinates in which all directions have similar scales.
    start : ndarray, shape (n,)
    deviation : float
        Initial standard deviation of the points.
    population, generations : int
        Points of a generation, and number of generations.
    rng : numpy Generator

    Returns
    -------
    mean : ndarray, shape (n,)
    points : ndarray, shape (population * generations, n)
    values : ndarray, shape (population * generations,)
    """
    n, parents = len(start), population // 2
    weights = math.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
    weights /= weights.sum()
    effective = 1.0 / float(np.sum(weights**2))
    c_sigma = (effective + 2.0) / (n + effective + 5.0)
    d_sigma = 1.0 + 2.0 * max(0.0, math.sqrt((effective - 1.0) / (n + 1.0)) - 1.0) + c_sigma
    c_path = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n)
    c_one = 2.0 / ((n + 1.3) ** 2 + effective)
    c_mu = min(1.0 - c_one, 2.0 * (effective - 2.0 + 1.0 / effective) / ((n + 2.0) ** 2 + effective))
    expected = math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))
    mean, sigma, C = np.array(start, np.float64), deviation, np.eye(n)
    path_sigma, path = np.zeros(n), np.zeros(n)
    all_points, all_values = [], []
    for generation in range(generations):
        lengths, axes = np.linalg.eigh(C)
        lengths = np.sqrt(np.maximum(lengths, 1e-20))
        steps = (rng.standard_normal((population, n)) * lengths) @ axes.T
        points = mean + sigma * steps
        values = function(points)
        all_points.append(points)
        all_values.append(values)
        best = np.argsort(values, kind="stable")[:parents]
        step = weights @ steps[best]
        mean = mean + sigma * step
        whitened = axes @ ((axes.T @ step) / lengths)
        path_sigma = (1.0 - c_sigma) * path_sigma + math.sqrt(
            c_sigma * (2.0 - c_sigma) * effective
        ) * whitened
        norm = float(np.linalg.norm(path_sigma))
        decay = math.sqrt(1.0 - (1.0 - c_sigma) ** (2 * (generation + 1)))
        is_short = norm / decay < (1.4 + 2.0 / (n + 1.0)) * expected
        path = (1.0 - c_path) * path + is_short * math.sqrt(c_path * (2.0 - c_path) * effective) * step
        C = (
            (1.0 - c_one - c_mu + (not is_short) * c_one * c_path * (2.0 - c_path)) * C
            + c_one * np.outer(path, path)
            + c_mu * (steps[best].T * weights) @ steps[best]
        )
        sigma *= math.exp((c_sigma / d_sigma) * (norm / expected - 1.0))
    return mean, np.concatenate(all_points), np.concatenate(all_values)
