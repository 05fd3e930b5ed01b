# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mounts and scales from synthetic drives with known mounts: errors within the stated covariances."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.rotation_forms import matrix_from_rpy_deg
from cdff_core.calibration import Mount, hand_eye, inertial_mount, motion_pairs, wheel_scales

Floats = NDArray[np.float64]
CAMERA = se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5])
MOUNT = se3.transform(se3.exp_so3([0.1, 0.3, -0.4]) @ CAMERA, [0.4, -0.1, 0.9])


def drive(tilt_rad_s: float = 0.0, turn_rad_s: float = 0.3, n: int = 600) -> tuple[NDArray[np.int64], Floats]:
    """Return stamps and poses of a drive of 0.3 m/s with curves, and tilts if the ground is not level."""
    poses = [np.eye(4)]
    for k in range(n):
        rates = [tilt_rad_s * np.sin(0.11 * k), tilt_rad_s * np.cos(0.07 * k), turn_rad_s * np.sin(0.05 * k)]
        poses.append(poses[-1] @ se3.transform(se3.exp_so3(np.array(rates) * 0.1), [0.03, 0.0, 0.0]))
    return np.arange(n + 1) * 100_000_000, np.array(poses)


def noisy(poses: Floats, seed: int, sigma_m: float = 0.003, sigma_rad: float = 0.001) -> Floats:
    rng = np.random.default_rng(seed)
    noise = [
        se3.transform(se3.exp_so3(rng.normal(0, sigma_rad, 3)), rng.normal(0, sigma_m, 3)) for _ in poses
    ]
    return poses @ np.array(noise)


def error(mount: Mount, truth: Floats) -> Floats:
    T = mount.transform.matrix
    return np.concatenate([T[:3, 3] - truth[:3, 3], se3.log_so3(T[:3, :3] @ truth[:3, :3].T)])


@pytest.mark.parametrize("seed", range(5))
def test_a_drive_over_slopes_determines_the_whole_mount_within_its_covariance(seed: int) -> None:
    stamps, poses = drive(tilt_rad_s=0.2)
    mount = hand_eye(motion_pairs(stamps, poses, stamps, noisy(poses @ MOUNT, seed)))
    assert mount.undetermined == ()
    assert (np.abs(error(mount, MOUNT)) < 4.0 * mount.sigma).all()
    assert mount.sigma[:3].max() < 0.01
    mount.require()


def test_a_wrong_radius_of_the_wheels_is_no_lever_arm_in_a_drive_with_curves_to_one_side() -> None:
    stamps, poses = drive(turn_rad_s=0.3)
    turning = poses.copy()
    for k in range(1, len(poses)):  # another constant turn: the curves are longer to the left
        step = np.linalg.inv(poses[k - 1]) @ poses[k]
        turning[k] = turning[k - 1] @ step @ se3.transform(se3.exp_so3([0.0, 0.0, 0.01]), [0, 0, 0])
    wheels = turning.copy()
    wheels[:, :3, 3] *= 1.06
    mount = hand_eye(motion_pairs(stamps, wheels, stamps, noisy(turning @ MOUNT, 0)))
    known = [0, 1, 3, 4, 5]
    assert (np.abs(error(mount, MOUNT))[known] < 4.0 * mount.sigma[known]).all()
    assert mount.sigma[:2].max() < 0.01


def test_slip_that_lasts_longer_than_a_motion_enlarges_the_standard_deviations() -> None:
    poses = [np.eye(4)]
    for k in range(1000):  # curves of 25 s to both sides
        rate_rad_s = 0.1 if (k // 250) % 2 == 0 else -0.12
        poses.append(poses[-1] @ se3.transform(se3.exp_so3([0.0, 0.0, 0.1 * rate_rad_s]), [0.04, 0.0, 0.0]))
    stamps, relative = np.arange(1001) * 100_000_000, []
    for memory in (0.0, 0.98):
        rng = np.random.default_rng(0)
        slip, slipping = 0.0, [np.eye(4)]
        for last, pose in pairwise(poses):
            slip = memory * slip + rng.normal(0.0, 0.05 * np.sqrt(1.0 - memory**2))
            step = np.linalg.inv(last) @ pose
            step[0, 3] *= 1.0 + slip
            slipping.append(slipping[-1] @ step)
        measured = noisy(np.array(poses) @ MOUNT, 0)
        mount = hand_eye(motion_pairs(stamps, np.array(slipping), stamps, measured), guess=MOUNT)
        assert abs(error(mount, MOUNT)[1]) < 4.0 * mount.sigma[1]
        relative.append(mount.sigma[1] / mount.rms_m)
    assert relative[1] > 1.3 * relative[0]


def test_a_level_drive_determines_everything_but_the_height_and_says_so() -> None:
    stamps, poses = drive()
    mount = hand_eye(motion_pairs(stamps, poses, stamps, noisy(poses @ MOUNT, 0)))
    assert mount.undetermined == ("z",)
    known = [0, 1, 3, 4, 5]
    assert (np.abs(error(mount, MOUNT))[known] < 4.0 * mount.sigma[known]).all()
    with pytest.raises(
        DegenerateGeometryError, match="does not determine z of the mount: measure the height"
    ):
        mount.require()
    mount.require(("x", "y", "yaw"))


@pytest.mark.slow
def test_a_straight_drive_names_the_position_and_the_roll() -> None:
    stamps, poses = drive(turn_rad_s=0.0)
    mount = hand_eye(motion_pairs(stamps, poses, stamps, noisy(poses @ MOUNT, 0)))
    assert mount.undetermined == ("x", "y", "z", "roll")


def test_undetermined_directions_are_those_of_the_known_mount_with_its_uncertainty() -> None:
    stamps, poses = drive()
    mount = hand_eye(motion_pairs(stamps, poses, stamps, poses @ MOUNT))
    known = UncertainTransform.from_xyz_rpy_deg([9.0, 9.0, 0.85], [0, 0, 0], sigma_m=0.02)
    result = mount.completed(known)
    assert result.matrix[:3, 3] == pytest.approx([0.4, -0.1, 0.85], abs=1e-4)
    np.testing.assert_allclose(result.matrix[:3, :3], MOUNT[:3, :3], atol=1e-4)
    assert result.covariance is not None
    assert result.covariance[2, 2] == pytest.approx(0.02**2)
    assert result.covariance[2, [0, 1, 3, 4, 5]] == pytest.approx(0.0)


def test_jumps_of_the_trajectory_of_the_sensor_do_not_change_the_mount() -> None:
    stamps, poses = drive(tilt_rad_s=0.2)
    sensor = noisy(poses @ MOUNT, 1)
    for k in (150, 310, 450):
        sensor[k:] = se3.transform(se3.exp_so3([0.3, 0.0, 0.5]), [1.0, -2.0, 0.0]) @ sensor[k:]
    mount = hand_eye(motion_pairs(stamps, poses, stamps, sensor))
    assert (np.abs(error(mount, MOUNT)) < 5.0 * mount.sigma).all()


def test_few_motions_and_separate_times_are_refused() -> None:
    stamps, poses = drive(n=30)
    with pytest.raises(DegenerateGeometryError, match="expected at least 10; drive longer"):
        hand_eye(motion_pairs(stamps, poses, stamps, poses))
    with pytest.raises(InputError, match="no common interval"):
        motion_pairs(stamps, poses, stamps + 10**12, poses)


def test_a_robot_at_rest_has_no_motions() -> None:
    stamps, poses = np.arange(100) * 10**8, np.tile(np.eye(4), (100, 1, 1))
    assert len(motion_pairs(stamps, poses, stamps, poses)) == 0


def inertial_drive(
    rpy_deg: tuple[float, float, float],
    xyz_m: tuple[float, float, float],
    *,
    offset_s: float = 0.0,
    seed: int = 0,
) -> tuple[NDArray[np.int64], Floats, Floats, NDArray[np.int64], Floats]:
    """Return readings of an IMU at a mount, and planar wheel odometry, of 90 s on gently tilting ground."""
    rng, rate_hz = np.random.default_rng(seed), 500.0
    t = np.arange(0, 90, 1 / rate_hz)
    speed = 0.5 + 0.3 * np.sin(2 * np.pi * t / 9) * np.sin(2 * np.pi * t / 31)
    yaw = np.cumsum(0.25 * np.sin(2 * np.pi * t / 13) + 0.1 * np.sin(2 * np.pi * t / 5.3)) / rate_hz
    position = (
        np.cumsum(speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * t]), axis=0) / rate_hz
    )
    tilt = 0.03 * np.column_stack([np.sin(2 * np.pi * t / 17), np.cos(2 * np.pi * t / 11), 0 * t])
    heading = se3.exp_so3(np.column_stack([0 * t, 0 * t, yaw]))
    R = heading @ se3.exp_so3(tilt)
    of_unit = position + R @ np.array(xyz_m)
    acceleration = np.gradient(np.gradient(of_unit, 1 / rate_hz, axis=0), 1 / rate_hz, axis=0)
    R_unit = R @ matrix_from_rpy_deg(rpy_deg)
    force = np.einsum("nji,nj->ni", R_unit, acceleration + np.array([0, 0, 9.81]))
    rate = se3.log_so3(np.swapaxes(R_unit[:-1], 1, 2) @ R_unit[1:]) * rate_hz
    imu_rows, wheel_rows = slice(50, -50, 5), slice(50, -50, 50)
    force, rate = force[imu_rows], rate[imu_rows]
    return (
        ((t[imu_rows] - offset_s) * 1e9).astype(np.int64),
        force + rng.normal(0, 0.02, force.shape),
        rate + rng.normal(0, 0.002, rate.shape),
        (t[wheel_rows] * 1e9).astype(np.int64),
        se3.transform(heading[wheel_rows], position[wheel_rows]),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "rpy_deg", [(0.0, 0.0, 0.0), (180.0, 0.0, 90.0), (90.0, 0.0, -90.0), (10.0, -30.0, 135.0)]
)
def test_the_rotation_of_an_imu_is_found_from_gravity_curves_and_accelerations(
    rpy_deg: tuple[float, float, float],
) -> None:
    mount, offset_s = inertial_mount(*inertial_drive(rpy_deg, (-0.25, 0.12, 0.05)))
    truth = se3.transform(matrix_from_rpy_deg(rpy_deg), [-0.25, 0.12, 0.05])
    assert np.rad2deg(np.abs(error(mount, truth)[3:])).max() < 0.5
    assert (np.abs(error(mount, truth))[3:] < 3.0 * mount.sigma[3:]).all()
    assert offset_s == pytest.approx(0.0, abs=0.021)
    assert set(mount.undetermined) == {"x", "y", "z"}  # wheels slip: docs state why


@pytest.mark.slow
def test_the_clock_of_an_imu_that_is_late_is_found_and_does_not_spoil_the_rotation() -> None:
    mount, offset_s = inertial_mount(*inertial_drive((180.0, 0.0, 90.0), (0.0, 0.0, 0.0), offset_s=0.3))
    assert offset_s == pytest.approx(0.3, abs=0.021)
    assert (
        np.rad2deg(
            np.abs(error(mount, se3.transform(matrix_from_rpy_deg((180.0, 0, 90.0)), [0, 0, 0]))[3:])
        ).max()
        < 1
    )


def test_an_imu_at_rest_or_at_another_time_is_refused() -> None:
    imu_ns, force, rate, base_ns, base = inertial_drive((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    at_rest = np.tile(np.eye(4), (len(base), 1, 1))
    with pytest.raises(DegenerateGeometryError, match="0 windows of 4 s with motion"):
        inertial_mount(imu_ns, force, rate, base_ns, at_rest)
    with pytest.raises(InputError, match="no common interval"):
        inertial_mount(imu_ns + 10**12, force, rate, base_ns, base)


def test_wrong_radius_and_track_width_are_found_with_their_uncertainty() -> None:
    stamps, poses = drive()
    radius, track = 1.05, 1.2  # true over used
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    odometry = [np.eye(4)]
    for step in steps:
        yaw = float(se3.log_so3(step[:3, :3])[2]) * track / radius
        odometry.append(odometry[-1] @ se3.transform(se3.exp_so3([0, 0, yaw]), step[:3, 3] / radius))
    pairs = motion_pairs(stamps, np.array(odometry), stamps, noisy(poses @ MOUNT, 3))
    scales = wheel_scales(pairs, MOUNT)
    assert abs(scales.radius - radius) < 4 * scales.radius_sigma
    assert abs(scales.track - track) < 4 * scales.track_sigma
    assert scales.radius_sigma < 0.01
    assert scales.track_sigma < 0.02


def test_scales_of_a_straight_drive_are_refused_by_name() -> None:
    stamps, poses = drive(turn_rad_s=0.0)
    with pytest.raises(DegenerateGeometryError, match="0° of curves") as raised:
        wheel_scales(motion_pairs(stamps, poses, stamps, poses @ MOUNT), MOUNT)
    assert raised.value.directions == ("track",)
