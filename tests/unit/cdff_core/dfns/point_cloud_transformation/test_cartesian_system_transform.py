# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CartesianSystemTransform: points change frame."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.point_cloud_transformation._interface import PointCloudTransformationInputs
from cdff_core.dfns.point_cloud_transformation.cartesian_system_transform import CartesianSystemTransform


def test_there_and_back_again_leaves_the_points(rng: np.random.Generator) -> None:
    node = CartesianSystemTransform()
    node.configure()
    points, T = rng.normal(size=(10, 3)), se3.exp_se3([1.0, 2, 3, 0.1, 0.2, 0.3])
    there = node.process(PointCloudTransformationInputs(points, T)).transformed_points
    np.testing.assert_allclose(there[0], T[:3, :3] @ points[0] + T[:3, 3])
    back = node.process(PointCloudTransformationInputs(there, se3.inverse(T))).transformed_points
    np.testing.assert_allclose(back, points)


def test_a_scaling_matrix_is_no_transform() -> None:
    node = CartesianSystemTransform()
    node.configure()
    with pytest.raises(InputError, match="rigid"):
        node.process(PointCloudTransformationInputs(np.zeros((1, 3)), 2.0 * np.eye(4)))
