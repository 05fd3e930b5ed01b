# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normalised correlation of two masked vector fields at all translations, by Fourier transforms.

References
----------
.. [1] Padfield, D. (2012). Masked object registration in the Fourier domain. IEEE Transactions on Image
   Processing 21(5). doi:10.1109/TIP.2011.2181402
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from cdff_common.arrays import FloatArray

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """Spectra of a masked vector field.

    Attributes
    ----------
    components : tuple of 2 Complex
        Spectra of the x and y components, 0 where unobserved.
    mask, energy : Complex
        Spectra of the mask and of the squared length.
    """

    components: tuple[Complex, Complex]
    mask: Complex
    energy: Complex


def transform_field(gradient: tuple[FloatArray, FloatArray], shape: tuple[int, int]) -> Field:
    """Return the spectra of a gradient ``(rows, cols)``, NaN where unobserved, padded to ``shape``."""
    observed = np.isfinite(gradient[0])
    x, y = (np.where(observed, g, 0.0) for g in gradient)

    def spectrum(a: FloatArray) -> Complex:
        return np.asarray(fft.rfft2(a, s=shape))

    return Field((spectrum(x), spectrum(y)), spectrum(observed.astype(np.float64)), spectrum(x * x + y * y))


def correlation(template: Field, reference: Field, shape: tuple[int, int], min_cells: float) -> FloatArray:
    """Return the correlation of two vector fields about their means, at every translation; equation numbers
    are those of [1]_.

    Parameters
    ----------
    template, reference : Field
        Fields padded to the same ``shape``.
    min_cells : float
        Minimum number of cells that are observed in both.

    Returns
    -------
    FloatArray, of ``shape``
        Element ``[s]`` is the correlation of ``template[r]`` with ``reference[r + s]``, indices modulo the
        shape; NaN if too few cells are observed in both.
    """

    def sums(a: Complex, b: Complex) -> FloatArray:
        return np.asarray(fft.irfft2(np.conj(a) * b, s=shape))

    (fx, fy), (gx, gy) = template.components, reference.components
    n = sums(template.mask, reference.mask)
    enough = n >= max(min_cells, 1.0) - 0.5
    n = np.where(enough, n, 1.0)
    f_x, f_y = sums(fx, reference.mask), sums(fy, reference.mask)
    g_x, g_y = sums(template.mask, gx), sums(template.mask, gy)
    # Numerator of eq. 12; f and g are the factors of its denominator.
    numerator = np.asarray(fft.irfft2(np.conj(fx) * gx + np.conj(fy) * gy, s=shape))
    numerator -= (f_x * g_x + f_y * g_y) / n
    f = sums(template.energy, reference.mask) - (f_x**2 + f_y**2) / n
    g = sums(template.mask, reference.energy) - (g_x**2 + g_y**2) / n
    floor = 1e-9 * max(float(f.max()), 1e-300) * max(float(g.max()), 1e-300)
    product = f * g
    usable = enough & (f > 0.0) & (g > 0.0) & (product > floor)
    return np.where(usable, np.clip(numerator / np.sqrt(np.where(usable, product, 1.0)), -1.0, 1.0), np.nan)
