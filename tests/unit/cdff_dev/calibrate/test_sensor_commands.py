# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff calibrate hand-eye``, ``camera-lidar`` and ``camera-imu`` on folders of rendered images."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import load_profile
from cdff_dev.calibrate.sensor_data import poses_at
from tests.support.board_folder import T_BASE_CAMERA, T_BASE_LIDAR, T_HAND_CAMERA, TEXT, write_board_folder
from tests.support.board_motion_folder import (
    BIASES,
    OFFSET_S,
    T_CAMERA_IMU,
    write_motion_folder,
    write_motion_log,
)

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
      - {parent: rover/base, child: rover/imu, translation_m: [0.0, 0.0, 0.5]}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with images, clouds, poses of a hand and the calibration of the camera."""
    path = tmp_path_factory.mktemp("boards")
    write_board_folder(path)
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


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with images of a board in motion, readings of an IMU and the calibration."""
    path = tmp_path_factory.mktemp("motion")
    write_motion_folder(path)
    return path


def test_pose_offset_and_biases_of_an_imu_are_found_from_a_folder_and_written_to_the_profile(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = tmp_path / "rover.yaml"
    profile.write_text(PROFILE)
    command = ["calibrate", "camera-imu", str(motion), "--board", TEXT, "--write"]
    command += ["--camera", str(motion / "camera.yaml"), "--profile", str(profile)]
    command += ["--camera-frame", "rover/camera", "--imu-frame", "rover/imu", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    output = capsys.readouterr().out
    assert "rover/imu in rover/camera" in output
    assert "assessment: good" in output
    document = json.loads((tmp_path / "out" / "calibration.json").read_text())
    T, sigma = np.array(document["T"]), np.sqrt(np.diag(document["parameter_covariance"]))
    rotation = se3.log_so3(T_CAMERA_IMU[:3, :3] @ T[:3, :3].T)
    assert (np.abs(T[:3, 3] - T_CAMERA_IMU[:3, 3]) < 4.5 * sigma[:3]).all()
    assert (np.abs(rotation) < 4.5 * sigma[3:6]).all()
    assert np.rad2deg(np.linalg.norm(rotation)) < 0.3
    figures = document["figures"]
    gyro_bias = np.array([figures[f"gyro_bias_{axis}_rad_s"] for axis in "xyz"])
    assert (np.abs(gyro_bias - BIASES[:3]) < 4.5 * sigma[6:9]).all()
    assert abs(figures["time_offset_s"] - OFFSET_S) < 4.5 * figures["time_offset_sigma_s"]
    assert figures["time_offset_sigma_s"] < 1e-3
    edge = load_profile(profile).robot("rover").frame_graph().lookup("rover/base", "rover/imu", 0)
    expected = T_BASE_CAMERA @ T_CAMERA_IMU
    assert np.linalg.norm(edge.matrix[:3, 3] - expected[:3, 3]) < 0.02
    assert se3.rotation_angle(edge.matrix[:3, :3].T @ expected[:3, :3]) < np.deg2rad(0.3)
    assert main([*command, "--gravity", "-9.8"]) == 1
    assert "--gravity" in capsys.readouterr().err


def test_images_and_readings_of_a_log_give_the_pose_of_an_imu_and_the_frames_of_the_log(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["--board", TEXT, "--camera", str(motion / "camera.yaml"), "--json"]
    log = tmp_path / "drive.msg"
    write_motion_log(motion, log)
    assert main(["calibrate", "camera-imu", str(log), *command]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["parent"], document["child"]) == ("rover/camera", "rover/imu")
    assert document["images"] == len(list((motion / "images").iterdir()))
    T, sigma = np.array(document["T"]), np.sqrt(np.diag(document["parameter_covariance"]))
    assert (np.abs(T[:3, 3] - T_CAMERA_IMU[:3, 3]) < 4.5 * sigma[:3]).all()
    assert (np.abs(se3.log_so3(T_CAMERA_IMU[:3, :3] @ T[:3, :3].T)) < 4.5 * sigma[3:6]).all()
    assert main(["calibrate", "camera-imu", str(log), *command, "--imu", "/rover/other.sample"]) == 1
    assert "/rover/other.sample" in capsys.readouterr().err


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
