# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of visual odometry with correlated errors: covariances agree with Monte Carlo sampling."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_core.dfns.stereo_motion_estimation.interface import StereoMotionEstimationInputs
from cdff_core.dfns.stereo_motion_estimation.reprojection_lm import ReprojectionLm
from cdff_core.imaging.rectified_camera import RectifiedCamera
from cdff_core.stereo_odometry.consider_state import COMMON, ConsiderState
from tests.support.corridor import BASELINE_M, CAMERA

STEP = se3.transform(se3.exp_so3([0.0, 0.1, 0.02]), [0.1, 0.0, 0.5])
CALIBRATION = np.diag([0.04, 0.01])


def motion(rng: np.random.Generator, noise: float = 1e-6) -> ConsiderState:
    return ConsiderState(STEP, noise * np.eye(6), 1e-3 * rng.normal(size=(6, COMMON + 2)))


@pytest.mark.slow
def test_the_covariance_with_common_errors_agrees_with_a_monte_carlo_simulation(
    rng: np.random.Generator,
) -> None:
    steps = [motion(rng) for _ in range(8)]
    pose = ConsiderState.independent(UncertainTransform.identity(), 2)
    for step in steps:
        pose = pose @ step
    errors = []
    for _ in range(4000):
        shared = np.concatenate([rng.normal(size=COMMON), rng.multivariate_normal(np.zeros(2), CALIBRATION)])
        T = np.eye(4)
        for step in steps:
            error = step.response @ shared + 1e-3 * rng.normal(size=6)
            T = T @ se3.transform(se3.exp_so3(error[3:]) @ STEP[:3, :3], STEP[:3, 3] + error[:3])
        errors.append(cov.pose_error(T, pose.matrix))
    P = pose.to_transform(CALIBRATION).covariance
    np.testing.assert_allclose(np.cov(np.array(errors).T), P, atol=0.1 * float(np.abs(P).max()))
    # With independent errors the covariance would be much too small.
    assert np.trace(P) > 2.0 * np.trace(pose.noise)


def test_a_later_calibration_corrects_the_earlier_path(rng: np.random.Generator) -> None:
    step, change = motion(rng), np.array([0.2, -0.1])
    corrected = step.with_calibration_change(change)
    expected = step.response[:, COMMON:] @ change
    np.testing.assert_allclose(cov.pose_error(corrected.matrix, step.matrix), expected, atol=1e-9)


def test_the_mean_of_two_equal_estimates_has_half_the_noise(rng: np.random.Generator) -> None:
    first = motion(rng)
    difference = np.array([1e-3, 0.0, -2e-3, 0.0, 1e-3, 0.0])
    second = ConsiderState(
        se3.transform(se3.exp_so3(difference[3:]) @ STEP[:3, :3], STEP[:3, 3] + difference[:3]),
        first.noise,
        first.response,
    )
    mean = first.fused(second)
    np.testing.assert_allclose(mean.noise, 0.5 * first.noise, atol=1e-15)
    np.testing.assert_allclose(cov.pose_error(mean.matrix, first.matrix), 0.5 * difference, atol=1e-8)
    assert mean.response == pytest.approx(first.response)


def test_a_single_motion_has_the_covariance_of_the_motion_estimator(rng: np.random.Generator) -> None:
    z = rng.uniform(1.5, 12.0, 100)
    points = np.column_stack([rng.uniform(-0.5, 0.5, 100) * z, rng.uniform(-0.4, 0.4, 100) * z, z])
    camera = RectifiedCamera.from_matrix(CAMERA, BASELINE_M)
    observations = camera.project(points), camera.project(se3.transform_points(se3.inverse(STEP), points))
    basis, dfn = np.ones((100, 1)), ReprojectionLm()
    dfn.configure({})
    out = dfn.process(
        StereoMotionEstimationInputs(
            reference=observations[0],
            current=observations[1],
            camera_matrix=CAMERA,
            baseline=BASELINE_M,
            guess=STEP,
            reference_basis=basis,
            current_basis=basis,
            calibration=np.zeros(1),
            calibration_covariance=np.array([[0.25]]),
        )
    )
    P = ConsiderState.from_motion(out).to_transform(out.calibration_covariance)
    np.testing.assert_allclose(P.covariance, out.covariance, rtol=1e-9, atol=1e-15)
