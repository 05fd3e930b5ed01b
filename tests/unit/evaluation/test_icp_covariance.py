# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The halves of a scan have no point in common, and their true transform is exact."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from evaluation.icp_covariance import STEP_DEG, STEP_M, halves


def test_the_true_transform_of_the_halves_restores_the_scan(rng: np.random.Generator) -> None:
    points = rng.uniform(-10.0, 10.0, (1000, 3))
    scene, model, T, guess = halves(points, seed=3)
    restored = np.vstack([scene, se3.transform_points(T, model)])
    np.testing.assert_allclose(np.sort(restored, axis=0), np.sort(points, axis=0), atol=1e-9)
    np.testing.assert_array_equal(guess, np.eye(4))


def test_the_halves_are_moved_by_the_stated_distance_and_angle(rng: np.random.Generator) -> None:
    _, _, T, _ = halves(rng.uniform(-10.0, 10.0, (1000, 3)), seed=4)
    np.testing.assert_allclose(np.linalg.norm(T[:3, 3]), STEP_M)
    np.testing.assert_allclose(np.degrees(se3.rotation_angle(T[:3, :3])), STEP_DEG)
