# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled scatters and local maxima agree with sums over the neighbours by numpy."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.features_extraction_3d._kernels import (
    are_local_maxima,
    normal_scatters,
    weighted_scatters,
)


def test_scatters_weight_each_neighbour_by_the_inverse_of_its_own_number() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(6, 3))
    rows = [[0, 1, 2], [1, 0], [0, 1, 2, 3], [3], [5, 3, 4], [4, 5, 0, 1, 2]]
    start, index = np.cumsum([0, *map(len, rows)]), np.concatenate(rows)
    out = weighted_scatters(points, start, index)
    for i, neighbours in enumerate(rows):
        weights = {j: 1.0 / len(rows[j]) for j in neighbours if j != i}
        total = sum(weights.values())
        expected = sum((w * np.outer(points[j] - points[i], points[j] - points[i]) for j, w in weights.items()),
                       np.zeros((3, 3)))  # fmt: skip
        np.testing.assert_allclose(out[i], expected / total if total else expected, rtol=1e-12)


def test_a_local_maximum_has_no_neighbour_of_more_salience_and_is_the_first_of_equal_ones() -> None:
    salience = np.array([1.0, 3.0, 3.0, 2.0, 0.0])
    candidates = np.array([1, 2, 3, 4, 0])
    rows = [[0, 1, 2], [2, 1, 3], [3, 0, 4], [4], [0, 3]]
    start, index = np.cumsum([0, *map(len, rows)]), np.concatenate(rows)
    assert are_local_maxima(salience, candidates, start, index).tolist() == [True, False, True, True, False]
    assert len(are_local_maxima(salience, candidates[:0], start[:1], index[:0])) == 0


def test_the_mean_outer_product_of_normals_is_zero_without_neighbours() -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(5, 3))
    start, index = np.array([0, 3, 3, 4, 6]), np.array([0, 2, 4, 1, 3, 3])
    out = normal_scatters(normals, start, index)
    for i in range(4):
        near = normals[index[start[i] : start[i + 1]]]
        np.testing.assert_allclose(out[i], near.T @ near / max(len(near), 1), rtol=1e-12, atol=1e-15)
