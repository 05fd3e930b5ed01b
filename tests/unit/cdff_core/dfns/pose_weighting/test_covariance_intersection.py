# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CovarianceIntersection: consistent fusion of two estimates with unknown correlation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.pose_weighting.interface import PoseWeightingInputs, PoseWeightingOutputs

WIDE_X = np.diag([1.0, 0.01, 0.01, 1e-3, 1e-3, 1e-3])
WIDE_Y = np.diag([0.01, 1.0, 0.01, 1e-3, 1e-3, 1e-3])


def fuse(
    first: np.ndarray, first_covariance: np.ndarray, second: np.ndarray, second_covariance: np.ndarray
) -> PoseWeightingOutputs:
    node = Registry.default().make_dfn("pose_weighting")
    node.configure()
    return node.process(
        PoseWeightingInputs(
            first=first, first_covariance=first_covariance, second=second, second_covariance=second_covariance
        )
    )


def test_equal_covariances_get_equal_weights_in_their_informative_directions() -> None:
    outputs = fuse(np.eye(4), WIDE_X, se3.transform(np.eye(3), [0.4, 0.4, 0]), WIDE_Y)
    assert outputs.weight == pytest.approx(0.5)
    np.testing.assert_allclose(outputs.pose[:3, 3], [0.4 / 1.01, 0.4 * 0.01 / 1.01, 0.0], atol=1e-9)
    assert outputs.covariance[0, 0] == pytest.approx(2 / 101)


def test_an_estimate_worse_in_every_direction_gets_no_weight() -> None:
    T = se3.exp_se3([0.1, 0, 0, 0, 0, 0.1])
    outputs = fuse(T, 0.5 * WIDE_X, np.eye(4), WIDE_X)
    assert outputs.weight == 1.0
    np.testing.assert_allclose(outputs.pose, T, atol=1e-12)
    assert fuse(np.eye(4), WIDE_X, T, 0.5 * WIDE_X).weight == 0.0


def test_the_weight_minimises_the_determinant_of_the_covariance(rng: np.random.Generator) -> None:
    A, B = rng.normal(size=(2, 6, 6))
    C1, C2 = A @ A.T + 0.1 * np.eye(6), B @ B.T + 0.1 * np.eye(6)

    def log_determinant(w: float) -> float:
        return -float(np.linalg.slogdet(w * np.linalg.inv(C1) + (1 - w) * np.linalg.inv(C2))[1])

    best = minimize_scalar(log_determinant, bounds=(0, 1), method="bounded", options={"xatol": 1e-9})
    assert fuse(np.eye(4), C1, np.eye(4), C2).weight == pytest.approx(best.x, abs=1e-5)


def test_the_covariance_is_consistent_for_estimates_with_a_common_error(rng: np.random.Generator) -> None:
    C = np.diag(np.square([0.1, 0.1, 0.1, 0.01, 0.01, 0.01]))
    nees = []
    for _ in range(300):
        common, independent = rng.normal(size=(2, 6)) * np.sqrt(np.diagonal(C))
        T1, T2 = se3.exp_se3(common), se3.exp_se3(0.9 * common + np.sqrt(1 - 0.81) * independent)
        outputs = fuse(T1, C, T2, C)
        e = pose_error(np.eye(4), outputs.pose)
        nees.append(e @ np.linalg.solve(outputs.covariance, e))
    assert 5.0 < np.mean(nees) < 6.4


def test_a_matrix_that_is_not_a_covariance_is_refused() -> None:
    with pytest.raises(InputError):
        fuse(np.eye(4), -np.eye(6), np.eye(4), np.eye(6))
