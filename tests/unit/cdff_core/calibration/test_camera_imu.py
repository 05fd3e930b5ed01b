# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose, clock offset and biases of an IMU at a camera: within stated errors, outliers, and refusals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_core.calibration import camera_imu, camera_imu_start
from cdff_core.calibration.board_poses import BoardPose
from cdff_core.calibration.boards import Board
from cdff_core.calibration.camera_imu import PARAMETERS, CameraImu, camera_imu_calibration
from cdff_core.calibration.imu_integrals import Readings, integrals, noise_densities
from cdff_dev.simulate.board_motion import BoardMotion, noisy_readings, stamps_at

BOARD = Board("charuco", 9, 7, 0.03, 0.022)
T_CAMERA_IMU = se3.transform(se3.exp_so3([1.2, -0.7, 0.4]), [0.05, -0.08, 0.03])
GRAVITY = 9.80665 * np.array([0.05, 0.995, 0.0865]) / np.linalg.norm([0.05, 0.995, 0.0865])
BIASES = np.array([0.01, -0.02, 0.005, 0.1, -0.05, 0.08])
START_NS = 1_700_000_000 * 10**9
#: Standard deviations of a pose of the board, metres and radians: that of corners with an error of 0.1 px.
SIGMA = np.array([1.5e-4, 1.5e-4, 4e-4, *np.deg2rad([0.05, 0.05, 0.01])])
#: 99.9 % quantile of chi-square with 16 degrees of freedom.
CHI2_999 = 39.25


@dataclass
class Recording:
    """Data of a motion."""

    stamps_ns: np.ndarray
    boards: list[BoardPose]
    imu_ns: np.ndarray
    force: np.ndarray
    rate: np.ndarray

    def calibrated(self, **options: float) -> CameraImu:
        return camera_imu_calibration(
            self.stamps_ns, self.boards, self.imu_ns, self.force, self.rate, **options
        )


def recording(
    seed: int,
    *,
    offset_s: float = 0.0237,
    duration_s: float = 8.0,
    rotation_deg: tuple[float, float, float] = (20.0, 20.0, 25.0),
) -> Recording:
    """Return a motion in front of a board, and the readings of a low-cost IMU."""
    rng = np.random.default_rng(seed)
    motion = BoardMotion.random(BOARD, rng, distance_m=0.45, rotation_deg=rotation_deg)
    stamps_ns = stamps_at(15.0, duration_s, START_NS)
    boards = []
    for k, T in enumerate(motion.T_camera_board((stamps_ns - START_NS) * 1e-9)):
        error = rng.normal(0.0, SIGMA)
        measured = se3.transform(se3.exp_so3(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])
        boards.append(BoardPose(k, measured, np.diag(SIGMA**2), 0.1))
    imu_ns = stamps_at(200.0, duration_s + 0.4, START_NS - 200_000_000)
    exact = motion.readings((imu_ns - START_NS) * 1e-9 + offset_s, T_CAMERA_IMU, GRAVITY)
    force, rate = noisy_readings(*exact, rng, rate_hz=200.0, biases=BIASES)
    return Recording(stamps_ns, boards, imu_ns, force, rate)


@pytest.fixture(scope="module")
def data() -> Recording:
    return recording(1)


def error_of(result: CameraImu, offset_s: float = 0.0237) -> np.ndarray:
    """Return the errors of ``PARAMETERS``."""
    T = result.pose.transform.matrix
    rotation = se3.log_so3(T_CAMERA_IMU[:3, :3] @ T[:3, :3].T)
    others = np.concatenate([BIASES, GRAVITY, [offset_s]]) - result.values[6:]
    return np.concatenate([T_CAMERA_IMU[:3, 3] - T[:3, 3], rotation, others])


def chi2(result: CameraImu, offset_s: float = 0.0237) -> float:
    error = error_of(result, offset_s)
    return float(error @ np.linalg.inv(result.covariance) @ error)


def test_rotation_offset_biases_and_position_are_found_without_a_guess(data: Recording) -> None:
    result = data.calibrated()
    error = error_of(result)
    assert chi2(result) < CHI2_999
    assert np.linalg.norm(error[:3]) < 0.006
    assert np.rad2deg(np.linalg.norm(error[3:6])) < 0.15
    assert np.abs(error[6:9]).max() < 0.002
    assert abs(error[15]) < 5e-4
    assert result.pose.undetermined == ()
    assert result.pose.sentences == ("good: all directions are determined",)
    assert len(PARAMETERS) == 16
    assert result.pose.figures["time_offset_s"] == result.values[15]
    assert result.pose.figures["gyro_noise_rad_s_sqrt_hz"] == pytest.approx(1e-3, rel=0.2)
    assert result.pose.figures["accelerometer_noise_m_s2_sqrt_hz"] == pytest.approx(1e-2, rel=0.2)


def test_the_stated_covariance_is_that_of_the_errors() -> None:
    results = [recording(seed).calibrated() for seed in range(10, 16)]
    per_parameter = [chi2(result) / len(PARAMETERS) for result in results]
    assert 0.5 < np.mean(per_parameter) < 1.4
    for result in results:
        assert result.pose.figures["variance_ratio"] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("offset_s", [-0.13, 0.61])
def test_large_offsets_of_the_clocks_are_found_with_either_sign(offset_s: float) -> None:
    result = recording(2, offset_s=offset_s).calibrated()
    assert chi2(result, offset_s) < CHI2_999
    assert result.values[15] == pytest.approx(offset_s, abs=5e-4)


def test_wrong_poses_of_the_board_and_gaps_of_the_readings_are_left_out(data: Recording) -> None:
    boards = list(data.boards)
    for k in (20, 21, 55, 90):
        T = boards[k].T_camera_board.copy()
        T[:3, :3] = se3.exp_so3([0.0, 0.6, 0.0]) @ T[:3, :3]
        boards[k] = replace(boards[k], T_camera_board=T)
    shifted = boards[40].T_camera_board.copy()
    shifted[:3, 3] += [0.05, 0.0, 0.0]
    boards[40] = replace(boards[40], T_camera_board=shifted)
    t_s = (data.imu_ns - START_NS) * 1e-9
    is_there = (t_s < 5.0) | (t_s > 5.4)
    gapped = Recording(
        data.stamps_ns, boards, data.imu_ns[is_there], data.force[is_there], data.rate[is_there]
    )
    result = gapped.calibrated()
    assert chi2(result) < CHI2_999
    assert result.pose.dropped == 5
    assert "5 images contradict" in " ".join(result.pose.sentences)


def test_a_rotation_about_one_axis_does_not_determine_the_position_along_it() -> None:
    result = recording(3, rotation_deg=(0.0, 0.0, 40.0)).calibrated()
    error = error_of(result)
    sigma = np.sqrt(np.diag(result.covariance))
    assert "z" in result.pose.undetermined
    assert "a second axis" in result.pose.sentences[0]
    assert (np.abs(error) < 4.5 * sigma).all()


def test_data_that_determine_nothing_are_refused_with_the_remedy(data: Recording) -> None:
    still = recording(4, rotation_deg=(0.5, 0.5, 0.5))
    with pytest.raises(DegenerateGeometryError, match="rotate camera and IMU together about all axes"):
        still.calibrated()
    with pytest.raises(DegenerateGeometryError, match="record images at 10 Hz or more"):
        replace(data, boards=data.boards[:12]).calibrated()
    with pytest.raises(DegenerateGeometryError, match="correlate by 0"):
        replace(data, rate=recording(5).rate).calibrated()
    with pytest.raises(InputError, match="stamps of one clock"):
        replace(data, imu_ns=data.imu_ns + 10**12).calibrated()
    with pytest.raises(InputError, match="finite values"):
        replace(data, rate=np.full_like(data.rate, np.nan)).calibrated()
    with pytest.raises(DegenerateGeometryError, match="0 images"):
        replace(data, boards=[]).calibrated()


def test_integrals_are_those_of_the_motion() -> None:
    motion = BoardMotion.random(BOARD, np.random.default_rng(6), distance_m=0.45)
    t_s = np.arange(0.0, 3.0, 1 / 400.0)
    readings = Readings(t_s, *motion.readings(t_s, T_CAMERA_IMU, GRAVITY))
    start_s, duration_s = np.array([0.1234, 1.5]), np.array([0.1, 0.3])
    own = integrals(readings, start_s, duration_s, np.zeros(6))
    T_a, T_b = (se3.inverse(motion.T_camera_board(t)) @ T_CAMERA_IMU for t in (start_s, start_s + duration_s))
    step = 1e-5
    v_a, v_b = (
        (se3.inverse(motion.T_camera_board(t + step)) - se3.inverse(motion.T_camera_board(t - step)))
        @ T_CAMERA_IMU[:, 3]
        / (2 * step)
        for t in (start_s, start_s + duration_s)
    )
    inverse = np.swapaxes(T_a[:, :3, :3], 1, 2)
    dt = duration_s[:, None]
    velocity = (v_b - v_a)[:, :3] - GRAVITY * dt
    position = T_b[:, :3, 3] - T_a[:, :3, 3] - v_a[:, :3] * dt - 0.5 * GRAVITY * dt**2
    np.testing.assert_allclose(own.rotation, inverse @ T_b[:, :3, :3], atol=2e-5)
    np.testing.assert_allclose(own.velocity, (inverse @ velocity[..., None])[..., 0], atol=2e-4)
    np.testing.assert_allclose(own.position, (inverse @ position[..., None])[..., 0], atol=5e-5)
    assert (noise_densities(readings) < [1e-5, 1e-4]).all()


def test_an_adjustment_that_does_not_converge_is_refused(
    data: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert data.calibrated().pose.figures["last_step_sigma"] < 1e-3
    monkeypatch.setattr(camera_imu, "_ITERATIONS", 1)
    with pytest.raises(DegenerateGeometryError, match="did not converge: the last of 1 steps"):
        data.calibrated()


def test_a_changing_set_of_agreeing_images_is_refused(
    data: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    boards = list(data.boards)
    for k in range(10, 110, 9):
        board = boards[k]
        T = board.T_camera_board @ se3.transform(se3.exp_so3([0.0, 0.1, 0.0]), [0.0, 0.0, 0.0])
        boards[k] = replace(board, T_camera_board=T)
    wrong = replace(data, boards=boards)
    assert wrong.calibrated().pose.dropped >= 11
    monkeypatch.setattr(camera_imu_start, "_LARGEST_PASSES", 1)
    with pytest.raises(DegenerateGeometryError, match="still change after 1 passes"):
        wrong.calibrated()
