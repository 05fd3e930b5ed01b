# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interpolation of a smooth surface through the known cells of a grid."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import LinearOperator, cg

from cdff_common.arrays import BoolArray, FloatArray

#: Residual of the linear system relative to its right side, the known heights above their mean.
_TOLERANCE = 1e-5


def inpaint(heights_m: FloatArray) -> FloatArray:
    """Return the heights with unknown cells filled by the solution of Laplace's equation.

    Parameters
    ----------
    heights_m : ndarray of float64, shape (rows, cols)
        NaN if unknown; at least one is known. The slope across the border of the grid is 0.

    Returns
    -------
    ndarray of float64, shape (rows, cols)
        Each unknown cell is the mean of its neighbours.
    """
    is_unknown = np.isnan(heights_m)
    if not is_unknown.any():
        return heights_m.copy()
    nearest = distance_transform_edt(is_unknown, return_distances=False, return_indices=True)
    filled = heights_m[tuple(nearest)]
    mean_m = float(np.mean(heights_m[~is_unknown]))
    matrix, right_side = _laplace_system(is_unknown, filled - mean_m)
    diagonal = matrix.diagonal()
    preconditioner = LinearOperator(matrix.shape, matvec=lambda v: v / diagonal, dtype=np.float64)
    heights_above_mean_m, _ = cg(
        matrix, right_side, x0=filled[is_unknown] - mean_m, rtol=_TOLERANCE, maxiter=2000, M=preconditioner
    )
    filled[is_unknown] = heights_above_mean_m + mean_m
    return np.asarray(filled)


def _laplace_system(is_unknown: BoolArray, heights_m: FloatArray) -> tuple[csr_matrix, FloatArray]:
    """Return matrix and right side of the Laplace equation of the unknown cells.

    For each of them, its number of neighbours times its height minus the heights of its unknown neighbours
    equals the sum of the heights of its known neighbours.
    """
    rows, cols = is_unknown.shape
    unknown_index = np.full(is_unknown.shape, -1, dtype=np.int64)
    unknown_index[is_unknown] = np.arange(np.count_nonzero(is_unknown))
    r, c = np.nonzero(is_unknown)
    count = len(r)
    degree, right_side = np.zeros(count), np.zeros(count)
    matrix_rows, matrix_columns = [], []
    for dr, dc in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        inside = np.flatnonzero((r + dr >= 0) & (r + dr < rows) & (c + dc >= 0) & (c + dc < cols))
        neighbours = r[inside] + dr, c[inside] + dc
        degree[inside] += 1.0
        is_unknown_neighbour = is_unknown[neighbours]
        matrix_rows.append(inside[is_unknown_neighbour])
        matrix_columns.append(unknown_index[neighbours][is_unknown_neighbour])
        right_side[inside[~is_unknown_neighbour]] += heights_m[neighbours][~is_unknown_neighbour]
    row, column = (np.concatenate([*indices, np.arange(count)]) for indices in (matrix_rows, matrix_columns))
    values = np.concatenate([np.full(len(row) - count, -1.0), degree])
    return csr_matrix((values, (row, column)), shape=(count, count)), right_side
