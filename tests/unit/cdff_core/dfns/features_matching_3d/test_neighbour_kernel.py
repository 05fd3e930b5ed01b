# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled nearest neighbours of blocks of distances agree with sorting."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.features_matching_3d._kernels import no_neighbours, update_nearest


@pytest.mark.parametrize("sizes", [[7], [3, 4], [1] * 7])
def test_blocks_give_the_nearest_and_second_nearest_of_all(sizes: list[int]) -> None:
    distances2 = np.random.default_rng(1).integers(0, 4, (7, 5)).astype(np.float32)
    neighbours = no_neighbours(7, 5)
    start = 0
    for size in sizes:
        update_nearest(distances2[start : start + size], start, neighbours)
        start += size
    np.testing.assert_array_equal(neighbours.target, distances2.argmin(axis=1))
    np.testing.assert_array_equal(neighbours.target_distances2, np.sort(distances2, axis=1)[:, :2])
    np.testing.assert_array_equal(neighbours.source, distances2.argmin(axis=0))
    np.testing.assert_array_equal(neighbours.source_distances2, distances2.min(axis=0))


def test_a_single_target_has_no_second_nearest_and_no_update_leaves_infinite_distances() -> None:
    neighbours = no_neighbours(2, 1)
    assert np.all(neighbours.target_distances2 == np.inf)
    assert np.all(neighbours.source_distances2 == np.inf)
    assert neighbours.target.tolist() == [0, 0]
    update_nearest(np.array([[4.0], [3.0]], np.float32), 0, neighbours)
    np.testing.assert_array_equal(neighbours.target_distances2, [[4.0, np.inf], [3.0, np.inf]])
    assert neighbours.source.tolist() == [1]
