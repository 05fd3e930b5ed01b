# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cholesky factors of sparse symmetric matrices of blocks, by the multifrontal method.

Columns with the same structure are eliminated together in a dense matrix, their front (Duff and Reid 1983,
doi:10.1145/356044.356047; Liu 1992, doi:10.1137/1034004).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_core.dfns.pose_graph_optimization._elimination import Fronts

#: Rows of a triangular matrix inverted by loops; larger matrices are inverted in blocks of this size.
_LOOP_ROWS = 32


class Factors(NamedTuple):
    """Cholesky factors of a matrix with blocks ``(d, d)``.

    Attributes
    ----------
    inverses, below : tuple of ndarray
        Of each front the inverse of the lower triangle ``(w d, w d)`` of its columns, and the rows of the
        factor below them ``(r d, w d)``, flattened one after the other.
    """

    fronts: Fronts
    d: int
    inverses: FloatArray
    below: FloatArray


def factorise(fronts: Fronts, diagonal: FloatArray, lower: FloatArray) -> Factors:
    """Return the factors of the matrix with diagonal blocks ``(n, d, d)`` and the blocks ``lower (s, d, d)``
    of the slots of ``fronts``.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite, or not finite.
    """
    d = diagonal.shape[1]
    inverses, below = (
        np.empty(int(starts[-1]) * d * d) for starts in (fronts.inverse_start, fronts.below_start)
    )
    _factorise(fronts, diagonal, lower, inverses, below)
    return Factors(fronts, d, inverses, below)


def solve(factors: Factors, right: FloatArray) -> FloatArray:
    """Return the solution ``(n d, r)`` for right-hand sides of the same shape."""
    x = np.array(right, dtype=np.float64)
    _solve(factors.fronts, factors.d, factors.inverses, factors.below, x)
    return x


@njit(cache=True)
def _factorise(
    fronts: Fronts, diagonal: FloatArray, lower: FloatArray, inverses: FloatArray, below: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the factors of all fronts, children first; the updates of the parents wait on a stack."""
    n, d = len(diagonal), diagonal.shape[1]
    local, stack, waiting = np.zeros(n, np.int64), np.empty(1024), np.empty(n, np.int64)
    height, count = 0, 0
    for s in range(len(fronts.parent)):
        first, end = fronts.column_start[s], fronts.column_start[s + 1]
        rows = fronts.rows[fronts.row_start[s] : fronts.row_start[s + 1]]
        width, size = end - first, end - first + len(rows)
        for j in range(first, end):
            local[j] = j - first
        for r in range(len(rows)):
            local[rows[r]] = width + r
        F = np.zeros((size * d, size * d))
        for j in range(first, end):
            _add_block(F, (j - first) * d, (j - first) * d, diagonal[j])
        for slot in range(fronts.slot_start[s], fronts.slot_start[s + 1]):
            column = fronts.slot_column[slot] - first
            _add_block(F, local[fronts.slot_row[slot]] * d, column * d, lower[slot])
        while count > 0 and fronts.parent[waiting[count - 1]] == s:
            count -= 1
            child = waiting[count]
            child_rows = fronts.rows[fronts.row_start[child] : fronts.row_start[child + 1]]
            length = (len(child_rows) * d) ** 2
            height -= length
            _add_update(F, stack[height : height + length], child_rows, local, d)
        k = width * d
        X = _inverse_of_lower(np.linalg.cholesky(np.ascontiguousarray(F[:k, :k])))
        start = fronts.inverse_start[s] * d * d
        inverses[start : start + k * k] = X.ravel()
        if len(rows):
            L = np.dot(np.ascontiguousarray(F[k:, :k]), X.T)
            start = fronts.below_start[s] * d * d
            below[start : start + L.size] = L.ravel()
            update = F[k:, k:] - np.dot(L, L.T)
            while height + update.size > len(stack):
                stack = np.concatenate((stack, np.empty(len(stack))))
            stack[height : height + update.size] = update.ravel()
            height += update.size
            waiting[count] = s
            count += 1


@njit(cache=True)
def _add_block(
    F: FloatArray, row: int, column: int, block: FloatArray
) -> None:  # pragma: no cover - compiled
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            F[row + i, column + j] += block[i, j]


@njit(cache=True)
def _add_update(
    F: FloatArray, update: FloatArray, rows: IntArray, local: IntArray, d: int
) -> None:  # pragma: no cover - compiled
    """Add the lower triangle of a child's update, flattened, to the front whose rows are ``local[rows]``."""
    size = len(rows) * d
    for a in range(len(rows)):
        for i in range(d):
            target, source = F[local[rows[a]] * d + i], update[(a * d + i) * size : (a * d + i + 1) * size]
            for b in range(a + 1):
                column = local[rows[b]] * d
                for j in range(d):
                    target[column + j] += source[b * d + j]


@njit(cache=True)
def _inverse_of_lower(L: FloatArray) -> FloatArray:  # pragma: no cover - compiled
    """Return the inverse of a lower triangular matrix."""
    n = len(L)
    X = np.zeros((n, n))
    for first in range(0, n, _LOOP_ROWS):
        end = min(first + _LOOP_ROWS, n)
        S = np.zeros((end - first, end - first))
        for i in range(end - first):
            row = L[first + i, first:end]
            for j in range(i):
                for c in range(j + 1):
                    S[i, c] -= row[j] * S[j, c]
            S[i, i] = 1.0
            for c in range(i + 1):
                S[i, c] /= row[i]
        X[first:end, first:end] = S
        if first:
            inverse_of_first = np.ascontiguousarray(X[:first, :first])
            X[first:end, :first] = -np.dot(
                S, np.dot(np.ascontiguousarray(L[first:end, :first]), inverse_of_first)
            )
    return X


@njit(cache=True)
def _solve(
    fronts: Fronts, d: int, inverses: FloatArray, below: FloatArray, x: FloatArray
) -> None:  # pragma: no cover - compiled
    """Replace right-hand sides ``(n d, r)`` by the solution: forward, then backward substitution."""
    n = len(fronts.parent)
    for step in range(2 * n):
        s = step if step < n else 2 * n - 1 - step
        first, end = fronts.column_start[s] * d, fronts.column_start[s + 1] * d
        rows = fronts.rows[fronts.row_start[s] : fronts.row_start[s + 1]]
        k, m = end - first, len(rows) * d
        start, below_start = fronts.inverse_start[s] * d * d, fronts.below_start[s] * d * d
        X = inverses[start : start + k * k].reshape(k, k)
        L = below[below_start : below_start + m * k].reshape(m, k)
        if step < n:
            y = np.dot(X, x[first:end])
            x[first:end] = y
            if m:
                change = np.dot(L, y)
                for r in range(len(rows)):
                    x[rows[r] * d : (rows[r] + 1) * d] -= change[r * d : (r + 1) * d]
        else:
            y = x[first:end].copy()
            if m:
                solved = np.empty((m, x.shape[1]))
                for r in range(len(rows)):
                    solved[r * d : (r + 1) * d] = x[rows[r] * d : (rows[r] + 1) * d]
                y -= np.dot(L.T, solved)
            x[first:end] = np.dot(X.T, y)
