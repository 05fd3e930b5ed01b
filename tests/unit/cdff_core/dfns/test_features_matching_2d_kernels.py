# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled searches of image features agree with exhaustive distances by numpy, with and without a geometry."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.features_matching_2d._kernels import (
    EXCLUDED,
    Neighbours,
    search_along_lines,
    update_nearest,
)

Array = np.ndarray


def empty(n: int, m: int) -> Neighbours:
    return Neighbours(
        np.full(n, -1),
        np.full((n, 2), EXCLUDED, np.float32),
        np.full(m, -1),
        np.full(m, EXCLUDED, np.float32),
    )


def assert_nearest(neighbours: Neighbours, distances2: Array) -> None:
    """Compare with distances (n, m), ``EXCLUDED`` for pairs that are not candidates."""
    excluded = float(EXCLUDED)
    np.testing.assert_array_equal(
        neighbours.sink, np.where(distances2.min(axis=1) < excluded, distances2.argmin(axis=1), -1)
    )
    np.testing.assert_array_equal(neighbours.sink_distances2, np.sort(distances2, axis=1)[:, :2])
    np.testing.assert_array_equal(
        neighbours.source, np.where(distances2.min(axis=0) < excluded, distances2.argmin(axis=0), -1)
    )
    np.testing.assert_array_equal(neighbours.source_distances2, distances2.min(axis=0))


@pytest.mark.parametrize("sizes", [[6], [2, 3, 1]])
def test_blocks_of_distances_give_the_nearest_of_all(sizes: list[int]) -> None:
    distances2 = np.random.default_rng(1).integers(0, 3, (6, 4)).astype(np.float32)
    neighbours, start = empty(6, 4), 0
    for size in sizes:
        update_nearest(distances2[start : start + size], start, neighbours)
        start += size
    assert_nearest(neighbours, distances2)


def binary_distance2(a: Array, b: Array) -> float:
    return float(np.unpackbits(a ^ b).sum())


def euclidean_distance2(a: Array, b: Array) -> float:
    return float(np.sum((a.astype(int) - b.astype(int)) ** 2))


@pytest.mark.parametrize("is_hamming", [True, False])
@pytest.mark.parametrize("band_px", [0.5, 2.0, 100.0])
def test_candidates_are_the_pairs_within_the_band_of_the_epipolar_line(
    is_hamming: bool, band_px: float
) -> None:
    rng = np.random.default_rng(2)
    n, m = 9, 8
    source, sink = (rng.integers(0, 256, (k, 4)).astype(np.uint8) for k in (n, m))
    sink[3] = sink[5]
    coefficients = np.column_stack([rng.normal(size=(n, 2)), rng.normal(0.0, 2.0, n)])
    x, y = rng.uniform(-3.0, 3.0, (2, m))
    gradients2 = rng.uniform(0.2, 2.0, m)
    lines = np.column_stack([coefficients, np.sum(coefficients[:, :2] ** 2, axis=1)]).astype(np.float32)
    points = np.array([x, y, gradients2], np.float32)
    distance2 = binary_distance2 if is_hamming else euclidean_distance2
    distances2 = np.full((n, m), EXCLUDED, np.float32)
    for i in range(n):
        for j in range(m):
            error = coefficients[i] @ [x[j], y[j], 1.0]
            if abs(error) / np.sqrt(np.sum(coefficients[i, :2] ** 2) + gradients2[j]) <= band_px:
                distances2[i, j] = distance2(source[i], sink[j])
    assert (distances2 < EXCLUDED).any()
    neighbours = empty(n, m)
    search_along_lines(source, sink, lines, points, band_px, is_hamming, neighbours)
    assert_nearest(neighbours, distances2)


def test_a_point_at_the_border_of_the_band_is_a_candidate() -> None:
    lines = np.array([[1.0, 0.0, 0.0, 1.0]], np.float32)
    points = np.array([[2.0, 2.0001, -2.0], [0.0, 0.0, 0.0], [3.0, 3.0, 3.0]], np.float32)
    neighbours = empty(1, 3)
    descriptors = np.zeros((3, 2), np.uint8)
    search_along_lines(descriptors[:1], descriptors, lines, points, 1.0, True, neighbours)
    assert neighbours.source.tolist() == [0, -1, 0]
