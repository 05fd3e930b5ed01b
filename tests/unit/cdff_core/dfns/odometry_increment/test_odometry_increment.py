# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Odometry increments of the body, from poses of a mounted sensor, with their covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_core.dfns.odometry_increment.covariance_difference import CovarianceDifference
from cdff_core.dfns.odometry_increment.distance_model import DistanceModel
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementInputs, OdometryIncrementOutputs

MOUNT = se3.exp_se3([0.3, -0.1, 0.9, 0.4, -1.2, 1.1])
EXACT = {"floor_m": 0.0, "floor_rad": 0.0}
NO_ERROR = dict.fromkeys(
    ("along_m_sqrt_m", "across_m_sqrt_m", "up_m_sqrt_m", "tilt_rad_sqrt_m", "yaw_rad_sqrt_m", "yaw_fraction"),
    0.0,
)


def covariance(rng: np.random.Generator, scale: float = 0.01) -> np.ndarray:
    A = rng.standard_normal((6, 6)) * scale
    return A @ A.T


def run(node: Any, config: dict[str, float], *inputs: Any) -> OdometryIncrementOutputs:
    first, second, mount, first_covariance, second_covariance = inputs
    node.configure(config)
    return node.process(
        OdometryIncrementInputs(
            first=first,
            second=second,
            mount=mount,
            first_covariance=first_covariance,
            second_covariance=second_covariance,
        )
    )


@pytest.mark.parametrize(("node", "config"), [(CovarianceDifference(), EXACT), (DistanceModel(), NO_ERROR)])
def test_the_increment_is_independent_of_origin_and_mount(
    node: Any, config: dict[str, float], rng: np.random.Generator
) -> None:
    T_site_body1, motion = se3.exp_se3(rng.standard_normal(6)), se3.exp_se3(0.2 * rng.standard_normal(6))
    T_origin_site = se3.exp_se3(rng.standard_normal(6))
    first = T_origin_site @ T_site_body1 @ MOUNT
    second = T_origin_site @ T_site_body1 @ motion @ MOUNT
    outputs = run(node, config, first, second, MOUNT, None, None)
    np.testing.assert_allclose(outputs.increment, motion, atol=1e-12)
    assert outputs.distance_m == pytest.approx(np.linalg.norm(motion[:3, 3]))


def test_the_covariance_of_one_compounded_step_is_restored(rng: np.random.Generator) -> None:
    first = UncertainTransform(se3.exp_se3(rng.standard_normal(6)), covariance(rng))
    step = UncertainTransform(se3.exp_se3(0.3 * rng.standard_normal(6)), covariance(rng))
    second = first @ step
    outputs = run(
        CovarianceDifference(),
        EXACT,
        first.matrix,
        second.matrix,
        np.eye(4),
        first.covariance,
        second.covariance,
    )
    np.testing.assert_allclose(outputs.covariance, step.covariance, atol=1e-12)


def test_compounded_increments_have_the_covariance_of_the_odometry(
    rng: np.random.Generator,
) -> None:
    mount = UncertainTransform.exact(MOUNT)
    sensor = UncertainTransform.identity()
    body = UncertainTransform.identity()
    for _ in range(5):
        step = UncertainTransform(se3.exp_se3(0.2 * rng.standard_normal(6)), covariance(rng))
        next_sensor = sensor @ step
        outputs = run(
            CovarianceDifference(),
            EXACT,
            sensor.matrix,
            next_sensor.matrix,
            MOUNT,
            sensor.covariance,
            next_sensor.covariance,
        )
        body, sensor = body @ UncertainTransform(outputs.increment, outputs.covariance), next_sensor
    expected = mount @ sensor @ mount.inverse()
    np.testing.assert_allclose(body.matrix, expected.matrix, atol=1e-9)
    np.testing.assert_allclose(body.covariance, expected.covariance, atol=1e-9)


def test_an_odometry_with_constant_covariance_gives_increments_with_the_minimum_covariance(
    rng: np.random.Generator,
) -> None:
    constant = 1e-4 * np.eye(6)
    outputs = run(
        CovarianceDifference(),
        {"floor_m": 0.01, "floor_rad": 0.002},
        np.eye(4),
        np.eye(4),
        MOUNT,
        constant,
        constant,
    )
    np.testing.assert_allclose(np.diag(outputs.covariance), [1e-4] * 3 + [4e-6] * 3)


def test_the_standard_deviations_of_the_distance_model_grow_with_the_square_root_of_the_distance() -> None:
    def sigma(distance_m: float) -> np.ndarray:
        second = se3.transform(np.eye(3), [distance_m, 0, 0])
        return np.sqrt(np.diag(run(DistanceModel(), {}, np.eye(4), second, np.eye(4), None, None).covariance))

    np.testing.assert_allclose(sigma(4.0), 2.0 * sigma(1.0))
    assert not sigma(0.0).any()


def test_a_non_rigid_input_is_refused() -> None:
    with pytest.raises(InputError, match="rigid"):
        run(DistanceModel(), {}, np.eye(4), 2 * np.eye(4), np.eye(4), None, None)


def test_an_unknown_parameter_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="slip"):
        DistanceModel().configure({"slip": 0.1})


def test_a_constant_covariance_is_that_of_the_noise_of_both_poses(rng: np.random.Generator) -> None:
    first, stated = se3.exp_se3(rng.standard_normal(6)), np.diag([1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03])
    second = first @ se3.exp_se3([0.1, 0.0, 0.0, 0.0, 0.0, 0.02])
    constant = run(DistanceModel(), {}, first, second, np.eye(4), stated, stated)
    growing = run(DistanceModel(), {}, first, second, np.eye(4), stated, 1.1 * stated)
    assert np.trace(constant.pose_covariance) == pytest.approx(0.5 * np.trace(stated), rel=1e-3)
    assert np.trace(growing.pose_covariance) < 1e-5
