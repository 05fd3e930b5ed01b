# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Relative pose of two cameras: pairs whose rays intersect behind a camera."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.imaging.relative_pose import depths, fit_in_front, rays

K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
SIGMA_PX = 0.5


@pytest.mark.parametrize(("sigmas", "is_used"), [(-2.0, True), (-4.5, False)])
def test_pairs_behind_the_cameras_are_used_only_if_their_rays_are_parallel_within_three_sigmas(
    sigmas: float, is_used: bool
) -> None:
    """The cameras are 1 m apart along their rows: the parallax of a point is its disparity."""
    rng = np.random.default_rng(2)
    source = np.column_stack([rng.uniform(20, 620, 300), rng.uniform(20, 460, 300)])
    disparities = 500.0 / rng.uniform(5.0, 20.0, 300)
    # Both images have the error, thus the difference of two columns the square root of 2 times it.
    disparities[:40] = sigmas * np.sqrt(2.0) * SIGMA_PX
    sink = source - np.column_stack([disparities, np.zeros(300)])
    sink[40:] += rng.normal(0.0, np.sqrt(2.0) * SIGMA_PX, (260, 2))
    fit, R, t = fit_in_front(
        np.eye(3), np.array([-1.0, 0.0, 0.0]), (K, K), source, sink, gate_sigmas=4.0, floor_px=SIGMA_PX
    )
    assert fit.inliers[:40].all() if is_used else not fit.inliers[:40].any()
    assert fit.inliers[40:].mean() > 0.95
    assert min(d[40:].min() for d in depths(R, t, rays(source, K), rays(sink, K))) > 0.0
