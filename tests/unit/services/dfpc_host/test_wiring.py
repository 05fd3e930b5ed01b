# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import pytest

from cdff_common.errors import ConfigurationError
from services.dfpc_host.wiring import bare, parse_inputs, rewired


def test_without_a_profile_the_wiring_is_what_was_given() -> None:
    robot, entry = bare("rover", "visual_odometry_sparse", parse_inputs(["stereo=sensor/navcam/pair"]))
    assert (robot.id, dict(entry.inputs)) == ("rover", {"stereo": "sensor/navcam/pair"})


@pytest.mark.parametrize(
    ("robot", "dfpc", "inputs", "said"),
    [
        ("rover", "visual_odometry_sparse", {}, "nothing feeds port 'stereo'; add --input stereo="),
        ("rover", "position_manager", {}, "nothing feeds port 'odometry'"),
        ("rover", "position_manager", {"wheel": "sensor/a/b"}, "no such port; it has odometry, "),
        ("rover", "position_manager", {"odometry": "wheels"}, "sensor/SENSOR/STREAM"),
        ("Rover 1", "position_manager", {"odometry": "sensor/a/b"}, "--robot"),
    ],
)
def test_wiring_that_cannot_be_is_refused_with_what_would_do(
    robot: str, dfpc: str, inputs: dict[str, str], said: str
) -> None:
    with pytest.raises(ConfigurationError, match=said.replace("(", r"\(")):
        bare(robot, dfpc, inputs)


def test_a_source_takes_the_place_of_the_profiles() -> None:
    _, entry = bare("rover", "position_manager", {"odometry": "sensor/wheels/odometry", "imu": "sensor/imu/sample"})
    assert rewired(entry, {"imu": "sensor/imu2/sample"}).inputs["imu"] == "sensor/imu2/sample"
    assert rewired(entry, {"imu": "sensor/imu2/sample"}).inputs["odometry"] == "sensor/wheels/odometry"


@pytest.mark.parametrize("items", [["stereo"], ["stereo="], ["=x"], ["a=b", "a=c"]])
def test_an_input_that_is_no_pair_is_refused(items: list[str]) -> None:
    with pytest.raises(ConfigurationError, match="--input"):
        parse_inputs(items)
