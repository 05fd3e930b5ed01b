# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A folder of rendered images of a board, poses of a hand and simulated scans, for ``cdff calibrate``."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import yaml

from cdff_common.camera import CameraModel
from cdff_common.formats.tum import write_tum
from cdff_common.geometry import se3
from cdff_core.calibration.boards import Board
from cdff_dev.simulate.board_images import board_image, board_poses
from cdff_dev.simulate.board_scans import board_scan, panel_of, ring_directions

BOARD, TEXT = Board("charuco", 7, 5, 0.12, 0.09), "charuco:7x5:0.12:0.09"
CAMERA = CameraModel(240, 320, 260.0, 261.0, 158.0, 121.0, (-0.2, 0.05, 5e-4, -3e-4))
T_HAND_CAMERA = se3.transform(se3.exp_so3([0.1, -0.2, 1.2]), [0.03, -0.05, 0.08])
T_BASE_BOARD = se3.transform(se3.exp_so3([3.0, 0.1, 0.2]), [2.0, 0.1, -0.1])
AXES = se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5])
T_BASE_CAMERA = se3.transform(AXES, [0.2, 0.1, 0.9])
T_BASE_LIDAR = se3.transform(se3.exp_so3([0.0, 0.1, 0.05]), [0.3, 0.0, 1.1])


def write_board_folder(path: Path) -> None:
    """Write images, clouds, poses of a hand and the calibration of the camera; a pose each second."""
    rng = np.random.default_rng(8)
    for name in ("images", "clouds"):
        (path / name).mkdir()
    size, centre = panel_of(BOARD, 0.0)
    directions = ring_directions(24, lowest_deg=-25.0, highest_deg=20.0, step_deg=0.4)
    hands = []
    for k, T in enumerate(board_poses(BOARD, 9, rng, distance_m=1.2, tilt_deg=30.0)):
        cv2.imwrite(str(path / "images" / f"{k:03d}.png"), board_image(CAMERA, BOARD, T, rng, noise=1.0))
        T_lidar_board = se3.inverse(T_BASE_LIDAR) @ T_BASE_CAMERA @ T
        points = board_scan(T_lidar_board, size, centre, directions, rng)
        np.savetxt(
            path / "clouds" / f"{k:03d}.ply",
            points,
            fmt="%.4f",
            comments="",
            header=f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\n"
            "property float y\nproperty float z\nend_header",
        )
        hands.append(T_BASE_BOARD @ se3.inverse(T) @ se3.inverse(T_HAND_CAMERA))
    (path / "poses.tum").write_bytes(write_tum(np.arange(9) * 10**9, np.array(hands)))
    document = {
        "image_width": 320,
        "image_height": 240,
        "camera_matrix": CAMERA.matrix.tolist(),
        "distortion_coefficients": list(CAMERA.distortion),
    }
    (path / "camera.yaml").write_text(yaml.safe_dump(document))
