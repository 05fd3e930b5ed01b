# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Heights freed of noise where they look like a plane with noise, and what is left of it; noise of a footprint's plane.

References
----------
.. [1] Lee, J.-S. (1980). Digital image enhancement and noise filtering by use of local statistics. IEEE Transactions
   on Pattern Analysis and Machine Intelligence 2(2). doi:10.1109/TPAMI.1980.4766994
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.traversability._kernels import fit_planes

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Half the edge of the window that tells relief from noise, cells, and how many of its cells must be observed.
HALF_CELLS, _LEAST = 2, 8
#: Standard deviations by which the variance about the plane may exceed the noise and still be it.
_CHANCE = 1.8
#: Share of the window that a rock at the limit covers: 2 x 2 to 3 x 3 of its 25 cells.
_ROCK_SHARE = 0.25


def denoised(z: Float, seen: Mask, variance: Float) -> tuple[Float, Float, Float]:
    """Heights drawn towards the plane of their neighbours by as much as noise alone explains their differences [1]_.

    Parameters
    ----------
    z : Float, shape (rows, cols)
        Heights about some datum, metres; anything where not ``seen``.
    variance : Float, shape (rows, cols)
        Of the heights, square metres.

    Returns
    -------
    tuple of Float
        Heights and their variances, both as they were where the variance is 0 or too few neighbours are observed; and
        the variance of the noise about there, 0 where heights are as they were.
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


def taken_from_steps(noise: Float, height_m: float) -> Float:
    """What drawing heights takes from a step of ``height_m``, metres; ``noise`` as of ``denoised``.

    A rock of height h over a share p of the window has about p h² of variance there: noise, with ``_CHANCE``,
    explains noise / (p h²) of it, and so much of h is lost. That holds while it is little: a quarter at most.
    """
    window = (2.0 * HALF_CELLS + 1.0) ** 2
    lost = (1.0 + _CHANCE * np.sqrt(2.0 / (window - 3.0))) * noise / (_ROCK_SHARE * height_m)
    return np.minimum(lost, 0.25 * height_m)


def footprint_noise(variance: Float, seen: Mask, half: int) -> tuple[Float, Float]:
    """Mean variance of the observed heights in the square of ``2 half + 1`` cells, and how many are observed."""
    edge = (2 * half + 1, 2 * half + 1)
    grids = (np.where(seen, variance, 0.0), seen.astype(np.float64))
    total, count = (cv2.boxFilter(g, cv2.CV_64F, edge, normalize=False, borderType=cv2.BORDER_CONSTANT) for g in grids)
    return np.maximum(total, 0.0) / np.maximum(count, 1.0), count
