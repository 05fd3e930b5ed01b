# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_core.visual_map.focal_length import FocalMonitor, FocalRatio, fit_focal_ratio


def test_a_plane_across_the_axis_does_not_determine_the_focal_length() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (50, 2)), np.full(50, 4.0)])
    covariances = np.broadcast_to(1e-6 * np.eye(3), (50, 3, 3))
    ratio = fit_focal_ratio(np.eye(4), points, covariances, points[:, :2] / 4.0, 1e-3, 4.0)
    assert ratio is None or ratio.sigma > 0.05


def test_a_small_error_is_reported_by_many_images_and_a_large_one_by_one() -> None:
    monitor = FocalMonitor(0.01)
    assert monitor.estimate_px(500.0, FocalRatio(1.08, 0.005)) == pytest.approx(540.0)
    monitor.clear()
    reports = [monitor.estimate_px(500.0, FocalRatio(1.016 + 0.002 * (i % 3), 0.01)) for i in range(10)]
    assert reports[:7] == 7 * [None]
    assert reports[-1] == pytest.approx(509.0, abs=1.0)


def test_images_that_disagree_report_nothing_and_another_camera_starts_again() -> None:
    monitor, rng = FocalMonitor(0.01), np.random.default_rng(0)
    for value in rng.normal(1.0, 0.01, 30):
        assert monitor.estimate_px(500.0, FocalRatio(float(value), 0.01)) is None
    assert monitor.estimate_px(600.0, FocalRatio(1.02, 0.01)) is None
