# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interpolation of a smooth surface through the known cells of a grid."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import LinearOperator, cg

from cdff_common.arrays import BoolArray, FloatArray

#: Residual of the linear system, relative to the level of the known heights about their mean.
_TOLERANCE = 1e-5


def inpainted(heights_m: FloatArray) -> FloatArray:
    """Fill the unknown cells with the solution of Laplace's equation between the known ones.

    Parameters
    ----------
    heights_m : ndarray of float64, shape (rows, cols)
        NaN where unknown; at least one is known. The grid's border is free (no slope across it).

    Returns
    -------
    ndarray of float64, shape (rows, cols)
        A copy in which every unknown cell is the mean of its neighbours.
    """
    hole = np.isnan(heights_m)
    if not hole.any():
        return heights_m.copy()
    nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
    filled = heights_m[tuple(nearest)]
    level = float(np.mean(heights_m[~hole]))
    matrix, right = _laplace(hole, filled - level)
    diagonal = matrix.diagonal()
    scaled = LinearOperator(matrix.shape, matvec=lambda v: v / diagonal, dtype=np.float64)
    solved, _ = cg(matrix, right, x0=filled[hole] - level, rtol=_TOLERANCE, maxiter=2000, M=scaled)
    filled[hole] = solved + level
    return np.asarray(filled)


def _laplace(hole: BoolArray, known_m: FloatArray) -> tuple[csr_matrix, FloatArray]:
    """Return matrix and right side of "sum of neighbours = their number times height" of unknown cells."""
    rows, cols = hole.shape
    number = np.full(hole.shape, -1, dtype=np.int64)
    number[hole] = np.arange(np.count_nonzero(hole))
    r, c = np.nonzero(hole)
    size = len(r)
    degree, right = np.zeros(size), np.zeros(size)
    first, second = [], []
    for dr, dc in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        inside = np.flatnonzero((r + dr >= 0) & (r + dr < rows) & (c + dc >= 0) & (c + dc < cols))
        at = r[inside] + dr, c[inside] + dc
        degree[inside] += 1.0
        unknown = hole[at]
        first.append(inside[unknown])
        second.append(number[at][unknown])
        right[inside[~unknown]] += known_m[at][~unknown]
    i, j = (np.concatenate([*part, np.arange(size)]) for part in (first, second))
    values = np.concatenate([np.full(len(i) - size, -1.0), degree])
    return csr_matrix((values, (i, j)), shape=(size, size)), right
