# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a camera on a hand and of a lidar at a camera: within stated errors, outliers, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.board_poses import BoardPose, board_poses_of
from cdff_core.calibration.boards import Board
from cdff_core.calibration.camera_lidar import camera_lidar_calibration
from cdff_core.calibration.panels import Panel, find_panels
from cdff_core.calibration.relative_pose import RelativePose
from cdff_core.calibration.robot_world import robot_world_calibration
from cdff_dev.simulate.board_images import board_poses
from cdff_dev.simulate.board_scans import board_scan, panel_of, ring_directions

CAMERA = CameraModel(480, 640, 520.0, 523.0, 315.0, 243.0, (-0.25, 0.08, 5e-4, -3e-4, 0.01))
T_HAND_CAMERA = se3.transform(se3.exp_so3([0.1, -0.2, 1.2]), [0.03, -0.05, 0.08])
T_BASE_BOARD = se3.transform(se3.exp_so3([3.0, 0.1, 0.2]), [0.6, 0.1, -0.1])
AXES = se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5]).T
T_CAMERA_LIDAR = se3.transform(se3.exp_so3([0.02, -0.05, 0.03]) @ AXES, [0.1, -0.2, 0.05])
SMALL, LARGE = Board("charuco", 9, 7, 0.03, 0.022), Board("charuco", 9, 7, 0.09, 0.066)
RINGS = ring_directions(16, lowest_deg=-22.0, highest_deg=20.0, step_deg=0.3)
#: 99.9 % quantile of chi-square with six degrees of freedom.
CHI2_999 = 22.46


def boards_of(poses: list[np.ndarray], board: Board, rng: np.random.Generator) -> list[BoardPose]:
    """Return the poses of the board from corners with noise of 0.1 px."""
    views = []
    for k, T in enumerate(poses):
        pixels = CAMERA.project(board.corners_m @ T[:3, :3].T + T[:3, 3])
        pixels = pixels + rng.normal(0.0, 0.1, pixels.shape)
        numbers = np.flatnonzero(((pixels > 0) & (pixels < [639, 479])).all(axis=1))
        views.append(View(0, k, board.corners_m[numbers], pixels[numbers], numbers))
    return board_poses_of(CAMERA, views)


def hands_of(poses: list[np.ndarray], rng: np.random.Generator, sigma_m: float = 1e-3) -> np.ndarray:
    """Return poses of the hand with errors of 1 mm and 0.1°."""
    hands = []
    for T in poses:
        A = T_BASE_BOARD @ se3.inverse(T) @ se3.inverse(T_HAND_CAMERA)
        R = se3.exp_so3(rng.normal(0.0, np.deg2rad(0.1), 3)) @ A[:3, :3]
        hands.append(se3.transform(R, A[:3, 3] + rng.normal(0.0, sigma_m, 3)))
    return np.array(hands)


def chi2(result: RelativePose, truth: np.ndarray) -> float:
    T = result.transform.matrix
    error = np.concatenate([truth[:3, 3] - T[:3, 3], se3.log_so3(truth[:3, :3] @ T[:3, :3].T)])
    return float(error @ np.linalg.inv(result.transform.covariance) @ error)


def test_the_pose_of_a_camera_on_a_hand_is_found_without_a_guess_despite_exchanged_images(
    rng: np.random.Generator,
) -> None:
    poses = list(board_poses(SMALL, 16, rng, distance_m=0.36))
    boards, hands = boards_of(poses, SMALL, rng), hands_of(poses, rng)
    hands[[2, 7]] = hands[[7, 2]]
    result, T_base_board = robot_world_calibration(hands, boards)
    assert chi2(result, T_HAND_CAMERA) < CHI2_999
    assert np.linalg.norm(result.transform.matrix[:3, 3] - T_HAND_CAMERA[:3, 3]) < 0.004
    assert np.linalg.norm(T_base_board[:3, 3] - T_BASE_BOARD[:3, 3]) < 0.004
    assert result.dropped == 2
    assert result.undetermined == ()
    assert "2 images contradict" in result.sentences[0]
    assert result.figures["hand_sigma_m"] == pytest.approx(1e-3, rel=0.5)
    assert result.figures["hand_sigma_deg"] == pytest.approx(0.1, rel=0.5)


def test_a_hand_that_rotates_about_one_axis_does_not_determine_the_position_of_the_camera(
    rng: np.random.Generator,
) -> None:
    centre = np.array([0.12, 0.09, 0.0])
    poses = []
    for angle in np.linspace(-0.5, 0.5, 10):
        R = se3.exp_so3([0.0, angle, 0.0])
        poses.append(se3.transform(R, [0.05 * angle, 0.02, 0.4] - R @ centre))
    result, _ = robot_world_calibration(hands_of(poses, rng), boards_of(poses, SMALL, rng))
    assert {"x", "y", "z"} & set(result.undetermined)
    assert "second axis" in result.sentences[0]


def test_images_of_a_hand_that_does_not_rotate_or_of_other_poses_are_refused(
    rng: np.random.Generator,
) -> None:
    poses = [se3.transform(np.eye(3), [0.01 * k - 0.1, 0.0, 0.5]) for k in range(8)]
    boards = boards_of(poses, SMALL, rng)
    with pytest.raises(DegenerateGeometryError, match="rotate it about two axes"):
        robot_world_calibration(hands_of(poses, rng), boards)
    with pytest.raises(InputError, match="expected equal numbers"):
        robot_world_calibration(hands_of(poses, rng)[:-1], boards)
    with pytest.raises(DegenerateGeometryError, match="take more images"):
        robot_world_calibration(hands_of(poses, rng)[:4], boards[:4])


def scans_of(
    boards: list[BoardPose], poses: list[np.ndarray], rng: np.random.Generator
) -> tuple[list[list[Panel]], np.ndarray, float]:
    """Return the panels in each scan, the centre of the panel and its diagonal."""
    size, centre = panel_of(LARGE, 0.03)
    panels = []
    for board in boards:
        T_lidar_board = se3.inverse(T_CAMERA_LIDAR) @ poses[board.number]
        panels.append(find_panels(board_scan(T_lidar_board, size, centre, RINGS, rng), size, 6.0))
    return panels, centre, float(np.hypot(*size))


def test_the_pose_of_a_lidar_is_found_without_a_guess_next_to_a_box_of_the_size_of_the_board(
    rng: np.random.Generator,
) -> None:
    poses = list(board_poses(LARGE, 10, rng, distance_m=1.8))
    boards = boards_of(poses, LARGE, rng)
    panels, centre, diagonal_m = scans_of(boards, poses, rng)
    assert sum(len(own) > 1 for own in panels) > 5
    result = camera_lidar_calibration(boards, panels, centre_m=centre, diagonal_m=diagonal_m)
    assert chi2(result, T_CAMERA_LIDAR) < CHI2_999
    assert np.linalg.norm(result.transform.matrix[:3, 3] - T_CAMERA_LIDAR[:3, 3]) < 0.01
    assert result.undetermined == ()
    assert result.used >= 7


def test_boards_of_one_orientation_do_not_determine_the_pose_of_a_lidar(rng: np.random.Generator) -> None:
    poses = list(board_poses(LARGE, 8, rng, distance_m=1.8, tilt_deg=0.0))
    boards = boards_of(poses, LARGE, rng)
    panels, centre, diagonal_m = scans_of(boards, poses, rng)
    with pytest.raises(DegenerateGeometryError, match="0 of 8 scans agree"):
        camera_lidar_calibration(boards, panels, centre_m=centre, diagonal_m=diagonal_m)
    with pytest.raises(DegenerateGeometryError, match="detected in 0 of 8 scans"):
        camera_lidar_calibration(boards, [[]] * 8, centre_m=centre, diagonal_m=diagonal_m)


def test_scans_of_other_times_are_dropped(rng: np.random.Generator) -> None:
    poses = list(board_poses(LARGE, 10, rng, distance_m=1.8))
    boards = boards_of(poses, LARGE, rng)
    panels, centre, diagonal_m = scans_of(boards, poses, rng)
    panels[1], panels[4] = panels[4], panels[1]
    result = camera_lidar_calibration(boards, panels, centre_m=centre, diagonal_m=diagonal_m)
    assert result.dropped >= 2
    assert chi2(result, T_CAMERA_LIDAR) < CHI2_999
    assert "contradict the others" in " ".join(result.sentences)
