# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway: topics that may pass, refused with the reason; limits of a rate."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from services.gateway_ros2.counters import RateLimit
from services.gateway_ros2.settings import load_settings

_IMU = "{topic: /imu/data, type: sensor_msgs/msg/Imu, stream: imu/sample, frame: mana/imu}"
_TWICE = _IMU.replace("imu/sample", "imu/other")


def _load(tmp_path: Path, text: str) -> object:
    path = tmp_path / "gateway.yaml"
    path.write_text(f"robot: mana\n{text}\n")
    return load_settings(path)


def test_without_outputs_the_gateway_only_reads(tmp_path: Path) -> None:
    settings = _load(tmp_path, f"inputs: [{_IMU}]")
    assert settings.outputs == ()  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"inputs: [{_IMU.replace('msg/Imu', 'msg/Range')}]", "expected one of .*sensor_msgs/msg/Imu"),
        (f"inputs: [{_IMU.replace('/imu/data', '/imu/*')}]", r"inputs\.0\.topic"),
        (f"inputs: [{_IMU}, {_TWICE}]", "a topic twice"),
        (f"inputs: [{_IMU}]\noutputs: [{{product: a/b, topic: /imu/data}}]", "circulate"),
        ("outputs: [{product: a/b, topic: /x, type: std_msgs/msg/Char}]", "expected one of"),
        ("frames: {a: mana/base, b: mana/base}", "two names"),
        ("speed: 3", "speed"),
    ],
)
def test_settings_with_a_fault_are_refused_with_the_key(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        _load(tmp_path, text)


def test_a_rate_limit_admits_a_burst_and_then_its_rate() -> None:
    limit = RateLimit(10.0)
    burst = [limit.admits(100.0) for _ in range(5)]
    assert burst == [True, True, True, False, False]
    assert [limit.admits(100.0 + 0.1 * i) for i in range(1, 4)] == [True, True, True]
    assert sum(limit.admits(200.0 + 0.01 * i) for i in range(1000)) == pytest.approx(100, abs=4)
