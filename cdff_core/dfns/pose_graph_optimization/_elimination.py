# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Order of elimination and structure of the factors of a sparse symmetric matrix of blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from cdff_common.arrays import BoolArray, IntArray


class Fronts(NamedTuple):
    """Groups of adjacent columns with the same structure, children before parents.

    Rows and columns are positions in the order of elimination. A slot is a block below the diagonal that the
    matrix has before the elimination.

    Attributes
    ----------
    column_start : ndarray of int64, shape (f + 1,)
        First column of each front.
    parent : ndarray of int64, shape (f,)
        Front that eliminates the first row of each front, or -1.
    row_start, rows : ndarray of int64, shapes (f + 1,) and (r,)
        Rows of each front below its columns, ascending.
    slot_start : ndarray of int64, shape (f + 1,)
        First slot of each front.
    slot_row, slot_column : ndarray of int64, shape (s,)
    inverse_start, below_start : ndarray of int64, shape (f + 1,)
        First block of each front in the flattened factors.
    """

    column_start: IntArray
    parent: IntArray
    row_start: IntArray
    rows: IntArray
    slot_start: IntArray
    slot_row: IntArray
    slot_column: IntArray
    inverse_start: IntArray
    below_start: IntArray


class Elimination(NamedTuple):
    """Order and structure of a matrix whose blocks below the diagonal belong to pairs of unknowns.

    Attributes
    ----------
    fronts : Fronts
    position : ndarray of int64, shape (n,)
        Position of each unknown in the order of elimination.
    slot : ndarray of int64, shape (m,)
        Slot of each pair.
    is_first_later : ndarray of bool, shape (m,)
        True if the first unknown of the pair is the row of the slot, so the second one its column.
    """

    fronts: Fronts
    position: IntArray
    slot: IntArray
    is_first_later: BoolArray


def analyse(count: int, first: IntArray, second: IntArray) -> Elimination:
    """Return order and structure for ``count`` unknowns, at least one, and pairs ``(m,)`` of them."""
    position = _minimum_degree(count, first, second)
    start, columns = _by_row(count, *_order_pairs(position[first], position[second]))
    position = _postorder(_elimination_tree(start, columns))[position]
    row, column = _order_pairs(position[first], position[second])
    keys, slot = np.unique(column * count + row, return_inverse=True)
    slot_column, slot_row = np.divmod(keys, count)
    start, columns = _by_row(count, slot_row, slot_column)
    column_start, row_start, rows = _structure(start, columns, _elimination_tree(start, columns))
    width, length = np.diff(column_start), np.diff(row_start)
    front = np.repeat(np.arange(len(width)), width)  # of each column
    parent = np.full(len(width), -1)
    parent[length > 0] = front[rows[row_start[:-1][length > 0]]]
    fronts = Fronts(
        column_start=column_start,
        parent=parent,
        row_start=row_start,
        rows=rows,
        slot_start=np.searchsorted(slot_column, column_start),
        slot_row=slot_row,
        slot_column=slot_column,
        inverse_start=np.concatenate([[0], np.cumsum(width * width)]),
        below_start=np.concatenate([[0], np.cumsum(width * length)]),
    )
    return Elimination(fronts, position, slot.reshape(-1), position[first] > position[second])


def _minimum_degree(count: int, first: IntArray, second: IntArray) -> IntArray:
    """Return the position of each unknown in an order of elimination with few new blocks.

    Multiple minimum degree (Liu 1985, doi:10.1145/214392.214398), as SuperLU applies it before it factorises;
    the matrix factorised here only has the structure.
    """
    degree = np.bincount(first, minlength=count) + np.bincount(second, minlength=count)
    unknowns = np.arange(count)
    values = np.concatenate([-np.ones(2 * len(first)), degree + 1.0])
    rows, columns = np.concatenate([first, second, unknowns]), np.concatenate([second, first, unknowns])
    matrix = coo_matrix((values, (rows, columns)), shape=(count, count)).tocsc()
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(factors.perm_c, np.int64)


def _order_pairs(first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Return the larger and the smaller element of each pair."""
    return np.maximum(first, second), np.minimum(first, second)


def _by_row(count: int, row: IntArray, column: IntArray) -> tuple[IntArray, IntArray]:
    """Return the start of each row ``(n + 1,)`` in the columns sorted by row."""
    order = np.argsort(row, kind="stable")
    return np.searchsorted(row[order], np.arange(count + 1)), column[order]


@njit(cache=True)
def _elimination_tree(start: IntArray, columns: IntArray) -> IntArray:  # pragma: no cover - compiled
    """Return the parent of each column, or -1, with path compression (Liu 1990, doi:10.1137/0611010)."""
    n = len(start) - 1
    parent, ancestor = np.full(n, -1), np.full(n, -1)
    for row in range(n):
        for p in range(start[row], start[row + 1]):
            j = columns[p]
            while j != -1 and j < row:
                following, ancestor[j] = ancestor[j], row
                if following == -1:
                    parent[j] = row
                j = following
    return parent


@njit(cache=True)
def _postorder(parent: IntArray) -> IntArray:  # pragma: no cover - compiled
    """Return the position of each column if each follows its last descendant."""
    n = len(parent)
    child, sibling = np.full(n, -1), np.full(n, -1)
    for j in range(n - 1, -1, -1):
        if parent[j] >= 0:
            sibling[j], child[parent[j]] = child[parent[j]], j
    position, path, count = np.empty(n, np.int64), np.empty(n, np.int64), 0
    for root in range(n):
        if parent[root] >= 0:
            continue
        path[0], height = root, 1
        while height:
            j = path[height - 1]
            if child[j] >= 0:
                path[height], child[j] = child[j], sibling[child[j]]
                height += 1
            else:
                position[j] = count
                count += 1
                height -= 1
    return position


@njit(cache=True)
def _structure(
    start: IntArray, columns: IntArray, parent: IntArray
) -> tuple[IntArray, IntArray, IntArray]:  # pragma: no cover - compiled
    """Return the first column of each front, and start and elements of its rows below the columns.

    The rows of column j of the factor are those whose path from a column of the row to the root of the tree,
    up to the row, contains j.
    """
    n = len(parent)
    length, mark = np.zeros(n, np.int64), np.full(n, -1)
    for row in range(n):
        mark[row] = row
        for p in range(start[row], start[row + 1]):
            j = columns[p]
            while mark[j] != row:
                mark[j] = row
                length[j] += 1
                j = parent[j]
    is_last = np.ones(n, np.bool_)  # of its front
    for j in range(n - 1):
        is_last[j] = parent[j] != j + 1 or length[j] != length[j + 1] + 1
    last = np.flatnonzero(is_last)
    column_start, row_start = np.zeros(len(last) + 1, np.int64), np.zeros(len(last) + 1, np.int64)
    front = np.full(n, -1)  # of its last column
    for s in range(len(last)):
        column_start[s + 1], row_start[s + 1] = last[s] + 1, row_start[s] + length[last[s]]
        front[last[s]] = s
    rows, filled = np.empty(row_start[-1], np.int64), row_start.copy()
    mark[:] = -1
    for row in range(n):
        mark[row] = row
        for p in range(start[row], start[row + 1]):
            j = columns[p]
            while mark[j] != row:
                mark[j] = row
                s = front[j]
                if s >= 0:
                    rows[filled[s]] = row
                    filled[s] += 1
                j = parent[j]
    return column_start, row_start, rows
