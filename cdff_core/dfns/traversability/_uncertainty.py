# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Denoising of heights on near-planar terrain, its residual variance, and the noise of a footprint's plane.

References
----------
.. [1] Lee, J.-S. (1980). Digital image enhancement and noise filtering by use of local statistics. IEEE
   Transactions
   on Pattern Analysis and Machine Intelligence 2(2). doi:10.1109/TPAMI.1980.4766994
"""

from __future__ import annotations

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_core.dfns.traversability._kernels import fit_planes

#: Half width of the window that separates relief from noise, cells, and its minimum number of observed cells.
HALF_CELLS, _LEAST = 2, 8
#: Standard deviations by which the variance about the plane of pure noise may exceed it.
_CHANCE = 1.8
#: Fraction of the window that a rock at the limit covers: 2 x 2 to 3 x 3 of its 25 cells.
_ROCK_SHARE = 0.25


def denoised(
    z: FloatArray, seen: BoolArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shrink heights towards the plane of their neighbours by the ratio of noise to their variance [1]_.

    Parameters
    ----------
    z : FloatArray, shape (rows, cols)
        Heights about some datum, metres; ignored where not ``seen``.
    variance : FloatArray, shape (rows, cols)
        Variance of the heights, square metres.

    Returns
    -------
    tuple of FloatArray
        Heights and their variances, both unchanged where the variance is 0 or too few neighbours are
        observed;
        and the variance of the local noise, 0 where heights are unchanged.
    """
    noise, count = footprint_noise(variance, seen, HALF_CELLS)
    if not noise.any():
        return z, variance, noise
    _, rms, plane, leverage = fit_planes(np.where(seen, z, np.nan), HALF_CELLS, _LEAST)
    free = np.maximum(count - 3.0, 1.0)
    rough = rms**2 * (count / free)
    usable = seen & (noise > 0.0) & np.isfinite(rms)
    explained = (1.0 + _CHANCE * np.sqrt(2.0 / free)) * noise / np.maximum(rough, 1e-30)
    keep = np.where(usable, np.clip(1.0 - explained, 0.0, 1.0), 1.0)
    left = keep**2 + (1.0 - keep**2) * np.where(usable, leverage, 0.0)
    return np.where(usable, plane + keep * (z - plane), z), variance * left, np.where(usable, noise, 0.0)


def step_loss_by_denoising(noise: FloatArray, height_m: float) -> FloatArray:
    """Return the height, metres, that denoising removes from a step of ``height_m``.

    ``noise`` is the third result of ``denoised``.

    A rock of height h over a fraction p of the window has about p h² of variance there: noise, with
    ``_CHANCE``, explains noise / (p h²) of it, and this part of h is lost. The approximation holds up to a
    quarter.
    """
    window = (2.0 * HALF_CELLS + 1.0) ** 2
    lost = (1.0 + _CHANCE * np.sqrt(2.0 / (window - 3.0))) * noise / (_ROCK_SHARE * height_m)
    return np.asarray(np.minimum(lost, 0.25 * height_m))


def footprint_noise(variance: FloatArray, seen: BoolArray, half: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean variance and the number of observed heights in the square of ``2 half + 1`` cells."""
    edge = (2 * half + 1, 2 * half + 1)
    grids = (np.where(seen, variance, 0.0), seen.astype(np.float64))
    total, count = (
        cv2.boxFilter(g, cv2.CV_64F, edge, normalize=False, borderType=cv2.BORDER_CONSTANT) for g in grids
    )
    return np.maximum(total, 0.0) / np.maximum(count, 1.0), np.asarray(count, np.float64)
