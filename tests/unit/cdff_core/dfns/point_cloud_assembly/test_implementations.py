# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PointCloudAssembly merges clouds without duplicates, crops them to the view, refuses malformed input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.point_cloud_assembly.interface import PointCloudAssemblyInputs

IMPLEMENTATIONS = ("VoxelBinning", "NeighbourPointAverage")


def assemble(
    implementation: str, first: Any, second: Any, view: tuple[Any, float] | None = None, **config: float
) -> np.ndarray:
    node = Registry.default().make_dfn("point_cloud_assembly", implementation)
    node.configure(config)
    outputs = node.process(
        PointCloudAssemblyInputs(
            first_points=np.array(first),
            second_points=np.array(second),
            view_centre_m=None if view is None else np.array(view[0]),
            view_radius_m=None if view is None else float(view[1]),
        )
    )
    return np.asarray(outputs.assembled_points)


def test_nearby_points_of_both_clouds_are_averaged_and_the_others_retained() -> None:
    first, second = [[0.0, 0, 0], [5.0, 0, 0]], [[0.02, 0, 0], [9.0, 0, 0]]
    expected = [[0.01, 0, 0], [5.0, 0, 0], [9.0, 0, 0]]
    np.testing.assert_allclose(assemble("VoxelBinning", first, second, voxel_m=0.1), expected)
    np.testing.assert_allclose(assemble("NeighbourPointAverage", first, second, distance_m=0.1), expected)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_points_outside_the_view_are_removed(implementation: str) -> None:
    result = assemble(implementation, [[0.0, 0, 0], [50.0, 0, 0]], [[1.0, 0, 0]], ([0.0, 0, 0], 2.0))
    np.testing.assert_allclose(result, [[0.0, 0, 0], [1.0, 0, 0]])
    with pytest.raises(InputError, match="within the view"):
        assemble(implementation, [[50.0, 0, 0]], [[60.0, 0, 0]], ([0.0, 0, 0], 2.0))


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_the_radius_of_the_view_is_a_distance_from_its_centre(implementation: str) -> None:
    first = [[10.0, 2.9, 0], [10.0, 3.1, 0], [0.0, 0, 0]]
    result = assemble(implementation, first, [[10.0, 0, -0.1]], ([10.0, 0, 0], 3.0))
    np.testing.assert_allclose(np.sort(result, axis=0), np.sort([[10.0, 2.9, 0], [10.0, 0, -0.1]], axis=0))


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_one_cloud_may_be_empty_and_a_malformed_one_is_refused_with_its_name(implementation: str) -> None:
    np.testing.assert_allclose(assemble(implementation, np.zeros((0, 3)), [[1.0, 2, 3]]), [[1.0, 2, 3]])
    with pytest.raises(InputError, match="second_points"):
        assemble(implementation, [[1.0, 2, 3]], [[1.0, 2]])
    with pytest.raises(InputError, match="radius"):
        assemble(implementation, [[1.0, 2, 3]], [[1.0, 2, 3]], ([0.0, 0, 0], -1.0))
