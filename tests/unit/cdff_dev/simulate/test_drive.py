# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated motion, IMU and wheel odometry of a rover."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_dev.simulate.proprioception import imu_readings, wheel_odometry
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.rover_motion import Motion, make_motion, settle
from cdff_dev.simulate.scenario import RoverPath, Scenario, load_scenario

FULL = load_scenario("rover_traverse")


def plane(slope_x: float, slope_y: float) -> Relief:
    axis = np.linspace(-30.0, 30.0, 241)
    x, y = np.meshgrid(axis, axis)
    return Relief(axis, axis.copy(), slope_x * x + slope_y * y)


def straight(**changes: object) -> RoverPath:
    base = {
        "start_xy_m": (-5.0, 0.0),
        "heading_deg": 0.0,
        "curvature_1pm": ((0.0, 0.0), (20.0, 0.0)),
        "speed_m_s": 0.4,
        "rest_before_s": 1.0,
        "rest_after_s": 1.0,
        "ramp_s": 1.0,
    }
    return RoverPath.model_validate(base | changes)


def test_a_rover_on_a_plane_has_its_slope_and_height() -> None:
    T = settle(plane(0.1, -0.2), FULL.chassis, np.array([[1.0, 2.0]]), np.array([0.5]))[0]
    normal = np.array([-0.1, 0.2, 1.0]) / math.sqrt(1.05)
    np.testing.assert_allclose(T[:3, 2], normal, atol=1e-9)
    assert (T[:3, 3] @ normal) == pytest.approx(FULL.chassis.base_height_m)
    assert math.atan2(T[1, 0], T[0, 0]) == pytest.approx(0.5)


def test_the_rover_rests_drives_and_rests() -> None:
    motion = make_motion(straight(), FULL.chassis, plane(0, 0), 10.0)
    speed = np.linalg.norm(motion.position(np.array([0.2, 0.5, 5.0, 9.8]), 1), axis=1)
    np.testing.assert_allclose(speed, [0, 0, 0.4, 0], atol=1e-6)
    assert float(motion.distance(10.0)) == pytest.approx(0.4 * 7.0, abs=1e-3)


def test_curvature_bends_the_path() -> None:
    motion = make_motion(straight(curvature_1pm=((0.0, 0.2), (20.0, 0.2))), FULL.chassis, plane(0, 0), 10.0)
    T = motion.poses(np.array([0.0, 10.0]))
    rotation_rad = se3.log_so3(T[0, :3, :3].T @ T[1, :3, :3])[2]
    assert rotation_rad == pytest.approx(0.2 * float(motion.distance(10.0)), abs=2e-3)


@pytest.fixture(scope="module")
def rough() -> Motion:
    axis = np.linspace(-30.0, 30.0, 1201)
    x, y = np.meshgrid(axis, axis)
    relief = Relief(axis, axis.copy(), 0.08 * np.sin(1.3 * x) * np.cos(0.9 * y))
    return make_motion(straight(curvature_1pm=((0.0, 0.15), (20.0, -0.1))), FULL.chassis, relief, 12.0)


def without_imu_noise(**changes: object) -> Scenario:
    data = FULL.model_dump()
    for key in data["imu"]:
        if key not in ("mount", "rate_hz"):
            data["imu"][key] = 0.0
    data["imu"]["mount"]["rpy_deg"] = (10.0, 20.0, 90.0)
    return Scenario.model_validate(data | changes)


def test_imu_readings_without_errors_integrate_to_the_truth(rough: Motion, rng: np.random.Generator) -> None:
    model = without_imu_noise().imu
    t_s = np.arange(0, 1201) / 100.0
    readings = imu_readings(model, rough, t_s, 3.71, rng)
    T_base_imu = model.mount.matrix()
    T = rough.poses(t_s) @ T_base_imu
    R, p, v = T[0, :3, :3], T[0, :3, 3].copy(), np.zeros(3)
    for k in range(len(t_s) - 1):
        rotation = se3.exp_so3(0.01 * 0.5 * (readings.gyro_rad_s[k] + readings.gyro_rad_s[k + 1]))
        R_middle = R @ se3.exp_so3(0.005 * readings.gyro_rad_s[k])
        a = R_middle @ (0.5 * (readings.acc_m_s2[k] + readings.acc_m_s2[k + 1])) - [0, 0, 3.71]
        p = p + 0.01 * v + 0.5e-4 * a
        v = v + 0.01 * a
        R = R @ rotation
    assert se3.rotation_angle(R.T @ T[-1, :3, :3]) < 1e-3
    assert np.linalg.norm(p - T[-1, :3, 3]) < 0.05


def test_an_imu_at_rest_measures_gravity_and_noise_of_the_stated_density(rng: np.random.Generator) -> None:
    model = FULL.imu.model_copy(update={"acc_bias_sigma_m_s2": 0.0, "gyro_bias_sigma_rad_s": 0.0})
    motion = make_motion(straight(rest_before_s=50.0), FULL.chassis, plane(0, 0), 52.0)
    readings = imu_readings(model, motion, np.arange(0, 4000) / 100.0, 3.71, rng)
    assert readings.acc_m_s2.mean(axis=0)[2] == pytest.approx(3.71, abs=0.01)
    assert readings.gyro_rad_s.std() == pytest.approx(model.gyro_noise_rad_s_sqrt_hz * 10.0, rel=0.1)


def test_wheels_without_slip_measure_the_path_length_on_a_plane(rng: np.random.Generator) -> None:
    data = dict.fromkeys(("slip_mean", "slip_per_slope", "slip_sigma", "side_slip_per_slope"), 0.0)
    model = FULL.wheels.model_copy(update=data | {"yaw_gain_sigma": 0.0, "yaw_noise_rad_sqrt_m": 0.0})
    motion = make_motion(straight(curvature_1pm=((0.0, 0.2), (20.0, 0.1))), FULL.chassis, plane(0, 0), 20.0)
    t_s = np.arange(0, 201) / 10.0
    track = wheel_odometry(model, motion, t_s, rng)
    T = motion.poses(t_s)
    np.testing.assert_allclose(track.poses[-1], se3.inverse(T[0]) @ T[-1], atol=1e-9)
    np.testing.assert_array_equal(track.poses[0], np.eye(4))


def test_wheels_overestimate_uphill_motion_within_their_covariance() -> None:
    motion = make_motion(straight(), FULL.chassis, plane(0.15, 0.0), 30.0)
    t_s = np.arange(0, 301) / 10.0
    ratios, nees = [], []
    for seed in range(20):
        track = wheel_odometry(FULL.wheels, motion, t_s, np.random.default_rng(seed))
        path_length_m = float(motion.distance(30.0))
        ratios.append(track.poses[-1][0, 3] / path_length_m)
        T = motion.poses(t_s)
        error = pose_error(se3.inverse(T[0]) @ T[-1], track.poses[-1])[[0, 1, 5]]
        nees.append(error @ np.linalg.solve(track.covariances[-1][np.ix_([0, 1, 5], [0, 1, 5])], error))
    assert np.mean(ratios) == pytest.approx(1 / (1 - 0.04 - 0.55 * 0.148), abs=0.02)
    assert np.mean(nees) < 9.0


def test_wheel_covariance_grows_and_is_zero_where_the_frame_is_defined(
    rough: Motion, rng: np.random.Generator
) -> None:
    track = wheel_odometry(FULL.wheels, rough, np.arange(0, 121) / 10.0, rng)
    assert not track.covariances[0].any()
    assert np.all(np.diff(track.covariances[:, 0, 0] + track.covariances[:, 1, 1]) >= -1e-12)
    assert np.linalg.eigvalsh(track.covariances[-1])[0] > -1e-12
