# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate ``cdff calibrate hand-eye``, ``camera-lidar`` and ``camera-imu`` on rendered boards.

The comparison for a camera on a robot arm is the closed-form solution by Park and Martin (1994) from the same
poses of the board, over all pairs of images, doi:10.1109/70.326576.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.board_poses import BoardPose, board_poses_of
from cdff_core.calibration.boards import Board
from cdff_core.calibration.camera_imu import camera_imu_calibration
from cdff_core.calibration.camera_lidar import camera_lidar_calibration
from cdff_core.calibration.panels import find_panels
from cdff_core.calibration.relative_pose import RelativePose
from cdff_core.calibration.robot_world import park_martin, robot_world_calibration
from cdff_dev.simulate.board_images import board_image, board_poses
from cdff_dev.simulate.board_motion import BoardMotion, noisy_readings, stamps_at
from cdff_dev.simulate.board_scans import board_scan, panel_of, ring_directions

CAMERA = CameraModel(480, 640, 520.0, 523.0, 315.0, 243.0, (-0.25, 0.08, 5e-4, -3e-4, 0.01))
T_HAND_CAMERA = se3.transform(se3.exp_so3([0.1, -0.2, 1.2]), [0.03, -0.05, 0.08])
T_BASE_BOARD = se3.transform(se3.exp_so3([3.0, 0.1, 0.2]), [0.6, 0.1, -0.1])
T_CAMERA_LIDAR = se3.transform(
    se3.exp_so3([0.02, -0.05, 0.03]) @ se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5]).T,
    [0.1, -0.2, 0.05],
)
SEEDS = range(300, 306)
IMAGES = 14
#: Errors of a pose of the hand, metres and degrees; noise of the ranges, metres.
HAND_SIGMA_M, HAND_SIGMA_DEG, RANGE_SIGMA_M = 0.001, 0.1, 0.01
RINGS = {"16 rings": (16, 0.2), "32 rings": (32, 0.2)}
T_CAMERA_IMU = se3.transform(se3.exp_so3([1.2, -0.7, 0.4]), [0.05, -0.08, 0.03])
#: Motions of the camera with an IMU: duration in seconds, images per second.
MOTIONS = {"6 s at 15 Hz": (6.0, 15.0), "15 s at 15 Hz": (15.0, 15.0)}
IMU_SEEDS = range(300, 304)
IMU_HZ, OFFSET_S, START_NS = 200.0, 0.0237, 1_700_000_000 * 10**9
#: Biases of gyro (rad/s) and accelerometer (m/s2), and gravity in the frame of the board.
BIASES = np.array([0.01, -0.02, 0.005, 0.1, -0.05, 0.08])
GRAVITY = 9.80665 * np.array([0.05, 0.995, 0.0865]) / np.linalg.norm([0.05, 0.995, 0.0865])


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors, stated standard deviations and NEES of the calibrations."""
    figures: dict[str, Any] = {"seeds": len(SEEDS), "images": IMAGES}
    figures |= {"hand_eye": {}, "camera_lidar": {}, "camera_imu": {}, "imu_seeds": len(IMU_SEEDS)}
    for name, exchanged in (("all images fit", 0), ("2 images exchanged", 2)):
        progress(f"hand-eye: {name}")
        figures["hand_eye"][name] = _hand_eye(exchanged)
    for name, (rings, step_deg) in RINGS.items():
        progress(f"camera-lidar: {name}")
        figures["camera_lidar"][name] = _camera_lidar(rings, step_deg)
    for name, (duration_s, images_hz) in MOTIONS.items():
        progress(f"camera-imu: {name}")
        figures["camera_imu"][name] = _camera_imu(duration_s, images_hz)
    return figures


@cache
def _boards(board: Board, distance_m: float, seed: int) -> tuple[list[FloatArray], list[BoardPose]]:
    """Return the true poses of a board, and those by the corners of rendered images."""
    rng = np.random.default_rng(seed)
    poses = list(board_poses(board, IMAGES, rng, distance_m=distance_m))
    views = []
    for k, T in enumerate(poses):
        numbers, pixels = board.detect(board_image(CAMERA, board, T, rng))
        if len(numbers):
            views.append(View(0, k, board.corners_m[numbers], pixels, numbers))
    return poses, board_poses_of(CAMERA, views)


def _hand_eye(exchanged: int) -> dict[str, float]:
    board = Board("charuco", 9, 7, 0.03, 0.022)
    results, peers = [], []
    for seed in SEEDS:
        rng = np.random.default_rng(seed + 1000)
        poses, boards = _boards(board, 0.36, seed)
        hands = []
        for pose in boards:
            A = T_BASE_BOARD @ se3.inverse(poses[pose.number]) @ se3.inverse(T_HAND_CAMERA)
            R = se3.exp_so3(rng.normal(0.0, np.deg2rad(HAND_SIGMA_DEG), 3)) @ A[:3, :3]
            hands.append(se3.transform(R, A[:3, 3] + rng.normal(0.0, HAND_SIGMA_M, 3)))
        if exchanged:
            hands[1], hands[4] = hands[4], hands[1]
        A, B = np.array(hands), np.array([pose.T_camera_board for pose in boards])
        results.append(robot_world_calibration(A, boards)[0])
        first, second = np.array(list(itertools.combinations(range(len(A)), 2))).T
        peers.append(park_martin(se3.inverse(A[second]) @ A[first], B[second] @ se3.inverse(B[first])))
    return _summary(results, T_HAND_CAMERA) | {
        "peer_mm": _rms([np.linalg.norm(T[:3, 3] - T_HAND_CAMERA[:3, 3]) for T in peers]) * 1e3,
        "peer_deg": _rms(
            [np.rad2deg(se3.rotation_angle(T[:3, :3].T @ T_HAND_CAMERA[:3, :3])) for T in peers]
        ),
        "hand_sigma_mm": float(np.mean([r.figures["hand_sigma_m"] for r in results])) * 1e3,
        "hand_sigma_deg": float(np.mean([r.figures["hand_sigma_deg"] for r in results])),
    }


def _camera_lidar(rings: int, step_deg: float) -> dict[str, float]:
    board = Board("charuco", 9, 7, 0.09, 0.066)
    size, centre = panel_of(board, 0.03)
    directions = ring_directions(rings, lowest_deg=-22.0, highest_deg=20.0, step_deg=step_deg)
    results = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed + 1000)
        poses, boards = _boards(board, 1.8, seed)
        panels = []
        for pose in boards:
            T_lidar_board = se3.inverse(T_CAMERA_LIDAR) @ poses[pose.number]
            scan = board_scan(T_lidar_board, size, centre, directions, rng, sigma_m=RANGE_SIGMA_M)
            panels.append(find_panels(scan, size, 6.0))
        diagonal_m = float(np.hypot(*size))
        results.append(camera_lidar_calibration(boards, panels, centre_m=centre, diagonal_m=diagonal_m))
    return _summary(results, T_CAMERA_LIDAR)


def _camera_imu(duration_s: float, images_hz: float) -> dict[str, float]:
    """Return the figures of simulated motions of a camera and a low-cost IMU in front of a rendered board."""
    board = Board("charuco", 9, 7, 0.03, 0.022)
    results, offsets_s, offset_sigmas_s, biases, bias_sigmas = [], [], [], [], []
    for seed in IMU_SEEDS:
        rng = np.random.default_rng(seed)
        motion = BoardMotion.random(board, rng, distance_m=0.45)
        stamps_ns = stamps_at(images_hz, duration_s, START_NS)
        views = []
        for k, T in enumerate(motion.T_camera_board((stamps_ns - START_NS) * 1e-9)):
            numbers, pixels = board.detect(board_image(CAMERA, board, T, rng))
            if len(numbers):
                views.append(View(0, k, board.corners_m[numbers], pixels, numbers))
        imu_ns = stamps_at(IMU_HZ, duration_s + 0.4, START_NS - 200_000_000)
        exact = motion.readings((imu_ns - START_NS) * 1e-9 + OFFSET_S, T_CAMERA_IMU, GRAVITY)
        force, rate = noisy_readings(*exact, rng, rate_hz=IMU_HZ, biases=BIASES)
        result = camera_imu_calibration(stamps_ns, board_poses_of(CAMERA, views), imu_ns, force, rate)
        results.append(result.pose)
        sigma = np.sqrt(np.diag(result.covariance))
        offsets_s.append(result.values[15] - OFFSET_S)
        offset_sigmas_s.append(sigma[15])
        biases.append(np.linalg.norm(result.values[6:9] - BIASES[:3]))
        bias_sigmas.append(np.linalg.norm(sigma[6:9]))
    return _summary(results, T_CAMERA_IMU) | {
        "offset_us": 1e6 * _rms(offsets_s),
        "offset_sigma_us": 1e6 * _rms(offset_sigmas_s),
        "gyro_bias_mrad_s": 1e3 * _rms(biases),
        "gyro_bias_sigma_mrad_s": 1e3 * _rms(bias_sigmas),
    }


def _summary(results: list[RelativePose], truth: FloatArray) -> dict[str, float]:
    errors = []
    for result in results:
        T = result.transform.matrix
        errors.append(np.concatenate([truth[:3, 3] - T[:3, 3], se3.log_so3(truth[:3, :3] @ T[:3, :3].T)]))
    nees = [
        float(e @ np.linalg.inv(r.transform.covariance) @ e) / 6.0
        for e, r in zip(errors, results, strict=True)
    ]
    ratios = np.abs(errors) / np.array([r.sigma for r in results])
    return {
        "error_mm": _rms([np.linalg.norm(e[:3]) for e in errors]) * 1e3,
        "error_deg": float(np.rad2deg(_rms([np.linalg.norm(e[3:]) for e in errors]))),
        "sigma_mm": _rms([np.linalg.norm(r.sigma[:3]) for r in results]) * 1e3,
        "sigma_deg": float(np.rad2deg(_rms([np.linalg.norm(r.sigma[3:]) for r in results]))),
        "nees": float(np.mean(nees)),
        "largest_in_sigma": float(ratios.max()),
        "used": float(np.mean([r.used for r in results])),
        "dropped": float(np.mean([r.dropped for r in results])),
    }


def _rms(values: list[Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def table(figures: dict[str, Any]) -> str:
    """Return the tables."""
    lines = [
        "| camera on a robot arm | used, dropped | error | stated σ | largest error | NEES / 6 (1 expected) "
        "| estimated errors of the arm | error of Park and Martin |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, r in figures["hand_eye"].items():
        lines.append(
            f"{_row(name, r)} | {r['hand_sigma_mm']:.2f} mm, {r['hand_sigma_deg']:.3f}° "
            f"| {r['peer_mm']:.2f} mm, {r['peer_deg']:.3f}° |"
        )
    lines += [
        "",
        "| lidar at a camera | used, dropped | error | stated σ | largest error | NEES / 6 (1 expected) |",
        "|---|---|---|---|---|---|",
    ]
    lines += [f"{_row(name, r)} |" for name, r in figures["camera_lidar"].items()]
    if "camera_imu" in figures:
        lines += [
            "",
            f"| IMU at a camera, {figures['imu_seeds']} seeds | used, dropped | error | stated σ "
            "| largest error | NEES / 6 (1 expected) | error of the offset of the clocks (stated σ) "
            "| error of the bias of the gyro (stated σ) |",
            "|---|---|---|---|---|---|---|---|",
        ]
        lines += [
            f"{_row(name, r)} | {r['offset_us']:.0f} ({r['offset_sigma_us']:.0f}) µs "
            f"| {r['gyro_bias_mrad_s']:.2f} ({r['gyro_bias_sigma_mrad_s']:.2f}) mrad/s |"
            for name, r in figures["camera_imu"].items()
        ]
    return "\n".join(lines)


def _row(name: str, r: dict[str, float]) -> str:
    return (
        f"| {name} | {r['used']:.1f}, {r['dropped']:.1f} | {r['error_mm']:.2f} mm, {r['error_deg']:.3f}° "
        f"| {r['sigma_mm']:.2f} mm, {r['sigma_deg']:.3f}° | {r['largest_in_sigma']:.1f} σ | {r['nees']:.2f}"
    )
