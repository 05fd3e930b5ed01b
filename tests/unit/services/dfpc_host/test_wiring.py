# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import pytest

from cdff_common.errors import ConfigurationError, InputError
from services.dfpc_host.wiring import parse_inputs, standalone_entry, with_inputs


def test_without_a_profile_the_given_wiring_is_used() -> None:
    robot, entry = standalone_entry(
        "rover", "visual_odometry_sparse", parse_inputs(["stereo=sensor/navcam/pair"])
    )
    assert (robot.id, dict(entry.inputs)) == ("rover", {"stereo": "sensor/navcam/pair"})


@pytest.mark.parametrize(
    ("robot", "dfpc", "inputs", "reason"),
    [
        ("rover", "visual_odometry_sparse", {}, "port 'stereo' has no source; add --input stereo="),
        ("rover", "position_manager", {}, "port 'odometry' has no source"),
        ("rover", "position_manager", {"wheel": "sensor/a/b"}, "no such port; it has odometry, "),
        ("rover", "position_manager", {"odometry": "wheels"}, "sensor/SENSOR/STREAM"),
        ("Rover 1", "position_manager", {"odometry": "sensor/a/b"}, "--robot"),
    ],
)
def test_invalid_wiring_is_refused_with_the_alternatives(
    robot: str, dfpc: str, inputs: dict[str, str], reason: str
) -> None:
    with pytest.raises(ConfigurationError, match=reason.replace("(", r"\(")):
        standalone_entry(robot, dfpc, inputs)


def test_a_source_on_the_command_line_replaces_that_of_the_profile() -> None:
    _, entry = standalone_entry(
        "rover", "position_manager", {"odometry": "sensor/wheels/odometry", "imu": "sensor/imu/sample"}
    )
    assert with_inputs(entry, {"imu": "sensor/imu2/sample"}).inputs["imu"] == "sensor/imu2/sample"
    assert with_inputs(entry, {"imu": "sensor/imu2/sample"}).inputs["odometry"] == "sensor/wheels/odometry"


@pytest.mark.parametrize("items", [["stereo"], ["stereo="], ["=x"], ["a=b", "a=c"]])
def test_an_input_without_port_and_source_is_refused(items: list[str]) -> None:
    with pytest.raises(InputError, match="--input"):
        parse_inputs(items)
