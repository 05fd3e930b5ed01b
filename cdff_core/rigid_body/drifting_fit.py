# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Linear least squares for measurements whose reference drifts as a random walk.

Residuals and derivatives pass the same Kalman filter of the drift; its innovations are uncorrelated, so
that the parameters follow from ordinary least squares. The intensity of the drift, and the scale of the
noise if it is not stated, have the largest likelihood.

Source: A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989, §3.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_core.rigid_body._kernels import whiten

#: Lower bound of the factor on the covariances: rounding of poses without noise.
_LEAST_FACTOR = 1e-24
#: Intensities of the drift in units of the variance of a measurement per interval (to the power of the
#: order).
RATIOS = (0.0, *np.logspace(-7, 1, 17))
#: Variance of an unknown initial state in units of the largest value expected.
_DIFFUSE = 1e6


@dataclass(frozen=True, slots=True)
class DriftingFit:
    """Solution of one linear fit.

    Attributes
    ----------
    step : ndarray (p,)
        Parameters.
    covariance : ndarray (p, p)
        Of the parameters.
    state, state_covariance : ndarray (d,), (d, d)
        Drift at the last measurement and its covariance for known parameters.
    state_derivatives : ndarray (d, p)
        Change of the estimated drift with the parameters, negative.
    intensity : float
        Of the random walk.
    likelihood : float
        Logarithm of the likelihood.
    noise_factor : float
        Variance of the measurements in units of the stated one.
    normalised : ndarray (n, 3)
        Innovations divided by their standard deviations.
    """

    step: FloatArray
    covariance: FloatArray
    state: FloatArray
    state_covariance: FloatArray
    state_derivatives: FloatArray
    intensity: float
    likelihood: float
    noise_factor: float
    normalised: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftingProblem:
    """Measurements ``residual = derivatives @ parameters + drift + noise``.

    Attributes
    ----------
    residuals : ndarray (n, 3)
    derivatives : ndarray (n, 3, p)
    covariances : ndarray (n, 3, 3)
        Of the noise.
    t_s : ndarray (n,)
        Ascending times.
    order : int
        1: the drift is a random walk. 2: its rate is one, and its initial value and rate are unknown.
    prior : ndarray (p, p)
        Information about the parameters, expected value zero.
    is_noise_known : bool
        False: only the ratios of the covariances are known.
    """

    residuals: FloatArray
    derivatives: FloatArray
    covariances: FloatArray
    t_s: FloatArray
    order: int
    prior: FloatArray
    is_noise_known: bool

    def solve(self, ratios: Sequence[float] = RATIOS) -> DriftingFit:
        """Return the fit with the most probable of the intensities, given as ratios, see `RATIOS`."""
        return max((self._solve(self.unit_intensity * ratio) for ratio in ratios), key=lambda f: f.likelihood)

    @property
    def unit_intensity(self) -> float:
        """Intensity whose effect in one interval is as large as the noise."""
        variance = float(np.trace(self.covariances, axis1=1, axis2=2).mean()) / 3.0
        interval_s = float(self.t_s[-1] - self.t_s[0]) / max(len(self.t_s) - 1, 1)
        return variance / interval_s ** (2 * self.order - 1)

    def _solve(self, intensity: float) -> DriftingFit:
        """Return the fit for one intensity of the random walk."""
        n, p, d = len(self.t_s), self.derivatives.shape[2], 3 * self.order
        columns = np.concatenate([self.residuals[:, :, None], self.derivatives], axis=2)
        white, state, covariance = np.empty((n, 3, p + 1)), np.empty((d, p + 1)), np.empty((d, d))
        logarithms = whiten(
            columns,
            self.covariances,
            np.diff(self.t_s, prepend=self.t_s[0]),
            self._initial_covariance(),
            intensity,
            self.order,
            white,
            state,
            covariance,
        )
        values, rows = white[:, :, 0].ravel(), white[:, :, 1:].reshape(3 * n, p)
        information = rows.T @ rows + self.prior
        inverse = np.linalg.pinv(information, hermitian=True)
        step = inverse @ (rows.T @ values)
        residuals = values - rows @ step
        squared = float(residuals @ residuals + step @ self.prior @ step)
        freedom = max(3 * n - p - (d if self.order == 2 else 0), 1)
        factor = max(squared / freedom, _LEAST_FACTOR)
        likelihood = -0.5 * (logarithms + (squared if self.is_noise_known else freedom * np.log(factor)))
        if self.is_noise_known:
            factor = max(factor, 1.0)
        return DriftingFit(
            step=step,
            covariance=factor * inverse,
            state=state[:, 0] - state[:, 1:] @ step,
            state_covariance=factor * covariance,
            state_derivatives=state[:, 1:].copy(),
            intensity=factor * intensity,
            likelihood=float(likelihood),
            noise_factor=factor,
            normalised=residuals.reshape(n, 3) / np.sqrt(factor),
        )

    def _initial_covariance(self) -> FloatArray:
        """Return the covariance of the drift before the first measurement."""
        if self.order == 1:
            return np.zeros((3, 3))
        span_s = max(float(self.t_s[-1] - self.t_s[0]), 1e-3)
        size = float(np.abs(self.residuals).max()) + float(np.abs(self.derivatives).max()) + 1.0
        return np.asarray(_DIFFUSE * np.diag(np.repeat([size, size / span_s], 3)) ** 2)


def compile_kernel() -> None:
    """Compile the kernel of ``DriftingProblem``, so that the first fit takes no longer than the others."""
    covariance = np.eye(3)
    whiten(
        columns=np.zeros((1, 3, 1)),
        covariances=np.eye(3)[None],
        intervals_s=np.zeros(1),
        initial=np.eye(3),
        intensity=0.0,
        order=1,
        out=np.zeros((1, 3, 1)),
        state=np.zeros((3, 1)),
        covariance=covariance,
    )
