# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of servicer and client, Sun and Earth."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.clock import parse_stamp
from cdff_common.errors import ConfigurationError
from cdff_common.geometry import se3
from cdff_common.stars import sun_position_m
from cdff_dev.simulate.orbit.environment import earth_light, sun_positions_m
from cdff_dev.simulate.orbit.motion import OrbitMotion
from cdff_dev.simulate.orbit.navigation import gnss_states, imu_track, star_tracker_attitudes
from cdff_dev.simulate.orbit.sensors import Gnss, StarTracker
from cdff_dev.simulate.scenario import Imu
from tests.unit.cdff_dev.simulate.orbit.conftest import small_scenario

IMU = {
    "mount": {"xyz_m": [0.1, 0.0, 0.0]},
    "rate_hz": 10.0,
    "gyro_noise_rad_s_sqrt_hz": 0.0,
    "gyro_bias_sigma_rad_s": 0.0,
    "gyro_walk_rad_s2_sqrt_hz": 0.0,
    "acc_noise_m_s2_sqrt_hz": 0.0,
    "acc_bias_sigma_m_s2": 0.0,
    "acc_walk_m_s3_sqrt_hz": 0.0,
}


def test_the_sun_of_the_ephemeris_agrees_with_the_almanac_within_its_accuracy() -> None:
    stamps = [
        parse_stamp(f"20{year}-0{month}-11T05:00:00Z", "t") for year, month in ((26, 8), (31, 2), (40, 5))
    ]
    for stamp_ns in stamps:
        exact, approximate = sun_positions_m([stamp_ns])[0], sun_position_m(stamp_ns)
        angle = (
            np.linalg.norm(np.cross(exact, approximate)) / np.linalg.norm(exact) / np.linalg.norm(approximate)
        )
        assert np.degrees(angle) < 0.012
        np.testing.assert_allclose(np.linalg.norm(approximate), np.linalg.norm(exact), rtol=2e-4)


def test_the_path_is_continuous_and_its_segments_end_where_they_state() -> None:
    path = [
        {"kind": "hold", "duration_s": 20.0, "deadband_m": 0.3, "period_s": 40.0},
        {"kind": "line", "to_m": [-40.0, 5.0, 2.0], "duration_s": 60.0},
        {"kind": "circle", "axis": [0.0, 1.0, 0.0], "period_s": 400.0, "duration_s": 100.0},
        {"kind": "transfer", "to_m": [-90.0, 0.0, 4.0], "duration_s": 900.0},
        {"kind": "drift", "velocity_m_s": [0.01, 0.0, 0.0], "duration_s": 50.0},
    ]
    motion = OrbitMotion(small_scenario(servicer__path=path, servicer__start_m=[-60.0, 0.0, 0.0]))
    t_s = np.arange(0.0, 1130.0, 0.25)
    positions = np.einsum("nji,nj->ni", motion.path_axes(t_s), motion.servicer_offsets_m(t_s))
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() < 0.5
    np.testing.assert_allclose(positions[t_s == 80.0][0], [-40.0, 5.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(positions[t_s == 1080.0][0], [-90.0, 0.0, 4.0], atol=1e-5)
    on_circle = (t_s >= 80.0) & (t_s <= 180.0)
    radii = np.linalg.norm(positions[on_circle], axis=1)
    np.testing.assert_allclose(radii, np.linalg.norm([-40.0, 5.0, 2.0]), rtol=1e-7)


def test_without_thrust_there_is_no_specific_force_and_a_held_position_needs_thrust() -> None:
    drift = [{"kind": "drift", "velocity_m_s": [0.02, 0.01, 0.0], "duration_s": 300.0}]
    t_s = np.array([50.0, 100.0, 250.0])
    free_motion = OrbitMotion(small_scenario(servicer__path=drift, servicer__start_m=[-200.0, 30.0, 50.0]))
    assert np.abs(free_motion.specific_forces(t_s)).max() < 5e-6
    station_keeping = OrbitMotion(small_scenario(servicer__start_m=[0.0, 0.0, -1000.0]))
    rate = station_keeping.reference.mean_motion_rad_s
    # A body kept above its reference is accelerated by 3 n² z towards it (Clohessy-Wiltshire).
    np.testing.assert_allclose(
        np.linalg.norm(station_keeping.specific_forces(t_s), axis=1), 3e3 * rate**2, rtol=1e-3
    )


def test_the_servicer_points_to_the_client_within_its_pointing_error() -> None:
    pointing = {"error_deg": 0.5, "period_s": 30.0}
    t_s = np.linspace(0.0, 20.0, 200)
    exact = OrbitMotion(small_scenario()).poses_in_base("client", t_s)
    np.testing.assert_allclose(exact[:, 1:3, 3], 0.0, atol=1e-9)
    np.testing.assert_allclose(exact[:, 0, 3], 15.0, atol=1e-9)
    wrong = OrbitMotion(small_scenario(servicer__pointing=pointing)).poses_in_base("client", t_s)
    off_deg = np.degrees(np.hypot(wrong[:, 1, 3], wrong[:, 2, 3]) / 15.0)
    assert 0.1 < off_deg.max() < 3.0
    steps = np.linalg.norm(np.diff(wrong[:, :3, 3], axis=0), axis=1)
    assert steps.max() < 0.1  # the error varies smoothly


def test_a_servicer_on_the_orbit_normal_points_to_the_client_and_a_path_over_both_axes_is_refused() -> None:
    above = OrbitMotion(small_scenario(servicer__start_m=[0.0, -20.0, 0.0]))
    np.testing.assert_allclose(
        above.poses_in_base("client", np.zeros(1))[0, :3, 3], [20.0, 0.0, 0.0], atol=1e-9
    )
    around = [{"kind": "circle", "axis": [0.0, 0.0, 1.0], "period_s": 40.0, "duration_s": 40.0}]
    with pytest.raises(ConfigurationError, match=r"servicer\.path.*both"):
        OrbitMotion(small_scenario(servicer__path=around))


def test_rates_are_the_derivatives_of_the_attitudes() -> None:
    motion = OrbitMotion(small_scenario(servicer__pointing={"error_deg": 0.5, "period_s": 30.0}))
    t_s = np.array([3.0, 11.0])
    turned = motion.base_attitudes(t_s) @ se3.exp_so3(0.02 * motion.base_rates(t_s + 0.01))
    np.testing.assert_allclose(turned, motion.base_attitudes(t_s + 0.02), atol=2e-6)


def test_a_given_phase_angle_holds_at_its_time() -> None:
    motion = OrbitMotion(small_scenario(lighting__sun={"phase_deg": 75.0, "clock_deg": 10.0, "at_s": 12.0}))
    to_servicer = motion.servicer_offsets_m(np.array([12.0]))[0]
    angle = np.arccos(motion.light(12.0).to_sun @ to_servicer / np.linalg.norm(to_servicer))
    assert np.degrees(angle) == pytest.approx(75.0, abs=0.01)


def test_the_light_of_the_earth_is_strongest_below_and_absent_over_the_night_side() -> None:
    position, sun = np.array([6.8e6, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    down, up = earth_light(np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), position, sun, 0.3)
    assert 0.2 < down < 0.3
    assert up < 0.2 * down
    assert earth_light(np.array([[-1.0, 0.0, 0.0]]), position, -sun, 0.3)[0] < 0.005
    far = earth_light(np.array([[-1.0, 0.0, 0.0]]), 60.0 * position, sun, 0.3)[0]
    # A distant full sphere has 2/3 of the light of a flat white surface of its cross-section.
    assert far == pytest.approx(0.3 * 2.0 / 3.0 * (6.378e6 / 4.08e8) ** 2, rel=0.03)


def test_navigation_sensors_without_errors_measure_the_truth() -> None:
    motion = OrbitMotion(small_scenario(servicer__pointing={"error_deg": 1.0, "period_s": 20.0}))
    t_s, rng = np.arange(0.0, 5.0, 0.1), np.random.default_rng(1)
    imu = imu_track(Imu.model_validate(IMU), motion, t_s, rng)
    np.testing.assert_allclose(imu.gyro_rad_s, motion.base_rates(t_s), atol=1e-12)
    force = np.einsum("nji,nj->ni", motion.base_attitudes(t_s), motion.specific_forces(t_s))
    assert np.abs(imu.acc_m_s2 - force).max() < 1e-3  # the lever arm of 0.1 m
    exact = Gnss(position_sigma_m=0.0, velocity_sigma_m_s=0.0, slow_sigma_m=0.0)
    positions, velocities = gnss_states(exact, motion, t_s, rng)
    np.testing.assert_allclose(positions[1:] - positions[:-1], 0.1 * velocities[:-1], atol=0.05)
    np.testing.assert_allclose(positions, motion.servicer_states(t_s)[0], atol=1e-6)


def test_star_tracker_errors_have_the_stated_size_and_the_sun_blinds_it() -> None:
    motion = OrbitMotion(small_scenario())
    model = StarTracker(bias_sigma_arcsec=0.0, sun_exclusion_deg=0.0, earth_exclusion_deg=0.0)
    t_s = np.linspace(0.0, 20.0, 2000)
    track = star_tracker_attitudes(model, motion, t_s, np.zeros(3), np.random.default_rng(2))
    assert len(track.index) == 2000
    R_tracker = motion.base_attitudes(t_s) @ model.mount.matrix()[:3, :3]
    errors = se3.log_so3(np.swapaxes(R_tracker, 1, 2) @ track.R_inertial_base @ model.mount.matrix()[:3, :3])
    sigma_arcsec = np.degrees(errors.std(axis=0)) * 3600.0
    np.testing.assert_allclose(sigma_arcsec, [30.0, 5.0, 5.0], rtol=0.08)
    in_inertial = se3.log_so3(track.R_inertial_base @ np.swapaxes(motion.base_attitudes(t_s), 1, 2))
    squared = np.einsum("ni,nij,nj->n", in_inertial, np.linalg.inv(track.covariances), in_inertial)
    assert squared.mean() == pytest.approx(3.0, rel=0.1)
    blinded = StarTracker(sun_exclusion_deg=179.0, earth_exclusion_deg=0.0)
    rng = np.random.default_rng(2)
    assert not len(star_tracker_attitudes(blinded, motion, t_s[:20], np.zeros(3), rng).index)
