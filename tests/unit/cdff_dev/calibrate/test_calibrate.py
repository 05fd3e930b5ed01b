# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff calibrate extrinsics``: report, refusal, and the mounts in the text of a profile."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_ERROR, main
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.profile import load_profile
from cdff_dev.calibrate.profile_edit import with_mounts
from evaluation.data_sets import husky
from evaluation.position_manager_husky import evaluate_drive

PROFILE = """\
# my rover
name: rover
robots:
  - id: mana
    frames:
      - {parent: site, child: mana/odom}
      - {parent: mana/base, child: mana/lidar, translation_m: [0.1, 0, 0.85]}  # measured
      - parent: mana/base
        child: mana/imu
        rpy_deg: [0, 0, 90]
      - {parent: mana/lidar, child: mana/lamp}
    sensors:
      lidar: {kind: lidar, frame: mana/lidar, streams: {scan: LidarScan}}
      imu: {kind: imu, frame: mana/imu, streams: {sample: IMUSensors}}
"""


def test_mounts_are_replaced_in_both_styles_and_everything_else_is_kept(tmp_path: Path) -> None:
    T = UncertainTransform.from_xyz_rpy_deg([0.2, -0.1, 0.9], [0, 12, 30], sigma_m=0.004, sigma_deg=0.3)
    text = with_mounts(PROFILE, "mana", {"mana/imu": T, "mana/lidar": T})
    assert "# my rover" in text
    assert "sigma_deg: 0.300}  # measured" in text
    path = tmp_path / "rover.yaml"
    path.write_text(text)
    robot = load_profile(path).robot("mana")
    for frame in ("mana/imu", "mana/lidar"):
        mount = robot.frame_graph().lookup("mana/base", frame, 0)
        np.testing.assert_allclose(mount.matrix, T.matrix, atol=1e-5)
        np.testing.assert_allclose(mount.covariance, T.covariance, rtol=1e-2, atol=1e-9)
    assert robot.frame_graph().parent_of("mana/lamp") == "mana/lidar"


def test_a_frame_without_an_edge_below_the_base_is_refused_with_those_that_exist() -> None:
    with pytest.raises(
        InputError, match=r"'mana/lamp': no edge below mana/base .* it has mana/lidar, mana/imu"
    ):
        with_mounts(PROFILE, "mana", {"mana/lamp": UncertainTransform.identity()})


def test_a_log_without_wheels_is_refused(
    real_data: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    log = real_data("kitti_velodyne")
    assert main(["calibrate", "extrinsics", str(log)]) == EXIT_ERROR
    assert "expected one of wheel odometry" in capsys.readouterr().err


def test_writing_needs_a_profile(
    real_data: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    log = real_data("rosbags/husky_first_150s.bag")
    assert main(["calibrate", "extrinsics", str(log), "--write"]) == EXIT_ERROR
    assert "--write needs --profile FILE" in capsys.readouterr().err


@pytest.mark.slow
def test_a_rover_from_nothing_but_its_bag_is_as_accurate_as_the_one_made_by_hand(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, path = real_data("rosbags/husky_first_150s.bag"), tmp_path / "husky.yaml"
    assert main(["new", "profile", str(bag), "--out", str(path)]) == 0
    capsys.readouterr()
    command = ["calibrate", "extrinsics", str(bag), "--profile", str(path), "--write", "--json"]
    assert main(command) == 0
    (sensor,) = json.loads(capsys.readouterr().out)["sensors"]
    assert sensor["undetermined"] == ["x", "y", "z"]
    robot = load_profile(path).robot("husky_first_150s")
    mount = robot.frame_graph().lookup("husky_first_150s/base", "husky_first_150s/imu_link", 0)
    turned = se3.log_so3(mount.matrix[:3, :3] @ husky.T_BASE_IMU[:3, :3].T)
    assert np.rad2deg(np.linalg.norm(turned)) < 2.0

    by_hand = husky.read_drive(bag)
    drive = husky.read_drive(bag)
    drive.context.frames.set_static(f"{husky.ROBOT}/base", f"{husky.ROBOT}/imu", mount)
    sets = {"wheels, imu": ("odometry", "imu")}
    errors = [evaluate_drive(d, sets)["error_m"]["wheels, imu"] for d in (by_hand, drive)]
    assert errors[1] <= 1.05 * errors[0]
