# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff check --profile``: report of a profile in words, and of a log against it."""

from __future__ import annotations

import json
import uuid
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_DONE, EXIT_ERROR, main
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_dev.logs import LogWriter

S = 1_000_000_000
PROFILE = """\
name: small
body: {name: moon}
robots:
  - id: pico
    frames:
      - {parent: pico/base, child: pico/imu}
    sensors:
      imu:
        kind: imu
        frame: pico/imu
        streams: {sample: IMUSensors}
        modes: {"off": {on: false}, nominal: {rate_hz: 10.0}}
      wheels:
        kind: wheels
        frame: pico/base
        streams: {odometry: TransformWithCovariance}
    dfpcs:
      - name: position_manager
        inputs: {odometry: sensor/wheels/odometry, imu: sensor/imu/sample}
"""
WHEELS = TransformWithCovariance.from_transform(
    UncertainTransform.identity(), parent="pico/odom", child="pico/base", stamp_ns=0
)


@pytest.fixture
def profile(tmp_path: Path) -> str:
    path = tmp_path / "small.yaml"
    path.write_text(PROFILE, encoding="utf-8")
    return str(path)


def header(stamp_ns: int, frame: str, child: str | None = None) -> Header:
    return Header(str(uuid.UUID(int=stamp_ns)), 0, stamp_ns, stamp_ns, frame, "test", child=child)


def log(
    folder: Path,
    imu: str = "/pico/imu.sample",
    frame: str = "pico/imu",
    period_ns: int = S // 10,
    gap_ns: int = 0,
    with_wheels: bool = True,
) -> str:
    """Write a log of 20 IMU samples, with a gap before the last ten, and of 20 wheel odometries."""
    with LogWriter(str(folder / "drive.msg")) as writer:
        for k in range(20):
            t_ns = S + k * period_ns + (gap_ns if k >= 10 else 0)
            value = IMUSensors(Time.from_ns(t_ns), np.array([0.0, 0.0, 1.62]), np.zeros(3), np.zeros(3))
            writer.write(imu, value, t_ns, header(t_ns, frame))
            if with_wheels:
                writer.write("/pico/wheels.odometry", WHEELS, t_ns, header(t_ns, "pico/odom", "pico/base"))
    return str(folder / "drive.msg")


def test_a_profile_is_described_in_words(profile: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--profile", profile]) == EXIT_DONE
    lines = capsys.readouterr().out.splitlines()
    assert "  imu: imu in pico/imu, sample (IMUSensors); nominal 10 Hz" in lines
    assert lines[-1] == f"{profile}: no errors, no warnings"


def test_the_faults_of_a_profile_end_with_1_and_warnings_with_0(
    tmp_path: Path, profile: str, capsys: pytest.CaptureFixture[str]
) -> None:
    far = "child: pico/imu, translation_m: [0, 0, 120]}"
    Path(profile).write_text(PROFILE.replace("child: pico/imu}", far))
    assert main(["check", "--profile", profile]) == EXIT_DONE
    out = capsys.readouterr().out
    assert f"{profile}:6: warning: robots.pico.frames[0].translation_m" in out
    assert out.endswith("no errors, 1 warning\n")
    Path(profile).write_text(PROFILE.replace("kind: imu", "kind: imuu"))
    assert main(["check", "--profile", profile, "--json", "--log", log(tmp_path)]) == EXIT_ERROR
    content = json.loads(capsys.readouterr().out)
    (fault,) = content["faults"]
    assert (fault["line"], fault["key"], fault["nearest"]) == (9, "robots.pico.sensors.imu.kind", "imu")
    assert content["log_faults"] == []


def test_a_log_that_fits_has_no_findings_and_its_streams_are_described(
    tmp_path: Path, profile: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "--profile", profile, "--log", log(tmp_path)]) == EXIT_DONE
    lines = capsys.readouterr().out.splitlines()
    assert "  /pico/imu.sample: IMUSensors, 20 samples, 10 Hz, no gaps, frame pico/imu" in lines
    assert lines[-1].endswith("drive.msg: no errors, no warnings")


@pytest.mark.parametrize(
    ("fault", "code", "message"),
    [
        (
            {"imu": "/pico/imu.samples"},
            1,
            "/pico/imu.sample: is not in the log; did you mean /pico/imu.samples?",
        ),
        ({"with_wheels": False}, 1, "/pico/wheels.odometry: is not in the log"),
        (
            {"frame": "pico/im"},
            1,
            "'pico/im' in the log, which the profile does not have; did you mean 'pico/imu'?",
        ),
        ({"frame": "pico/base"}, 1, "has the frame 'pico/base' in the log, 'pico/imu' in the profile"),
        ({"period_ns": S // 50}, 0, "has 50 Hz in the log; the profile states 10 Hz in nominal"),
        ({"gap_ns": 2 * S}, 0, "warning: /pico/imu.sample: 1 gap, the longest of 2.1 s at 10 Hz"),
    ],
)
def test_differences_of_a_log_are_named(
    tmp_path: Path,
    profile: str,
    capsys: pytest.CaptureFixture[str],
    fault: dict[str, object],
    code: int,
    message: str,
) -> None:
    path = log(tmp_path, **fault)  # type: ignore[arg-type]
    assert main(["check", "--profile", profile, "--log", path]) == code
    assert message in capsys.readouterr().out


def test_a_stream_of_another_type_and_a_log_of_another_robot_are_errors(
    tmp_path: Path, profile: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = log(tmp_path)
    lidar = PROFILE.replace("sample: IMUSensors", "sample: LidarScan").replace(", imu: sensor/imu/sample", "")
    Path(profile).write_text(lidar)
    assert main(["check", "--profile", profile, "--log", path]) == EXIT_ERROR
    assert "has the type IMUSensors in the log, LidarScan in the profile" in capsys.readouterr().out
    Path(profile).write_text(PROFILE.replace("pico", "nano"))
    assert main(["check", "--profile", profile, "--log", path]) == EXIT_ERROR
    assert "/nano: robot is not in the log, which has one of pico" in capsys.readouterr().out


def test_a_log_without_a_profile_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--log", "drive.msg"]) == EXIT_ERROR
    assert "--log needs --profile FILE" in capsys.readouterr().err
