# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfpcs.lidar_slam.rotation_search import SupportMonitor, rotations_about_lidar_axis


def test_the_first_sweep_and_an_unexpected_support_start_a_search() -> None:
    monitor = SupportMonitor()
    assert monitor.is_low(0.9)  # nothing to compare with
    for _ in range(5):
        monitor.update(0.6)
    assert not monitor.is_low(0.5)
    assert monitor.is_low(0.4)


def test_without_a_significantly_better_rotation_the_prediction_is_kept() -> None:
    monitor = SupportMonitor()
    monitor.update(0.6)
    assert not monitor.is_better(0.41, 0.40)  # flat ground: every rotation fits
    assert not monitor.is_better(0.40, 0.20)  # less than expected of a sweep on the map
    assert monitor.is_better(0.60, 0.20)


def test_the_candidates_keep_the_position_and_the_axis_of_the_lidar() -> None:
    T = se3.exp_se3(np.array([1.0, 2.0, 3.0, 0.1, -0.2, 0.3]))
    candidates = rotations_about_lidar_axis(T)
    np.testing.assert_allclose(candidates[:, :3, 3], np.tile(T[:3, 3], (len(candidates), 1)))
    np.testing.assert_allclose(candidates[:, :3, 2], np.tile(T[:3, 2], (len(candidates), 1)), atol=1e-12)
    angles_rad = se3.rotation_angle(candidates[:, :3, :3] @ T[:3, :3].T)
    assert np.degrees(np.max(angles_rad)) > 175.0
    # With the pose itself, the candidates divide the circle into equal steps.
    about_axis = se3.log_so3(T[:3, :3].T @ candidates[:, :3, :3])[:, 2]
    angles_deg = np.sort(np.mod(np.degrees(np.append(about_axis, 0.0)), 360.0))
    np.testing.assert_allclose(np.diff(angles_deg), 360.0 / (len(candidates) + 1), atol=1e-6)
    assert len(candidates) == 71
