# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance of calibrated cameras, for correlated corners and for a coefficient with nonlinear effect.

The covariance of independent corners is enlarged where the scatter between the boards is larger than it: the
errors of the corners of one image are correlated. The scatter is the bias-reduced cluster estimate [1]_.

``xi`` of an omnidirectional lens, its focal length and its radial coefficients are hardly separable, and the
others depend nonlinearly on ``xi``. Therefore the covariance of such a lens is the second moment about the
estimate of the posterior density, in which ``xi`` is integrated numerically over its profile and the other
parameters are normal for each ``xi`` [2]_. The prior is uniform in ``1 / (1 + xi)``, which is 1 for a pinhole
and 0 for an orthographic projection.

References
----------
.. [1] Bell, R. M., McCaffrey, D. F. (2002). Bias reduction in standard errors for linear regression with
  multi-stage samples. Survey Methodology 28(2).
.. [2] Rue, H., Martino, S., Chopin, N. (2009). Approximate Bayesian inference for latent Gaussian models by
  using integrated nested Laplace approximations. doi:10.1111/j.1467-9868.2008.00700.x
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.calibration.adjustment import (
    Rig,
    View,
    adjusted,
    intrinsic_values,
    normal_equations,
    parameter_names,
    regular_inverse,
    robust_cost,
    with_intrinsic_values,
)

#: Cost above the least one at which a profile ends: 4 standard deviations of a normal density.
_PROFILE_COST = 8.0
#: Smallest value and largest step of ``1 / (1 + xi)`` in a profile.
_LEAST_SCALE, _LARGEST_STEP = 0.05, 0.05
#: Change of the cost below which the step of a profile is doubled.
_SMALL_CHANGE = 0.5
#: Smallest part of the information that is not the board's own.
_LEAST_SHARE = 1e-3


def rig_covariance(rig: Rig, views: Sequence[View], sigma_px: float) -> FloatArray:
    """Return the covariance ``(s, s)`` of the shared parameters, in the order of ``parameter_names``.

    Parameters
    ----------
    rig : Rig
        Adjusted to the views.
    sigma_px : float
        Standard deviation of a coordinate of a corner, pixels.
    """
    independent = regular_inverse(normal_equations(rig, views, sigma_px)[0])
    factors = _cluster_factors(rig, views, sigma_px)
    profiles = [
        list(_profile(rig, views, sigma_px, number, independent))
        for number, camera in enumerate(rig.cameras)
        if camera.lens == "omnidirectional"
    ]
    covariance = _second_moment(rig, views, sigma_px, profiles) if profiles else independent
    return np.asarray(covariance * np.outer(factors, factors))


def _cluster_factors(rig: Rig, views: Sequence[View], sigma_px: float) -> FloatArray:
    """Return how much larger than those of independent corners the standard deviations are, at least 1."""
    equations = []
    for board, T in rig.boards.items():
        own = [view for view in views if view.board == board]
        equations.append(normal_equations(replace(rig, boards={board: T}), own, sigma_px)[:2])
    total = np.sum([A for A, _ in equations], axis=0)
    unit = np.sqrt(np.maximum(np.diag(total), 1e-300))
    values, vectors = np.linalg.eigh(regular_inverse(total) * np.outer(unit, unit))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    clustered = np.zeros(len(total))
    for A, score in equations:
        share, axes = np.linalg.eigh(root @ (A / np.outer(unit, unit)) @ root)
        rest = np.sqrt(np.maximum(1.0 - share, _LEAST_SHARE))
        clustered += (root @ ((axes / rest) @ (axes.T @ (root @ (score / unit))))) ** 2
    return np.asarray(np.sqrt(np.maximum(clustered / np.maximum((root**2).sum(axis=1), 1e-300), 1.0)))


def _profile(
    rig: Rig, views: Sequence[View], sigma_px: float, number: int, independent: FloatArray
) -> Iterator[tuple[float, float, Rig]]:
    """Yield ``1 / (1 + xi)`` of a camera, the least cost with it, and the rig with this cost."""
    names = parameter_names(rig)
    row = names.index(f"{number}.xi")
    is_free = np.arange(len(names)) != row
    xi = rig.cameras[number].distortion[0]
    linear = np.sqrt(independent[row, row]) / (1.0 + xi) ** 2
    least = robust_cost(rig, views, sigma_px)
    yield 1.0 / (1.0 + xi), least, rig
    for sign in (-1.0, 1.0):
        scale, cost, current = 1.0 / (1.0 + xi), least, rig
        step = float(np.clip(0.5 * linear, 1e-4, _LARGEST_STEP))
        while cost - least < _PROFILE_COST and _LEAST_SCALE < scale < 1.0:
            scale = float(np.clip(scale + sign * step, _LEAST_SCALE, 1.0))
            try:
                current = adjusted(_with_xi(current, number, 1.0 / scale - 1.0), views, is_free)
            except DegenerateGeometryError:
                break
            previous, cost = cost, robust_cost(current, views, sigma_px)
            least = min(least, cost)
            yield scale, cost, current
            if abs(cost - previous) < _SMALL_CHANGE:
                step = min(2.0 * step, _LARGEST_STEP)


def _with_xi(rig: Rig, number: int, xi: float) -> Rig:
    """Return the rig with another ``xi`` of a camera and the same focal length near its axis."""
    camera = rig.cameras[number]
    values = intrinsic_values(camera)
    values[:2] *= (1.0 + xi) / (1.0 + values[4])
    values[4] = max(xi, 0.0)
    changed = with_intrinsic_values(camera, values)
    if changed is None:
        raise DegenerateGeometryError(f"camera {number}: xi {xi}: expected a valid camera")
    return replace(rig, cameras=tuple(changed if n == number else c for n, c in enumerate(rig.cameras)))


def _second_moment(
    rig: Rig, views: Sequence[View], sigma_px: float, profiles: Sequence[Sequence[tuple[float, float, Rig]]]
) -> FloatArray:
    """Return the second moment about the estimate; the profiles of several cameras are independent."""
    names = parameter_names(rig)
    is_free = np.array([not name.endswith(".xi") for name in names])
    spread, within = np.zeros((len(names), len(names))), np.zeros((len(names), len(names)))
    means = []
    for profile in profiles:
        scales, costs = np.array([node[:2] for node in sorted(profile, key=lambda node: node[0])]).T
        rigs = [node[2] for node in sorted(profile, key=lambda node: node[0])]
        density = np.exp(costs.min() - costs) * np.gradient(scales)
        differences = np.array([_difference(other, rig) for other in rigs])
        means.append(density @ differences / density.sum())
        for weight, difference, other in zip(density / density.sum(), differences, rigs, strict=True):
            spread += weight * np.outer(difference, difference)
            information = normal_equations(other, views, sigma_px)[0][np.ix_(is_free, is_free)]
            within[np.ix_(is_free, is_free)] += weight / len(profiles) * regular_inverse(information)
    total = np.sum(means, axis=0)
    others = np.outer(total, total) - np.sum([np.outer(mean, mean) for mean in means], axis=0)
    return np.asarray(spread + others + within)


def _difference(other: Rig, rig: Rig) -> FloatArray:
    """Return the shared parameters of another rig minus those of a rig, as named by ``parameter_names``."""
    parts = []
    for number, (a, b) in enumerate(zip(other.cameras, rig.cameras, strict=True)):
        parts.append(intrinsic_values(a) - intrinsic_values(b))
        if number:
            R = other.poses[number][:3, :3] @ rig.poses[number][:3, :3].T
            parts += [other.poses[number][:3, 3] - rig.poses[number][:3, 3], se3.log_so3(R)]
    return np.concatenate(parts)
