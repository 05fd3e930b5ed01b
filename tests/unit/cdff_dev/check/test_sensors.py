# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff check --profile FILE --log LOG`` compares the sensors of the log with each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_dev.check.profile import report
from cdff_dev.logs import LogWriter
from tests.support.sensor_drive import Drive

#: The true mounts of the drive; the pitch of the lidar is a field.
PROFILE = """
name: tilted
robots:
  - id: mana
    frames:
      - {{parent: mana/base, child: mana/lidar, translation_m: [0.1, 0, 0.85], rpy_deg: [0, {pitch_deg}, 0]}}
      - {{parent: mana/base, child: mana/imu, translation_m: [-0.05, 0.02, 0.05], rpy_deg: [0, 0, 90]}}
    sensors:
      lidar: {{kind: lidar, frame: mana/lidar, streams: {{scan: LidarScan}}}}
      imu: {{kind: imu, frame: mana/imu, streams: {{sample: IMUSensors}}}}
      wheels: {{kind: wheels, frame: mana/base, streams: {{odometry: TransformWithCovariance}}}}
    dfpcs:
      - name: position_manager
        inputs: {{imu: sensor/imu/sample, odometry: sensor/wheels/odometry}}
"""
STREAMS = {"imu": "/mana/imu.sample", "odometry": "/mana/wheels.odometry", "scan": "/mana/lidar.scan"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "drive.msg"
    writer = LogWriter(path)
    for sample in Drive(duration_s=14.0).samples(*STREAMS):
        writer.write(STREAMS[sample.port], sample.value, sample.stamp_ns)
    writer.close()
    return path


@pytest.mark.parametrize(("pitch_deg", "is_wrong"), [(20, False), (-20, True)])
def test_a_tilt_with_the_wrong_sign_is_an_error_and_the_right_one_is_not(
    log: Path, tmp_path: Path, pitch_deg: int, is_wrong: bool
) -> None:
    profile = tmp_path / "profile.yaml"
    profile.write_text(PROFILE.format(pitch_deg=pitch_deg))
    result = report(str(profile), str(log))
    assert not result.checked.errors
    disagreements = [f for f in result.findings if "disagrees with the other sensors" in f.problem]
    assert [f.stream for f in disagreements] == (["/mana/lidar"] if is_wrong else [])
    text = "\n".join(result.lines())
    assert "mana: lidar: its vertical is" in text
    assert "imu against wheels: stamps" in text
