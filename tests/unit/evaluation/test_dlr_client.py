# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of DLR's client: the mesh has the size of the mock-up, and the start pose shows it in both images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cdff_common.geometry import se3
from evaluation.data_sets import dlr_client


def test_mesh_cameras_and_start_pose_are_read(real_data: Callable[[str], Path]) -> None:
    data = real_data(dlr_client.FOLDER).parent
    vertices, triangles = dlr_client.mesh(data)
    # The body is 0.39 m long; the cylinder in front of it adds 0.2 m. The ring has a diameter of about 1.1 m.
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.59, 1.1, 1.1], atol=0.05)
    assert triangles.min() == 0
    assert triangles.max() == len(vertices) - 1
    left, right = dlr_client.cameras(data)
    T = dlr_client.start_pose(data, left)
    for camera in (left, right):
        assert camera.image.shape == (406, 528)
        in_camera = se3.inverse(camera.T_world_camera) @ left.T_world_camera @ T
        points = se3.transform_points(in_camera, vertices)
        pixels = points @ camera.matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        assert ((pixels > 0) & (pixels < [528, 406])).all(axis=1).mean() > 0.95
    baseline_m = np.linalg.norm(left.T_world_camera[:3, 3] - right.T_world_camera[:3, 3])
    assert 0.07 < baseline_m < 0.08
