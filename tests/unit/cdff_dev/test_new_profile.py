# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff new profile`` writes a valid profile with the sensors of a log."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cdff_common.cli import EXIT_ERROR, main
from cdff_common.interfaces.profile import load_profile


def new_profile(log: Path, out: Path) -> int:
    return main(["new", "profile", str(log), "--out", str(out)])


@pytest.mark.parametrize(
    ("log", "kinds", "dfpcs"),
    [
        (
            "kitti_stereo",
            {"stereo_camera"},
            ["visual_odometry_sparse", "position_manager", "digital_elevation_mapping", "navigation_mapping"],
        ),
        (
            "kitti_velodyne",
            {"lidar"},
            ["lidar_slam", "position_manager", "digital_elevation_mapping", "navigation_mapping"],
        ),
        ("rosbags/husky_first_150s.bag", {"wheels", "imu"}, ["position_manager"]),
    ],
)
def test_a_profile_has_the_sensors_and_dfpcs_of_a_log(
    real_data: Callable[[str], Path], tmp_path: Path, log: str, kinds: set[str], dfpcs: list[str]
) -> None:
    out = tmp_path / "robot.yaml"
    assert new_profile(real_data(log), out) == 0
    (robot,) = load_profile(out).robots
    assert kinds <= {sensor.kind for sensor in robot.sensors.values()}
    assert [entry.name for entry in robot.dfpcs] == dfpcs
    assert "Enter the mounts" in out.read_text(encoding="utf-8")


def test_satellite_navigation_has_a_local_frame_and_is_no_wheel_sensor(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    out = tmp_path / "robot.yaml"
    assert new_profile(real_data("rosbags/husky_first_150s.bag"), out) == 0
    profile = load_profile(out)
    (robot,) = profile.robots
    assert profile.body.name == "earth"
    assert robot.sensors["fix"].kind == "other"
    assert f"{robot.id}/enu" in robot.frame_graph().frames
    assert not any("anchor" in name for name in robot.sensors)


def test_an_existing_file_is_not_replaced(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "robot.yaml"
    out.write_text("mine")
    assert new_profile(real_data("kitti_velodyne"), out) == EXIT_ERROR
    assert "exists: name another file" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_a_log_without_sensors_is_refused_with_its_streams(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "robot.yaml"
    assert new_profile(real_data("infuse_logs"), out) == EXIT_ERROR
    assert "it has /dynamixel.transforms" in capsys.readouterr().err
    assert not out.exists()
