# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inertial Kalman prediction: integration of motions, propagation of errors and covariance, gaps."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.kalman_prediction.interface import KalmanPredictionInputs, KalmanPredictionOutputs

MS = 1_000_000
G = 3.71
RATE = np.array([0.2, -0.1, 0.4])
LEVER = np.array([0.3, -0.1, 0.2])


def true_motion(t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pose, velocity and acceleration of a body with constant rotation rate on a curve."""
    R = se3.exp_so3([0.1, 0.2, 0.3]) @ se3.exp_so3(RATE * t_s)
    p = np.array([0.3 * t_s + 0.2 * t_s**2, np.sin(t_s), 0.1 * t_s**3])
    v = np.array([0.3 + 0.4 * t_s, np.cos(t_s), 0.3 * t_s**2])
    a = np.array([0.4, -np.sin(t_s), 0.6 * t_s])
    return se3.transform(R, p), v, a


def readings(lever: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, specific forces and angular rates of ``true_motion`` at 100 Hz, at the lever arm."""
    stamps = np.arange(0, 401, 10, dtype=np.int64) * MS
    forces = []
    for t in stamps * 1e-9:
        T, _, a = true_motion(t)
        centripetal = np.cross(RATE, np.cross(RATE, lever))
        forces.append(T[:3, :3].T @ (a + np.array([0, 0, G])) + centripetal)
    return stamps, np.array(forces), np.tile(RATE, (len(stamps), 1))


def predict(
    T: np.ndarray, v: np.ndarray, biases: np.ndarray, lever: np.ndarray = LEVER
) -> KalmanPredictionOutputs:
    stamps, forces, rates = readings(lever)
    return make_node().process(
        KalmanPredictionInputs(
            pose=T,
            velocity=v,
            biases=biases,
            covariance=1e-6 * np.eye(21),
            interval_ns=np.array([0, 200 * MS]),
            stamps_ns=stamps,
            specific_force=forces,
            rates_rad_s=rates,
            gravity=G,
            lever_m=lever,
        )
    )


def make_node(**config: float):  # type: ignore[no-untyped-def]
    dfn = Registry.default().make_dfn("kalman_prediction")
    dfn.configure(config)
    return dfn


def test_a_curved_motion_is_predicted_through_the_lever_arm_of_the_sensor() -> None:
    T0, v0, _ = true_motion(0.0)
    outputs = predict(T0, v0, np.zeros(6))
    T1, v1, _ = true_motion(0.2)
    np.testing.assert_allclose(outputs.pose, T1, atol=1e-5)
    np.testing.assert_allclose(outputs.velocity, v1, atol=2e-5)
    assert outputs.inertial


def test_an_interval_may_start_and_end_between_readings() -> None:
    (T0, v0, _), (T1, v1, _) = true_motion(0.011), true_motion(0.189)
    stamps, forces, rates = readings(LEVER)
    interval = np.array([11 * MS, 189 * MS])
    inputs = KalmanPredictionInputs(
        pose=T0,
        velocity=v0,
        biases=np.zeros(6),
        covariance=np.eye(15),
        interval_ns=interval,
        stamps_ns=stamps,
        specific_force=forces,
        rates_rad_s=rates,
        gravity=G,
        lever_m=LEVER,
    )
    outputs = make_node().process(inputs)
    np.testing.assert_allclose(outputs.pose, T1, atol=1e-5)
    np.testing.assert_allclose(outputs.velocity, v1, atol=2e-5)


def test_a_rotation_about_a_rotating_axis_is_integrated() -> None:
    def rate(t_s: np.ndarray) -> np.ndarray:
        return np.column_stack([np.cos(20.0 * t_s), np.sin(20.0 * t_s), np.zeros_like(t_s)])

    middles = np.arange(2000) * 1e-4 + 0.5e-4
    R = functools.reduce(np.matmul, se3.exp_so3(1e-4 * rate(middles)))
    stamps = np.arange(0, 201, 10, dtype=np.int64) * MS
    inputs = KalmanPredictionInputs(
        pose=np.eye(4),
        velocity=np.zeros(3),
        biases=np.zeros(6),
        covariance=np.eye(15),
        interval_ns=np.array([0, 200 * MS]),
        stamps_ns=stamps,
        rates_rad_s=rate(stamps * 1e-9),
    )
    error_rad = se3.rotation_angle(make_node().process(inputs).pose[:3, :3].T @ R)
    assert error_rad < 5e-4, "an integration without coning has an error of 5e-3 rad"


@pytest.mark.parametrize("index", range(15))
def test_the_transition_matrix_propagates_an_initial_error(index: int) -> None:
    T0, v0, _ = true_motion(0.0)
    error = np.zeros(15)
    error[index] = 1e-3
    perturbed_pose = se3.transform(se3.exp_so3(error[3:6]) @ T0[:3, :3], T0[:3, 3] + error[:3])
    # Without a lever arm, because the transition matrix neglects the motion of the sensor about the body.
    nominal, perturbed = (
        predict(T, v, b, lever=np.zeros(3))
        for T, v, b in ((T0, v0, np.zeros(6)), (perturbed_pose, v0 + error[6:9], error[9:15]))
    )
    error_after = np.concatenate(
        [pose_error(perturbed.pose, nominal.pose), perturbed.velocity - nominal.velocity]
    )
    np.testing.assert_allclose(error_after, (nominal.transition @ error)[:9], atol=4e-6)


def test_further_states_are_unchanged_and_the_covariance_stays_positive_definite() -> None:
    T0, v0, _ = true_motion(0.0)
    outputs = predict(T0, v0, np.zeros(6))
    np.testing.assert_array_equal(outputs.covariance[15:, 15:], 1e-6 * np.eye(6))
    assert np.linalg.eigvalsh(outputs.covariance)[0] > 0.0
    assert np.all(np.diagonal(outputs.covariance)[:9] > 1e-6)


def test_without_readings_the_velocity_is_constant_and_its_variance_grows() -> None:
    T0, v0, _ = true_motion(0.0)
    inputs = KalmanPredictionInputs(
        pose=T0,
        velocity=v0,
        biases=np.zeros(6),
        covariance=1e-6 * np.eye(15),
        interval_ns=np.array([0, 500 * MS]),
    )
    outputs = make_node(unseen_acceleration_m_s2_sqrt_hz=0.4).process(inputs)
    np.testing.assert_allclose(outputs.pose[:3, 3], T0[:3, 3] + 0.5 * v0)
    assert not outputs.inertial
    assert outputs.covariance[6, 6] == pytest.approx(1e-6 + 0.16 * 0.5)


def test_readings_with_a_gap_are_not_used() -> None:
    T0, v0, _ = true_motion(0.0)
    stamps, forces, rates = readings(LEVER)
    is_kept = (stamps < 50 * MS) | (stamps > 350 * MS)
    inputs = KalmanPredictionInputs(
        pose=T0,
        velocity=v0,
        biases=np.zeros(6),
        covariance=np.eye(15),
        interval_ns=np.array([0, 400 * MS]),
        stamps_ns=stamps[is_kept],
        specific_force=forces[is_kept],
        rates_rad_s=rates[is_kept],
        gravity=G,
    )
    assert not make_node(max_gap_s=0.15).process(inputs).inertial


def test_an_end_before_the_start_is_refused() -> None:
    with pytest.raises(InputError, match="start <= end"):
        make_node().process(
            KalmanPredictionInputs(
                pose=np.eye(4),
                velocity=np.zeros(3),
                biases=np.zeros(6),
                covariance=np.eye(15),
                interval_ns=np.array([5, 4]),
            )
        )
