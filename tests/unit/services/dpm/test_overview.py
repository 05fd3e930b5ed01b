# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables of streams, DFPCs and products, and their text."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_common.interfaces.profile import Robot
from services.dpm.cli.top_commands import lines
from services.dpm.operations.overview import overview

ROBOT = Robot.model_validate(
    {
        "id": "mana",
        "frames": [{"parent": "site", "child": "mana/odom"}, {"parent": "mana/base", "child": "mana/lidar"}],
        "sensors": {
            "lidar": {
                "kind": "lidar",
                "frame": "mana/lidar",
                "streams": {"scan": "LidarScan"},
                "modes": {"off": {"on": False}, "nominal": {"rate_hz": 5.0}, "fast": {"rate_hz": 20.0}},
            }
        },
    }
)


def measured(**changes: Any) -> dict[str, Any]:
    return {
        "count": 100,
        "rate_hz": 5.0,
        "offset_s": -0.03,
        "silent_s": 0.1,
        "gaps": 0,
        "lost": 0,
        "backwards": 0,
        "frame": "mana/lidar",
        "frame_known": True,
        "stamp_ns": 0,
        "last": "1000 points",
    } | changes


def dfpc(**stream: Any) -> dict[str, Any]:
    return {
        "robot": "mana",
        "name": "lidar_slam",
        "alive": True,
        "state": "active",
        "streams": {"sensor/lidar/scan": measured(**stream), "product/position_manager/pose": measured()},
        "newest_outputs": {
            "pose": {"product": "pose", "t1_ns": 10**9, "status": "DEGRADED", "reasons": ["few_points:3<10"]},
            "map": {"product": "pointcloud", "t1_ns": 10**9, "status": "OK", "reasons": ["seldom"]},
        },
        "cpu_cores": 0.25,
    }


def faults(mode: str = "nominal", **stream: Any) -> list[str]:
    modes = {
        ("mana", "lidar"): {
            "sensor": "lidar",
            "mode": mode,
            **ROBOT.sensors["lidar"].modes[mode].model_dump(),
        }
    }
    (row,) = overview([ROBOT], [dfpc(**stream)], modes)["streams"]
    listed_faults: list[str] = row["faults"]
    return listed_faults


@pytest.mark.parametrize(
    ("stream", "fault"),
    [
        ({"rate_hz": 2.5}, "2.5 Hz, stated 5 Hz"),
        ({"rate_hz": 10.0}, "10 Hz, stated 5 Hz"),
        ({"silent_s": 4.0}, "silent for 4 s"),
        ({"silent_s": None, "count": 0, "rate_hz": None, "offset_s": None}, "no sample yet"),
        ({"gaps": 2, "lost": 7}, "7 samples lost in 2 gaps"),
        ({"backwards": 3}, "3 stamps not after the previous one"),
        ({"offset_s": 1.0}, "stamps ahead of mission time by 1.00 s"),
        ({"frame": "mana/lidr", "frame_known": False}, "frame 'mana/lidr' is not in the profile"),
    ],
)
def test_each_fault_of_a_stream_is_named(stream: dict[str, Any], fault: str) -> None:
    assert faults(**stream) == [fault]


def test_a_correct_stream_and_one_that_is_off_have_no_fault() -> None:
    assert faults() == []
    assert faults(mode="off", silent_s=100.0) == []
    assert faults(mode="fast", rate_hz=20.0) == []


def test_a_stream_that_no_running_dfpc_reads_has_no_measurements() -> None:
    stopped = dfpc() | {"alive": False}
    (row,) = overview([ROBOT], [stopped], {})["streams"]
    assert "count" not in row
    assert (row["mode"], row["stated_hz"], row["consumers"]) == ("nominal", 5.0, [])


def test_the_quality_of_a_dfpc_is_the_worst_of_its_newest_products_with_its_reasons() -> None:
    tables = overview([ROBOT], [dfpc()], {})
    assert (tables["dfpcs"][0]["quality"], tables["dfpcs"][0]["reasons"]) == ("DEGRADED", ["few_points:3<10"])
    assert [row["port"] for row in tables["newest"]] == ["pose", "map"]


def test_the_text_states_rate_stamp_frame_value_quality_and_age() -> None:
    status = {"now_ns": 3 * 10**9, "alarms": [], "overview": overview([ROBOT], [dfpc(lost=7, gaps=2)], {})}
    text = "\n".join(lines(status))
    assert (
        "mana/lidar.scan  nominal  5.0  5       -0.030 s  7     mana/lidar  7 samples lost in 2 gaps; 1000"
        in text
    )
    assert "mana/lidar_slam  active  DEGRADED  0.25" in text
    assert "mana/lidar_slam.pose  pose        2.0 s  DEGRADED" in text
    assert text.endswith("no alarm is active")


def test_the_text_of_a_dpm_without_profile_says_so() -> None:
    assert "no streams: the DPM has no profile" in "\n".join(lines({"now_ns": 0, "alarms": []}))
