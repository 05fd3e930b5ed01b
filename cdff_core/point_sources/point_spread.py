# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled fit of the image of a point of light: a Gaussian integrated over each pixel."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import Float32Array, FloatArray

#: Number of points per pixel and axis at which the Gaussian is evaluated.
_SAMPLES = 3


@njit(cache=True)
def pixel_light(du: float, dv: float, inverse: FloatArray, out: FloatArray) -> None:
    """Set ``out`` (6,) to the part of the light in a pixel and its derivatives, without the normalisation.

    Derivatives with respect to the position u, v, and the sums of u u, u v, v v weighted with the light, for
    those by the shape.

    Parameters
    ----------
    du, dv : float
        Pixel minus source, pixels.
    inverse : ndarray (2, 2)
        Inverse covariance of the light.
    """
    a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    light, by_u, by_v, uu, uv, vv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(_SAMPLES):
        x = du + (i + 0.5) / _SAMPLES - 0.5
        for j in range(_SAMPLES):
            y = dv + (j + 0.5) / _SAMPLES - 0.5
            g = np.exp(-0.5 * (a * x * x + 2.0 * b * x * y + c * y * y))
            light += g
            by_u += g * (a * x + b * y)
            by_v += g * (b * x + c * y)
            uu += g * x * x
            uv += g * x * y
            vv += g * y * y
    share = 1.0 / (_SAMPLES * _SAMPLES)
    out[0], out[1], out[2] = share * light, share * by_u, share * by_v
    out[3], out[4], out[5] = share * uu, share * uv, share * vv


@njit(cache=True)
def axis_light(first: int, count: int, centre: float, variance: float, out: FloatArray) -> None:
    """Set ``out[:count]`` to the light of pixels along one axis, and its derivative with respect to the
    centre.
    """
    for i in range(count):
        light, slope = 0.0, 0.0
        for k in range(_SAMPLES):
            x = first + i - centre + (k + 0.5) / _SAMPLES - 0.5
            g = np.exp(-0.5 * x * x / variance)
            light += g
            slope += g * x / variance
        out[i, 0], out[i, 1] = light / _SAMPLES, slope / _SAMPLES


@njit(cache=True)
def _solve(A: FloatArray, g: FloatArray, damping: float, factor: FloatArray, x: FloatArray) -> None:
    """Set ``x`` (n,) to the solution of the damped normal equations, by Cholesky's factorisation.

    The diagonal of ``A`` (n, n) is multiplied with one plus the damping; ``factor`` is memory.
    """
    n = len(g)
    for j in range(n):
        for i in range(j, n):
            total = A[i, j]
            if i == j:
                total += damping * A[j, j] + 1e-12
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            # Rounding may leave no positive pivot: that parameter takes a step of nearly zero.
            factor[i, j] = np.sqrt(max(total, 1e-12)) if i == j else total / factor[j, j]
    for i in range(n):
        total = g[i]
        for k in range(i):
            total -= factor[i, k] * x[k]
        x[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * x[k]
        x[i] = total / factor[i, i]


@njit(cache=True)
def fit(
    residual: Float32Array,
    sigma: float,
    u: float,
    v: float,
    spread: FloatArray,
    reach: int,
    is_shape_free: bool,
) -> FloatArray:
    """Return the least-squares fit ``(13,)`` of a source: u, v, flux, chi2, variances and more.

    Parameters
    ----------
    residual : ndarray (r, c)
        Image without background, DN.
    sigma : float
        Standard deviation of its noise at the source, DN.
    u, v : float
        Initial column and row.
    spread : ndarray (2, 2)
        Covariance of the light, square pixels; the initial value if it is free.
    reach : int
        Half width of the window, pixels.

    Returns
    -------
    ndarray (13,)
        u, v, flux, mean squared residual, var u, cov uv, var v, standard deviation of the flux,
        difference of the
        sum of squared residuals to that of a single bright pixel, uu, uv, vv of the light, and 1 if it
        converged.
    """
    rows, cols = residual.shape
    out = np.full(13, np.nan)
    out[12] = 0.0
    n = 6 if is_shape_free else 3
    suu, suv, svv = spread[0, 0], spread[0, 1], spread[1, 1]
    u0, v0 = u, v
    cu, cv = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    flux = 0.0
    A = np.zeros((n, n))
    g = np.zeros(n)
    row = np.zeros(n)
    step, factor = np.zeros(n), np.zeros((n, n))
    inverse = np.zeros((2, 2))
    light = np.zeros(6)
    across, down = np.zeros((2 * reach + 1, 2)), np.zeros((2 * reach + 1, 2))
    is_separable = n == 3 and suv == 0.0
    last_u, last_v = np.inf, np.inf
    damping = 1e-3
    previous = np.inf
    for iteration in range(25):
        determinant = suu * svv - suv * suv
        if determinant < 0.005 or suu < 0.02 or svv < 0.02 or suu > 400.0 or svv > 400.0:
            return out
        inverse[0, 0], inverse[1, 1] = svv / determinant, suu / determinant
        inverse[0, 1] = inverse[1, 0] = -suv / determinant
        peak_density = 1.0 / (2.0 * np.pi * np.sqrt(determinant))
        if iteration == 3:  # once: a window that follows each step may alternate between two pixels
            cu, cv = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        first_r, last_r = max(cv - reach, 0), min(cv + reach, rows - 1)
        first_c, last_c = max(cu - reach, 0), min(cu + reach, cols - 1)
        if last_r - first_r < 2 or last_c - first_c < 2:
            return out
        if is_separable:
            axis_light(first_c, last_c - first_c + 1, u, suu, across)
            axis_light(first_r, last_r - first_r + 1, v, svv, down)
        if iteration == 0:  # the flux is linear: solve for it first
            top, bottom = 0.0, 0.0
            for r in range(first_r, last_r + 1):
                for c in range(first_c, last_c + 1):
                    if is_separable:
                        p = across[c - first_c, 0] * down[r - first_r, 0] * peak_density
                    else:
                        pixel_light(c - u, r - v, inverse, light)
                        p = light[0] * peak_density
                    top += p * residual[r, c]
                    bottom += p * p
            flux = top / bottom
            if flux <= 0.0:
                return out
        A[:] = 0.0
        g[:] = 0.0
        chi2, count = 0.0, 0
        for r in range(first_r, last_r + 1):
            for c in range(first_c, last_c + 1):
                if is_separable:
                    light[0] = across[c - first_c, 0] * down[r - first_r, 0]
                    light[1] = across[c - first_c, 1] * down[r - first_r, 0]
                    light[2] = across[c - first_c, 0] * down[r - first_r, 1]
                else:
                    pixel_light(c - u, r - v, inverse, light)
                d = residual[r, c] - flux * peak_density * light[0]
                row[0] = flux * peak_density * light[1]
                row[1] = flux * peak_density * light[2]
                row[2] = peak_density * light[0]
                if n == 6:
                    # d ln N / dS = (S^-1 x x' S^-1 - S^-1) / 2
                    ia, ib, ic = inverse[0, 0], inverse[0, 1], inverse[1, 1]
                    xx = ia * ia * light[3] + 2 * ia * ib * light[4] + ib * ib * light[5] - ia * light[0]
                    yy = ib * ib * light[3] + 2 * ib * ic * light[4] + ic * ic * light[5] - ic * light[0]
                    xy = (
                        ia * ib * light[3]
                        + (ia * ic + ib * ib) * light[4]
                        + ib * ic * light[5]
                        - ib * light[0]
                    )
                    row[3] = 0.5 * flux * peak_density * xx
                    row[4] = flux * peak_density * xy
                    row[5] = 0.5 * flux * peak_density * yy
                chi2 += d * d
                count += 1
                for i in range(n):
                    g[i] += row[i] * d
                    for j in range(i + 1):
                        A[i, j] += row[i] * row[j]
        damping = damping * 0.3 if chi2 <= previous else min(damping * 10.0, 1e3)
        previous = chi2
        for i in range(n):
            for j in range(i):
                A[j, i] = A[i, j]
        _solve(A, g, damping, factor, step)
        for i in range(2):
            step[i] = min(max(step[i], -0.7), 0.7)
        u, v, flux = u + step[0], v + step[1], flux + step[2]
        last_u, last_v = abs(step[0]), abs(step[1])
        if n == 6:
            suu += min(max(step[3], -0.5 * suu), 2.0)
            svv += min(max(step[5], -0.5 * svv), 2.0)
            suv += min(max(step[4], -2.0), 2.0)
        if abs(u - u0) > 2.0 or abs(v - v0) > 2.0 or flux <= 0.0:
            return out
        if iteration > 3 and last_u < 1e-3 and last_v < 1e-3 and abs(step[2]) < 1e-3 * abs(flux):
            break
    # Steps that still alternate by a part of the error of a faint source do no harm.
    out[12] = 1.0 if last_u < 0.05 and last_v < 0.05 else 0.0
    covariance = np.linalg.inv(A[:3, :3]) * sigma * sigma
    squares, peak = 0.0, 0.0
    for r in range(first_r, last_r + 1):
        for c in range(first_c, last_c + 1):
            squares += residual[r, c] * residual[r, c]
            peak = max(peak, residual[r, c])
    out[0], out[1], out[2] = u, v, flux
    out[3] = chi2 / (sigma * sigma * max(count - n, 1))
    out[4], out[5], out[6] = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    # The flux of a source at a known position: with free position and a symmetric window, the same.
    out[7] = sigma / np.sqrt(A[2, 2])
    out[8] = (chi2 - (squares - peak * peak)) / (sigma * sigma)
    out[9], out[10], out[11] = suu, suv, svv
    return out


@njit(cache=True)
def fit_all(
    residual: Float32Array,
    noise: Float32Array,
    points: FloatArray,
    spread: FloatArray,
    reach: int,
    is_shape_free: bool,
) -> FloatArray:
    """Return the fits ``(n, 13)`` of sources at points ``(n, 2)`` (column, row)."""
    rows, cols = residual.shape
    result = np.empty((len(points), 13))
    for i in range(len(points)):
        r = min(max(int(points[i, 1] + 0.5), 0), rows - 1)
        c = min(max(int(points[i, 0] + 0.5), 0), cols - 1)
        result[i] = fit(residual, noise[r, c], points[i, 0], points[i, 1], spread, reach, is_shape_free)
    return result
