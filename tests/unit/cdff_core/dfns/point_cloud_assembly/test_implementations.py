# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PointCloudAssembly: joins without doubling, keeps to the view, names what it cannot use."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.point_cloud_assembly._interface import PointCloudAssemblyInputs

IMPLEMENTATIONS = ("VoxelBinning", "NeighbourPointAverage")


def assembled(implementation: str, first: Any, second: Any, *view: Any, **config: float) -> np.ndarray:
    node = Registry.default().make_dfn("point_cloud_assembly", implementation)
    node.configure(config)
    out = node.process(PointCloudAssemblyInputs(np.array(first), np.array(second), *map(np.array, view)))
    return np.asarray(out.assembled_points)


def test_what_both_saw_is_there_once_in_between() -> None:
    first, second = [[0.0, 0, 0], [5.0, 0, 0]], [[0.02, 0, 0], [9.0, 0, 0]]
    expected = [[0.01, 0, 0], [5.0, 0, 0], [9.0, 0, 0]]
    np.testing.assert_allclose(assembled("VoxelBinning", first, second, voxel_m=0.1), expected)
    np.testing.assert_allclose(assembled("NeighbourPointAverage", first, second, distance_m=0.1), expected)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_points_outside_the_view_are_dropped(implementation: str) -> None:
    found = assembled(implementation, [[0.0, 0, 0], [50.0, 0, 0]], [[1.0, 0, 0]], [0.0, 0, 0], 2.0)
    np.testing.assert_allclose(found, [[0.0, 0, 0], [1.0, 0, 0]])
    with pytest.raises(InputError, match="within the view"):
        assembled(implementation, [[50.0, 0, 0]], [[60.0, 0, 0]], [0.0, 0, 0], 2.0)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_one_cloud_may_be_empty_and_a_malformed_one_is_named(implementation: str) -> None:
    np.testing.assert_allclose(assembled(implementation, np.zeros((0, 3)), [[1.0, 2, 3]]), [[1.0, 2, 3]])
    with pytest.raises(InputError, match="second_points"):
        assembled(implementation, [[1.0, 2, 3]], [[1.0, 2]])
    with pytest.raises(InputError, match="radius"):
        assembled(implementation, [[1.0, 2, 3]], [[1.0, 2, 3]], [0.0, 0, 0], -1.0)
