# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pairs that are reused by successive iterations are those of a search of all points."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, nearest
from cdff_core.dfns.registration_3d._kernels import no_pairs, pair


@pytest.mark.parametrize("step_m", [0.0, 0.003, 0.1, 3.0])
def test_reused_pairs_agree_with_a_search_of_all_points(step_m: float, rng: np.random.Generator) -> None:
    target, source = (rng.uniform(-5.0, 5.0, (3000, 3)) * [1.0, 1.0, 0.02] for _ in range(2))
    tree, pairs, T = kd_tree(target), no_pairs(len(source)), np.eye(4)
    for gate_m in (4.0, 0.5, 0.2, 0.2, 0.1, 0.3, 0.1, 0.1):
        T = se3.exp_se3(step_m * rng.normal(size=6) * [1.0, 1.0, 1.0, 0.2, 0.2, 0.2]) @ T
        count = pair(tree, source, T, gate_m, pairs)
        distance_m, row = nearest(tree, se3.transform_points(T, source), gate_m)
        is_paired = np.isfinite(distance_m)
        assert count == np.count_nonzero(is_paired)
        np.testing.assert_array_equal(pairs.row >= 0, is_paired)
        np.testing.assert_array_equal(tree.order[pairs.row[is_paired]], row[is_paired])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_point_that_moved_to_the_opposite_side_is_paired_again(axis: int) -> None:
    here, there = np.eye(3)[axis], -np.eye(3)[axis]
    tree, pairs = kd_tree(np.stack([here, there])), no_pairs(1)
    for position in (here, there, here):
        T = se3.transform(np.eye(3), position - here)
        assert pair(tree, here[None], T, 10.0, pairs) == 1
        np.testing.assert_array_equal(tree.points[pairs.row[0]], position)
