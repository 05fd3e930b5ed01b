# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CartesianSystemTransform: points are transformed to another frame."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.point_cloud_transformation.cartesian_system_transform import CartesianSystemTransform
from cdff_core.dfns.point_cloud_transformation.interface import PointCloudTransformationInputs


def test_a_transform_and_its_inverse_restore_the_points(rng: np.random.Generator) -> None:
    node = CartesianSystemTransform()
    node.configure()
    points, T = rng.normal(size=(10, 3)), se3.exp_se3([1.0, 2, 3, 0.1, 0.2, 0.3])
    transformed = node.process(PointCloudTransformationInputs(points=points, transform=T)).transformed_points
    np.testing.assert_allclose(transformed[0], T[:3, :3] @ points[0] + T[:3, 3])
    restored = node.process(
        PointCloudTransformationInputs(points=transformed, transform=se3.inverse(T))
    ).transformed_points
    np.testing.assert_allclose(restored, points)


def test_a_scaling_matrix_is_refused() -> None:
    node = CartesianSystemTransform()
    node.configure()
    with pytest.raises(InputError, match="rigid"):
        node.process(PointCloudTransformationInputs(points=np.zeros((1, 3)), transform=2.0 * np.eye(4)))
