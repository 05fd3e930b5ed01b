# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EllipsoidalIntersection: the better of two along each direction, never more than either knew."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.pose_estimation._interface import PoseEstimationInputs, PoseEstimationOutputs

TIGHT, LOOSE = np.diag([1e-4] * 3 + [1e-6] * 3), np.diag([1.0] * 3 + [0.01] * 3)


def joined(*inputs: np.ndarray) -> PoseEstimationOutputs:
    node = Registry.default().make_dfn("pose_estimation")
    node.configure()
    return node.process(PoseEstimationInputs(*inputs))


def test_a_sharp_measurement_replaces_a_vague_prediction() -> None:
    T = se3.exp_se3([0.5, -0.3, 0.2, 0.02, 0.05, -0.04])
    out = joined(np.eye(4), LOOSE, T, TIGHT)
    np.testing.assert_allclose(out.pose, T, atol=1e-9)
    np.testing.assert_allclose(out.covariance, TIGHT, rtol=1e-6, atol=1e-11)
    assert int(out.measured_directions) == 6


def test_along_a_direction_that_is_free_the_prediction_stays() -> None:
    free = TIGHT.copy()
    free[0, 0] = 100.0
    out = joined(np.eye(4), LOOSE, se3.exp_se3([0.5, 0.5, 0, 0, 0, 0]), free)
    np.testing.assert_allclose(out.pose[:3, 3], [0.0, 0.5, 0.0], atol=1e-6)
    assert out.covariance[0, 0] == pytest.approx(1.0)
    assert int(out.measured_directions) == 5


def test_repeating_a_measurement_adds_no_knowledge() -> None:
    out = joined(np.eye(4), TIGHT, np.eye(4), TIGHT)
    np.testing.assert_allclose(out.covariance, TIGHT, rtol=1e-6, atol=1e-11)


def test_directions_need_not_be_axes() -> None:
    R = se3.exp_so3([0.3, 0.5, 0.7])
    turn = np.eye(6)
    turn[:3, :3] = R
    free = turn @ np.diag([1e2, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6]) @ turn.T
    out = joined(np.eye(4), LOOSE, se3.transform(np.eye(3), R @ [0.5, 0.4, 0.3]), free)
    np.testing.assert_allclose(R.T @ out.pose[:3, 3], [0.0, 0.4, 0.3], atol=1e-3)


def test_what_contradicts_the_prediction_is_refused() -> None:
    with pytest.raises(RefusedError) as refusal:
        joined(np.eye(4), TIGHT, se3.exp_se3([0.2, 0, 0, 0, 0, 0]), TIGHT)
    assert refusal.value.reasons[0].startswith("innovation:")


def test_a_covariance_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="covariance"):
        joined(np.eye(4), -TIGHT, np.eye(4), TIGHT)
