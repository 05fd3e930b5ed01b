# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Denoising of heights on near-planar terrain, its remaining variance, and the noise in a footprint.

References
----------
.. [1] Lee, J.-S. (1980). Digital image enhancement and noise filtering by use of local statistics. IEEE
   Transactions on Pattern Analysis and Machine Intelligence 2(2). doi:10.1109/TPAMI.1980.4766994
"""

from __future__ import annotations

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_core.dfns.traversability._kernels import fit_planes

#: Half width of the window in which relief is separated from noise, cells, and minimum number of observed
#: cells in it.
HALF_CELLS, _MIN_CELLS = 2, 8
#: Standard deviations by which a variance due to noise alone may exceed the stated variance by chance.
_NOISE_SIGMAS = 1.8
#: Fraction of the window that a rock at the limit of the step covers: 2 x 2 to 3 x 3 of its 25 cells.
_ROCK_FRACTION = 0.25


def denoise(
    z: FloatArray, observed: BoolArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shrink heights towards the plane of their neighbours by the ratio of the noise to the variance about
    the plane [1]_.

    Parameters
    ----------
    z : FloatArray, shape (rows, cols)
        Heights above any datum, metres; ignored where not ``observed``.
    variance : FloatArray, shape (rows, cols)
        Variance of the heights, square metres.

    Returns
    -------
    tuple of FloatArray
        Heights and their variances, both unchanged where the variance is 0 or too few neighbours are
        observed; and the variance of the noise in the window, 0 where heights are unchanged.
    """
    noise, count = footprint_noise(variance, observed, HALF_CELLS)
    if not noise.any():
        return z, variance, noise
    _, rms, plane, leverage = fit_planes(np.where(observed, z, np.nan), HALF_CELLS, _MIN_CELLS)
    freedom = np.maximum(count - 3.0, 1.0)
    variance_about_plane = rms**2 * (count / freedom)
    usable = observed & (noise > 0.0) & np.isfinite(rms)
    explained = (
        (1.0 + _NOISE_SIGMAS * np.sqrt(2.0 / freedom)) * noise / np.maximum(variance_about_plane, 1e-30)
    )
    gain = np.where(usable, np.clip(1.0 - explained, 0.0, 1.0), 1.0)
    variance_ratio = gain**2 + (1.0 - gain**2) * np.where(usable, leverage, 0.0)
    heights = np.where(usable, plane + gain * (z - plane), z)
    return heights, variance * variance_ratio, np.where(usable, noise, 0.0)


def step_loss_by_denoising(noise: FloatArray, height_m: float) -> FloatArray:
    """Return the height, metres, that denoising removes from a step of ``height_m``.

    ``noise`` is the third result of ``denoise``. A rock of height h on a fraction p of the window causes a
    variance of about p h². The noise explains the fraction noise / (p h²) of it, increased by the chance
    term, and this fraction of h is removed. The approximation holds up to a quarter of h.
    """
    window = (2.0 * HALF_CELLS + 1.0) ** 2
    loss_m = (1.0 + _NOISE_SIGMAS * np.sqrt(2.0 / (window - 3.0))) * noise / (_ROCK_FRACTION * height_m)
    return np.asarray(np.minimum(loss_m, 0.25 * height_m))


def footprint_noise(variance: FloatArray, observed: BoolArray, half: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean variance and the number of observed heights in the square of ``2 half + 1`` cells."""
    edge = (2 * half + 1, 2 * half + 1)
    grids = (np.where(observed, variance, 0.0), observed.astype(np.float64))
    total, count = (
        cv2.boxFilter(g, cv2.CV_64F, edge, normalize=False, borderType=cv2.BORDER_CONSTANT) for g in grids
    )
    return np.maximum(total, 0.0) / np.maximum(count, 1.0), np.asarray(count, np.float64)
