# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Voxelization by a linear octree: leaves, Morton codes with their parents as prefixes, counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.voxelization.interface import VoxelizationInputs


def voxelise(points: Any, leaf_m: float) -> Any:
    node = Registry.default().make_dfn("voxelization")
    node.configure({"leaf_m": leaf_m})
    return node.process(VoxelizationInputs(points=np.asarray(points, dtype=np.float64)))


def test_points_of_one_leaf_are_counted_and_averaged() -> None:
    outputs = voxelise([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [-0.1, 0.6, 0.1]], 0.5)
    np.testing.assert_array_equal(outputs.counts, [1, 2])
    np.testing.assert_allclose(outputs.centres, [[-0.25, 0.75, 0.25], [0.25, 0.25, 0.25]])
    np.testing.assert_allclose(outputs.means[1], [0.2, 0.1, 0.1])
    np.testing.assert_allclose(outputs.origin_m, [-0.5, 0.0, 0.0])
    assert outputs.depth == 1


def test_morton_codes_interleave_the_bits_of_the_indices_and_start_with_the_code_of_the_parent(
    rng: np.random.Generator,
) -> None:
    points = rng.uniform(-20, 20, (3000, 3))
    fine, coarse = voxelise(points, 0.5), voxelise(points, 1.0)
    cell = np.round((fine.centres - fine.origin_m) / 0.5 - 0.5).astype(int)
    expected = [
        sum(((int(c[axis]) >> bit) & 1) << (3 * bit + 2 - axis) for axis in range(3) for bit in range(21))
        for c in cell
    ]
    np.testing.assert_array_equal(fine.codes, expected)
    assert np.all(np.diff(fine.codes) > 0)
    np.testing.assert_allclose(fine.origin_m % 1.0, 0.0)  # so that the cells of both trees are nested
    np.testing.assert_array_equal(np.unique(fine.codes >> 3), coarse.codes)
    assert fine.counts.sum() == 3000


def test_leaves_too_small_for_the_extent_are_refused() -> None:
    with pytest.raises(InputError, match="levels"):
        voxelise([[0.0, 0, 0], [1e6, 0, 0]], 0.1)
