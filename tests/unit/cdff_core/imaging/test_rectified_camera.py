# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.imaging.rectified_camera import RectifiedCamera
from tests.support.corridor import BASELINE_M, CAMERA


def test_projection_is_the_inverse_of_triangulation_and_so_are_their_jacobians(
    rng: np.random.Generator,
) -> None:
    camera = RectifiedCamera.from_matrix(CAMERA, BASELINE_M)
    uvd = np.column_stack([rng.uniform(0, 320, 20), rng.uniform(0, 240, 20), rng.uniform(2, 60, 20)])
    points = camera.triangulate(uvd)
    np.testing.assert_allclose(camera.project(points), uvd, atol=1e-9)
    product = camera.projection_jacobian(points) @ camera.triangulation_jacobian(uvd)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-9)


@pytest.mark.parametrize(
    ("matrix", "baseline"), [(np.zeros((3, 3)), 0.2), (np.eye(4), 0.2), (CAMERA, -0.1), (CAMERA, np.nan)]
)
def test_an_invalid_camera_is_refused(matrix: np.ndarray, baseline: float) -> None:
    with pytest.raises(InputError):
        RectifiedCamera.from_matrix(matrix, baseline)
