# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Streams of a log are assigned to the input ports of a DFPC."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.profile import DfpcEntry
from cdff_common.interfaces.registry import Registry
from cdff_dev.replay.wiring import robot_of, wire

LOG = {
    "/mana/navcam.pair": "FramePair",
    "/mana/wheels.odometry": "TransformWithCovariance",
    "/mana/imu.sample": "IMUSensors",
    "/mana/truth.pose": "TransformWithCovariance",
    "/minnie/navcam.pair": "FramePair",
}


def description(name: str) -> DfpcDescription:
    return Registry.default().dfpc(name)


def test_a_unique_stream_is_wired_to_the_unique_port_of_its_type() -> None:
    wiring = wire(description("visual_odometry_sparse"), LOG, "mana", {})
    assert wiring == {
        "stereo": "/mana/navcam.pair",
        "odometry": "/mana/wheels.odometry",
        "imu": "/mana/imu.sample",
    }


def test_a_stream_named_like_the_port_is_wired_and_ground_truth_never() -> None:
    wiring = wire(description("position_manager"), LOG, "mana", {})
    assert wiring == {"odometry": "/mana/wheels.odometry", "imu": "/mana/imu.sample"}


def test_an_explicit_wiring_precedes_an_automatic_one() -> None:
    wiring = wire(description("position_manager"), LOG, "mana", {"visual_odometry": "/mana/wheels.odometry"})
    assert wiring["visual_odometry"] == "/mana/wheels.odometry"


def test_a_profile_wires_the_streams_of_the_log() -> None:
    entry = DfpcEntry(
        name="position_manager",
        inputs={
            "odometry": "sensor/wheels/odometry",
            "visual_odometry": "product/visual_odometry_sparse/pose",
        },
    )
    wiring = wire(description("position_manager"), LOG, "mana", {}, entry)
    assert wiring["odometry"] == "/mana/wheels.odometry"
    assert "visual_odometry" not in wiring


def test_an_input_from_the_dpm_is_found_in_a_log_by_type() -> None:
    inputs = {"dem": "product/digital_elevation_mapping/map", "orbital": "dpm/orbiter/dem"}
    entry = DfpcEntry(name="absolute_localisation", inputs=inputs)
    log = {"/mana/digital_elevation_mapping.map": "ElevationMap", "/mana/survey.orbital": "ElevationMap"}
    wiring = wire(description("absolute_localisation"), log, "mana", {}, entry)
    assert wiring == {"dem": "/mana/digital_elevation_mapping.map", "orbital": "/mana/survey.orbital"}


@pytest.mark.parametrize(
    ("mapping", "fault"),
    [
        ({"nose": "/mana/navcam.pair"}, "has ports stereo"),
        ({"stereo": "/mana/nothing"}, "no stream '/mana/nothing'"),
        ({"stereo": "/mana/imu.sample"}, "takes FramePair"),
    ],
)
def test_a_wrong_wiring_is_refused_with_the_available_streams(mapping: dict[str, str], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        wire(description("visual_odometry_sparse"), LOG, "mana", mapping)


def test_a_log_of_several_robots_needs_a_name() -> None:
    with pytest.raises(InputError, match="mana, minnie"):
        robot_of(LOG, None)
    assert robot_of(LOG, "mana") == "mana"
    assert robot_of({"/kitti/navcam.pair": "FramePair"}, None) == "kitti"
