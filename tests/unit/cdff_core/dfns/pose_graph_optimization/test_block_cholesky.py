# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sparse block Cholesky factors: solutions, order of elimination, matrices that are not positive definite."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.arrays import FloatArray
from cdff_core.dfns.pose_graph_optimization._block_cholesky import factorise, solve
from cdff_core.dfns.pose_graph_optimization._elimination import Elimination, analyse


def random_system(
    rng: np.random.Generator, count: int, pairs: int, d: int
) -> tuple[Elimination, FloatArray, FloatArray]:
    """Return the structure and the blocks of a positive definite matrix with the given number of pairs."""
    first = rng.integers(0, count, pairs)
    second = (first + rng.integers(1, max(count, 2), pairs)) % count
    is_pair = first != second
    elimination = analyse(count, first[is_pair], second[is_pair])
    diagonal = np.tile(0.1 * np.eye(d), (count, 1, 1))
    lower = np.zeros((len(elimination.fronts.slot_row), d, d))
    for p, q, slot in zip(
        elimination.position[first[is_pair]],
        elimination.position[second[is_pair]],
        elimination.slot,
        strict=True,
    ):
        J = rng.normal(size=(d, 2 * d))
        H = J.T @ J
        diagonal[p] += H[:d, :d]
        diagonal[q] += H[d:, d:]
        lower[slot] += H[:d, d:] if p > q else H[d:, :d]
    return elimination, diagonal, lower


def dense(elimination: Elimination, diagonal: FloatArray, lower: FloatArray) -> FloatArray:
    """Return the matrix ``(n d, n d)``."""
    count, d, _ = diagonal.shape
    blocks = np.zeros((count, count, d, d))
    blocks[range(count), range(count)] = diagonal
    fronts = elimination.fronts
    blocks[fronts.slot_row, fronts.slot_column] = lower
    blocks[fronts.slot_column, fronts.slot_row] = np.swapaxes(lower, 1, 2)
    return blocks.swapaxes(1, 2).reshape(count * d, count * d)


@pytest.mark.parametrize(
    ("count", "pairs", "d"), [(1, 0, 3), (5, 0, 2), (30, 60, 3), (80, 200, 6), (90, 85, 1)]
)
def test_solutions_agree_with_those_of_the_dense_matrix(
    rng: np.random.Generator, count: int, pairs: int, d: int
) -> None:
    elimination, diagonal, lower = random_system(rng, count, pairs, d)
    right = rng.normal(size=(count * d, 2))
    x = solve(factorise(elimination.fronts, diagonal, lower), right)
    np.testing.assert_allclose(dense(elimination, diagonal, lower) @ x, right, atol=1e-9)


def test_the_position_is_a_permutation_and_slots_are_below_the_diagonal(rng: np.random.Generator) -> None:
    elimination, _, _ = random_system(rng, 60, 120, 1)
    assert sorted(elimination.position) == list(range(60))
    assert np.all(elimination.fronts.slot_row > elimination.fronts.slot_column)


def test_a_chain_is_eliminated_without_new_blocks() -> None:
    first = np.arange(99)
    fronts = analyse(100, first, first + 1).fronts
    blocks = fronts.below_start[-1] + np.sum(
        np.diff(fronts.column_start) * (np.diff(fronts.column_start) - 1) // 2
    )
    assert blocks == 99


def test_an_indefinite_matrix_is_refused(rng: np.random.Generator) -> None:
    elimination, diagonal, lower = random_system(rng, 10, 15, 3)
    diagonal[4] -= 100.0 * np.eye(3)
    with pytest.raises(np.linalg.LinAlgError):
        factorise(elimination.fronts, diagonal, lower)
