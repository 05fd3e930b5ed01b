# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A right camera that moves during a drive is reported; rectified pairs and known errors are not."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.stereo_odometry.rectification_monitor import RectificationMonitor
from cdff_core.stereo_odometry.stereo_points import StereoPoints

FOCAL_PX = 718.0
CAMERA = np.array([[FOCAL_PX, 0.0, 607.0], [0.0, FOCAL_PX, 185.0], [0.0, 0.0, 1.0]])
ANGLE_DEG = 0.1


def points_of(rng: np.random.Generator, coefficients: list[float], count: int = 300) -> StereoPoints:
    """Return points whose row offsets have the coefficients of 1, x, y and x y, with noise of 0.2 px."""
    features = rng.uniform([0.0, 0.0], [1240.0, 370.0], (count, 2))
    disparities = rng.uniform(2.0, 60.0, count)
    x = (features[:, 0] - disparities - CAMERA[0, 2]) / FOCAL_PX
    y = (features[:, 1] - CAMERA[1, 2]) / FOCAL_PX
    offsets = np.column_stack([np.ones(count), x, y, x * y]) @ coefficients + rng.normal(0.0, 0.2, count)
    offsets[: count // 20] += rng.uniform(-1.0, 1.0, count // 20)
    return StereoPoints(count, features, disparities, np.zeros((count, 2)), offsets)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ([1.0, 0, 0, 0], "row_offset"),
        ([0, 1.25, 0, 0], "camera_roll"),
        ([0, 0, 0, 1.25], "camera_yaw_change"),
    ],
)
def test_a_change_is_reported_within_three_keyframes(
    rng: np.random.Generator, change: list[float], reason: str
) -> None:
    monitor = RectificationMonitor()
    known = np.array([0.1, 0.0, 0.0, 5.0])
    for _ in range(5):
        assert monitor.update(points_of(rng, known.tolist()), known, CAMERA) == []
    moved = (known + change).tolist()
    reasons = [monitor.update(points_of(rng, moved), known, CAMERA) for _ in range(3)]
    assert reason in [r.split(":")[0] for r in reasons[-1]]
    assert len(reasons[-1]) == 1


def test_angles_are_estimated_in_degrees(rng: np.random.Generator) -> None:
    monitor = RectificationMonitor()
    roll_px = FOCAL_PX * np.deg2rad(ANGLE_DEG)
    for _ in range(3):
        monitor.update(points_of(rng, [0.2, roll_px, 0.0, 5.0]), np.array([0.0, 0.0, 0.0, 5.0]), CAMERA)
    assert monitor.roll_deg == pytest.approx(ANGLE_DEG, abs=0.01)
    assert monitor.row_offset_px == pytest.approx(0.2, abs=0.05)
    assert monitor.yaw_change_deg == pytest.approx(0.0, abs=0.03)


def test_few_points_and_points_along_a_line_are_not_reported(rng: np.random.Generator) -> None:
    monitor = RectificationMonitor()
    assert monitor.update(points_of(rng, [2.0, 0.0, 0.0, 0.0], count=20), np.zeros(4), CAMERA) == []
    monitor = RectificationMonitor()
    on_axis = points_of(rng, [0.0, 0.0, 0.0, 0.0], count=100)
    on_axis.features[:, 0] = 607.0 + on_axis.disparities
    for _ in range(3):
        assert monitor.update(on_axis, np.zeros(4), CAMERA) == []
