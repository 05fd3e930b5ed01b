# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error, rotate_covariance
from cdff_core.visual_map.pose_fit import fit_pose

T_CAMERA_MAP = se3.transform(se3.exp_so3([0.2, -0.3, 0.1]), [0.4, -0.2, 0.5])


def measurements(
    rng: np.random.Generator, n: int = 60, sigma: float = 0.002
) -> tuple[np.ndarray, np.ndarray]:
    """Return points in the map and their noisy directions."""
    camera = np.column_stack([rng.uniform(-2, 2, (n, 2)), rng.uniform(2, 6, n)])
    directions = camera[:, :2] / camera[:, 2:] + rng.normal(0.0, sigma, (n, 2))
    return se3.transform_points(se3.inverse(T_CAMERA_MAP), camera), directions


def test_the_errors_of_the_pose_agree_with_its_covariance() -> None:
    squares = []
    for seed in range(60):
        points, directions = measurements(np.random.default_rng(seed))
        start = se3.exp_se3([0.01, -0.01, 0.01, 0.004, 0.004, -0.004]) @ T_CAMERA_MAP
        fit = fit_pose(start, points, np.zeros((len(points), 3, 3)), directions, 0.002, 4.2)
        T = se3.inverse(fit.T_camera_map)
        e = pose_error(se3.inverse(T_CAMERA_MAP), T)
        squares.append(e @ np.linalg.solve(rotate_covariance(fit.covariance, T[:3, :3]), e))
    assert 0.75 < np.mean(squares) / 6.0 < 1.35


def test_wrong_matches_have_no_weight() -> None:
    points, directions = measurements(np.random.default_rng(0))
    directions[:15] += 0.1
    fit = fit_pose(T_CAMERA_MAP, points, np.zeros((len(points), 3, 3)), directions, 0.002, 4.2)
    assert not fit.inliers[:15].any()
    assert fit.inliers[15:].mean() > 0.9
    assert np.abs(pose_error(T_CAMERA_MAP, fit.T_camera_map)).max() < 0.01


def test_an_uncertain_point_has_less_weight_than_a_certain_one() -> None:
    points, directions = measurements(np.random.default_rng(0), sigma=1e-6)
    covariances = np.zeros((len(points), 3, 3))
    covariances[:20] = 0.1**2 * np.eye(3)
    points[:20] += np.random.default_rng(1).normal(0.0, 0.1, (20, 3))
    fit = fit_pose(T_CAMERA_MAP, points, covariances, directions, 1e-4, 4.2)
    assert np.abs(pose_error(T_CAMERA_MAP, fit.T_camera_map)).max() < 5e-4


def test_points_on_one_ray_are_refused() -> None:
    points = np.outer(np.linspace(1.0, 5.0, 20), [0.0, 0.0, 1.0])
    with pytest.raises(RefusedError) as caught:
        fit_pose(np.eye(4), points, np.zeros((20, 3, 3)), np.zeros((20, 2)), 0.002, 4.2)
    assert caught.value.reasons[0] == "unconstrained"
