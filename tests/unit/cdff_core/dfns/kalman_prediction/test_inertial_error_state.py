# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""InertialErrorState: exact on smooth motions, and errors that go where its transition says."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.kalman_prediction._interface import KalmanPredictionInputs, KalmanPredictionOutputs

MS = 1_000_000
G = 3.71
RATE = np.array([0.2, -0.1, 0.4])
LEVER = np.array([0.3, -0.1, 0.2])


def truth(t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pose, velocity and acceleration of a body that turns steadily while it is accelerated along a curve."""
    R = se3.exp_so3([0.1, 0.2, 0.3]) @ se3.exp_so3(RATE * t_s)
    p = np.array([0.3 * t_s + 0.2 * t_s**2, np.sin(t_s), 0.1 * t_s**3])
    v = np.array([0.3 + 0.4 * t_s, np.cos(t_s), 0.3 * t_s**2])
    a = np.array([0.4, -np.sin(t_s), 0.6 * t_s])
    return se3.transform(R, p), v, a


def readings(lever: np.ndarray, bias: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    stamps = np.arange(0, 401, 10, dtype=np.int64) * MS
    forces = []
    for t in stamps * 1e-9:
        T, _, a = truth(t)
        swing = np.cross(RATE, np.cross(RATE, lever))
        forces.append(T[:3, :3].T @ (a + np.array([0, 0, G])) + swing)
    extra = np.zeros(6) if bias is None else bias
    return stamps, np.array(forces) + extra[3:], np.tile(RATE, (len(stamps), 1)) + extra[:3]


def predicted(
    T: np.ndarray, v: np.ndarray, biases: np.ndarray, end_ms: int = 200, lever: np.ndarray = LEVER
) -> KalmanPredictionOutputs:
    stamps, forces, rates = readings(lever)
    return node().process(
        KalmanPredictionInputs(
            T, v, biases, 1e-6 * np.eye(21), np.array([0, end_ms * MS]), stamps, forces, rates, np.asarray(G), lever
        )
    )


def node(**config: float):  # type: ignore[no-untyped-def]
    made = Registry.default().make_dfn("kalman_prediction")
    made.configure(config)
    return made


def test_a_curve_is_followed_through_the_lever_of_the_sensor() -> None:
    T0, v0, _ = truth(0.0)
    out = predicted(T0, v0, np.zeros(6))
    T1, v1, _ = truth(0.2)
    np.testing.assert_allclose(out.pose, T1, atol=1e-5)
    np.testing.assert_allclose(out.velocity, v1, atol=2e-5)
    assert bool(out.inertial)


def test_an_interval_may_begin_and_end_between_readings() -> None:
    (T0, v0, _), (T1, v1, _) = truth(0.011), truth(0.189)
    stamps, forces, rates = readings(LEVER)
    interval = np.array([11 * MS, 189 * MS])
    inputs = KalmanPredictionInputs(
        T0, v0, np.zeros(6), np.eye(15), interval, stamps, forces, rates, np.asarray(G), LEVER
    )
    out = node().process(inputs)
    np.testing.assert_allclose(out.pose, T1, atol=1e-5)
    np.testing.assert_allclose(out.velocity, v1, atol=2e-5)


def test_an_axis_that_turns_itself_is_followed() -> None:
    def rate(t_s: np.ndarray) -> np.ndarray:
        return np.column_stack([np.cos(20.0 * t_s), np.sin(20.0 * t_s), np.zeros_like(t_s)])

    middles = np.arange(2000) * 1e-4 + 0.5e-4
    R = functools.reduce(np.matmul, se3.exp_so3(1e-4 * rate(middles)))
    stamps = np.arange(0, 201, 10, dtype=np.int64) * MS
    inputs = KalmanPredictionInputs(
        np.eye(4), np.zeros(3), np.zeros(6), np.eye(15), np.array([0, 200 * MS]), stamps,
        rates_rad_s=rate(stamps * 1e-9),
    )  # fmt: skip
    off_rad = se3.rotation_angle(node().process(inputs).pose[:3, :3].T @ R)
    assert off_rad < 5e-4, "without the coning of the axis it is 5e-3"


@pytest.mark.parametrize("index", range(15))
def test_an_error_at_the_begin_becomes_what_the_transition_says(index: int) -> None:
    T0, v0, _ = truth(0.0)
    error = np.zeros(15)
    error[index] = 1e-3
    shifted = se3.transform(se3.exp_so3(error[3:6]) @ T0[:3, :3], T0[:3, 3] + error[:3])
    # No lever: what the sensor's swing adds is left out of the transition.
    at, moved = (
        predicted(T, v, b, lever=np.zeros(3))
        for T, v, b in ((T0, v0, np.zeros(6)), (shifted, v0 + error[6:9], error[9:15]))
    )
    after = np.concatenate([pose_error(moved.pose, at.pose), moved.velocity - at.velocity])
    np.testing.assert_allclose(after, (at.transition @ error)[:9], atol=4e-6)


def test_errors_beyond_the_first_fifteen_stay_and_all_covariances_are_positive() -> None:
    T0, v0, _ = truth(0.0)
    out = predicted(T0, v0, np.zeros(6))
    np.testing.assert_array_equal(out.covariance[15:, 15:], 1e-6 * np.eye(6))
    assert np.linalg.eigvalsh(out.covariance)[0] > 0.0
    assert np.all(np.diagonal(out.covariance)[:9] > 1e-6)


def test_without_readings_the_velocity_holds_and_is_soon_unknown() -> None:
    T0, v0, _ = truth(0.0)
    inputs = KalmanPredictionInputs(T0, v0, np.zeros(6), 1e-6 * np.eye(15), np.array([0, 500 * MS]))
    out = node(unseen_acceleration_m_s2_sqrt_hz=0.4).process(inputs)
    np.testing.assert_allclose(out.pose[:3, 3], T0[:3, 3] + 0.5 * v0)
    assert not bool(out.inertial)
    assert out.covariance[6, 6] == pytest.approx(1e-6 + 0.16 * 0.5)


def test_a_gap_in_the_readings_is_not_bridged() -> None:
    T0, v0, _ = truth(0.0)
    stamps, forces, rates = readings(LEVER)
    keep = (stamps < 50 * MS) | (stamps > 350 * MS)
    inputs = KalmanPredictionInputs(
        T0, v0, np.zeros(6), np.eye(15), np.array([0, 400 * MS]), stamps[keep], forces[keep], rates[keep], np.asarray(G)
    )
    assert not bool(node(max_gap_s=0.15).process(inputs).inertial)


def test_an_end_before_the_begin_is_refused() -> None:
    with pytest.raises(InputError, match="begin <= end"):
        node().process(KalmanPredictionInputs(np.eye(4), np.zeros(3), np.zeros(6), np.eye(15), np.array([5, 4])))
