# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common import cli
from cdff_common.interfaces.profile import load_profile

FILE = Path(__file__).parent / "transformer_iv.aadl"


def test_a_profile_has_a_sensor_for_each_function_that_sends_known_messages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "taste.yaml"
    assert cli.main(["import", "taste", str(FILE), "--robot", "minnie", "--out", str(out)]) == 0
    profile = load_profile(out)
    sensor = profile.robots[0].sensors["aligner"]
    assert (profile.robots[0].id, dict(sensor.streams)) == ("minnie", {"aligned": "RigidBodyState"})
    assert "Written by `cdff import taste` from" in out.read_text()
    assert "sensors aligner; DFPCs none" in capsys.readouterr().out
    assert cli.main(["import", "taste", str(FILE), "--out", str(out)]) == 1
    assert "exists: name another file with --out" in capsys.readouterr().err


def test_the_view_of_a_dfpc_becomes_a_profile_with_that_dfpc(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "taste"
    assert cli.main(["generate", "taste", "lidar_slam", "--out", str(folder)]) == 0
    assert cli.main(["generate", "taste", "lidar_slam", "--out", str(folder), "--check"]) == 0
    (folder / "lidar_slam_dv.aadl").write_text("edited")
    assert cli.main(["generate", "taste", "lidar_slam", "--out", str(folder), "--check"]) == 1
    assert (folder / "lidar_slam_dv.aadl").read_text() == "edited"
    out = tmp_path / "taste.yaml"
    view = folder / "lidar_slam_iv.aadl"
    assert cli.main(["import", "taste", str(view), "--out", str(out)]) == 0
    robot = load_profile(out).robots[0]
    assert robot.sensors["robot"].streams["scan"] == "LidarScan"
    assert "lidar_slam" in {entry.name for entry in robot.dfpcs}
    assert "no stream: robot.get_map is a call, not a message" in capsys.readouterr().out


def test_messages_of_unknown_types_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    view = tmp_path / "other_iv.aadl"
    view.write_text(FILE.read_text().replace("Base_samples_RigidBodyState", "Base_commands_Joints"))
    assert cli.main(["import", "taste", str(view), "--out", str(tmp_path / "x.yaml")]) == 1
    error = capsys.readouterr().err
    assert "Aligner.aligned has the type Base_commands_Joints, which is no type of CDFF" in error
    assert not (tmp_path / "x.yaml").exists()


def test_framework_files_need_the_name_of_a_dfpc(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["generate", "genom3"]) == 1
    assert "expected the NAME of a DFPC" in capsys.readouterr().err
    assert cli.main(["generate", "genom3", "nothing"]) == 1
    assert cli.main(["generate", "types", "--out", str(tmp_path)]) == 1
    assert "other files have their place" in capsys.readouterr().err
