# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EllipsoidalIntersection: selection of the smaller variance in each direction, gate on the innovation."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.pose_estimation.interface import PoseEstimationInputs, PoseEstimationOutputs

TIGHT, LOOSE = np.diag([1e-4] * 3 + [1e-6] * 3), np.diag([1.0] * 3 + [0.01] * 3)


def fuse(
    prediction: np.ndarray,
    prediction_covariance: np.ndarray,
    measurement: np.ndarray,
    measurement_covariance: np.ndarray,
) -> PoseEstimationOutputs:
    node = Registry.default().make_dfn("pose_estimation")
    node.configure()
    return node.process(
        PoseEstimationInputs(
            prediction=prediction,
            prediction_covariance=prediction_covariance,
            measurement=measurement,
            measurement_covariance=measurement_covariance,
        )
    )


def test_a_precise_measurement_replaces_an_imprecise_prediction() -> None:
    T = se3.exp_se3([0.5, -0.3, 0.2, 0.02, 0.05, -0.04])
    outputs = fuse(np.eye(4), LOOSE, T, TIGHT)
    np.testing.assert_allclose(outputs.pose, T, atol=1e-9)
    np.testing.assert_allclose(outputs.covariance, TIGHT, rtol=1e-6, atol=1e-11)
    assert outputs.measured_directions == 6


def test_the_prediction_is_kept_in_degenerate_directions() -> None:
    unconstrained_x = TIGHT.copy()
    unconstrained_x[0, 0] = 100.0
    outputs = fuse(np.eye(4), LOOSE, se3.exp_se3([0.5, 0.5, 0, 0, 0, 0]), unconstrained_x)
    np.testing.assert_allclose(outputs.pose[:3, 3], [0.0, 0.5, 0.0], atol=1e-6)
    assert outputs.covariance[0, 0] == pytest.approx(1.0)
    assert outputs.measured_directions == 5


def test_repeating_a_measurement_adds_no_information() -> None:
    outputs = fuse(np.eye(4), TIGHT, np.eye(4), TIGHT)
    np.testing.assert_allclose(outputs.covariance, TIGHT, rtol=1e-6, atol=1e-11)


def test_degenerate_directions_need_not_be_axes() -> None:
    R = se3.exp_so3([0.3, 0.5, 0.7])
    rotation = np.eye(6)
    rotation[:3, :3] = R
    unconstrained_direction = rotation @ np.diag([1e2, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6]) @ rotation.T
    outputs = fuse(np.eye(4), LOOSE, se3.transform(np.eye(3), R @ [0.5, 0.4, 0.3]), unconstrained_direction)
    np.testing.assert_allclose(R.T @ outputs.pose[:3, 3], [0.0, 0.4, 0.3], atol=1e-3)


def test_a_measurement_that_contradicts_the_prediction_is_refused() -> None:
    with pytest.raises(RefusedError) as refusal:
        fuse(np.eye(4), TIGHT, se3.exp_se3([0.2, 0, 0, 0, 0, 0]), TIGHT)
    assert refusal.value.reasons[0].startswith("innovation:")


def test_an_invalid_covariance_is_refused() -> None:
    with pytest.raises(InputError, match="covariance"):
        fuse(np.eye(4), -TIGHT, np.eye(4), TIGHT)
