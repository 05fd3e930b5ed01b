# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff calibrate hand-eye`` and ``camera-lidar`` on folders of rendered images and simulated scans."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from cdff_common.camera import CameraModel
from cdff_common.cli import main
from cdff_common.formats.tum import write_tum
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import load_profile
from cdff_core.calibration.boards import Board
from cdff_dev.calibrate.sensor_data import poses_at
from cdff_dev.simulate.board_images import board_image, board_poses
from cdff_dev.simulate.board_scans import board_scan, panel_of, ring_directions

BOARD, TEXT = Board("charuco", 7, 5, 0.12, 0.09), "charuco:7x5:0.12:0.09"
CAMERA = CameraModel(240, 320, 260.0, 261.0, 158.0, 121.0, (-0.2, 0.05, 5e-4, -3e-4))
T_HAND_CAMERA = se3.transform(se3.exp_so3([0.1, -0.2, 1.2]), [0.03, -0.05, 0.08])
T_BASE_BOARD = se3.transform(se3.exp_so3([3.0, 0.1, 0.2]), [2.0, 0.1, -0.1])
AXES = se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5])
T_BASE_CAMERA = se3.transform(AXES, [0.2, 0.1, 0.9])
T_BASE_LIDAR = se3.transform(se3.exp_so3([0.0, 0.1, 0.05]), [0.3, 0.0, 1.1])
PROFILE = """
name: rover
robots:
  - id: rover
    frames:
      - parent: rover/base
        child: rover/camera
        translation_m: [0.2, 0.1, 0.9]
        quaternion_xyzw: [-0.5, 0.5, -0.5, 0.5]
      - {parent: rover/base, child: rover/lidar, translation_m: [0.0, 0.0, 1.0]}  # to be calibrated
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with images, clouds, poses of a hand and the calibration of the camera."""
    path, rng = tmp_path_factory.mktemp("boards"), np.random.default_rng(8)
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
    return path


def test_a_camera_on_a_hand_is_calibrated_from_a_folder_of_images_and_poses(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", "hand-eye", str(folder), "--board", TEXT, "--camera", str(folder / "camera.yaml")]
    assert main([*command, "--out", str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert "assessment: good" in output
    document = json.loads((tmp_path / "calibration.json").read_text())
    T = np.array(document["T"])
    sigma = np.sqrt(np.diag(document["covariance"]))
    assert (np.abs(T[:3, 3] - T_HAND_CAMERA[:3, 3]) < 4.5 * sigma[:3] + 1e-4).all()
    assert np.linalg.norm(T[:3, 3] - T_HAND_CAMERA[:3, 3]) < 0.01
    assert se3.rotation_angle(T[:3, :3].T @ T_HAND_CAMERA[:3, :3]) < np.deg2rad(0.3)


def test_the_mount_of_a_lidar_is_written_to_the_profile(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = tmp_path / "rover.yaml"
    profile.write_text(PROFILE)
    command = ["calibrate", "camera-lidar", str(folder), "--board", TEXT, "--json", "--write"]
    command += ["--camera", str(folder / "camera.yaml"), "--profile", str(profile)]
    assert main([*command, "--camera-frame", "rover/camera", "--lidar-frame", "rover/lidar"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["parent"] == "rover/camera"
    assert document["used"] >= 6
    edge = load_profile(profile).robot("rover").frame_graph().lookup("rover/base", "rover/lidar", 0)
    assert np.linalg.norm(edge.matrix[:3, 3] - T_BASE_LIDAR[:3, 3]) < 0.02
    assert se3.rotation_angle(edge.matrix[:3, :3].T @ T_BASE_LIDAR[:3, :3]) < np.deg2rad(0.6)
    assert "# to be calibrated" in profile.read_text()


def test_wrong_options_are_refused_with_the_remedy(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["calibrate", "camera-lidar", str(folder), "--board", TEXT]
    assert main([*command, "--panel", "wide"]) == 1
    assert "expected WIDTHxHEIGHT" in capsys.readouterr().err
    assert main([*command, "--write"]) == 1
    assert "--write needs --profile" in capsys.readouterr().err
    assert main([*command, "--lidar", "/x/y.z"]) == 1
    assert "--camera FILE" in capsys.readouterr().err


def test_poses_are_interpolated_in_time_or_taken_by_order() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0.0, 1.0, 3.0]
    stamps = np.array([0, 200_000_000, 900_000_000])
    found, is_known, by = poses_at(np.array([100_000_000, 500_000_000, 900_000_000]), stamps, poses)
    assert is_known.tolist() == [True, False, True]
    assert by == "time"
    assert found[0, 0, 3] == pytest.approx(0.5)
    assert found[2, 0, 3] == 3.0
    found, is_known, by = poses_at(np.array([5, 6, 7]) * 10**12, stamps, poses)
    assert is_known.all()
    assert (found == poses).all()
    assert by == "order"
