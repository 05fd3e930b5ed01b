# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rate, losses, lead and frame of the samples of a sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from cdff_core.consistency.limits import Limits
from cdff_core.consistency.monitor import SensorMonitor
from cdff_core.consistency.stream_statistics import StreamStatistics
from tests.support.sensor_drive import SENSORS, context

S = 1_000_000_000
ENTRY = {"modes": {"off": {"on": False}, "nominal": {"rate_hz": 2.0}, "slow": {"rate_hz": 1.0}}}


def statistics(numbers: list[int], period_s: float = 0.5, **entry: object) -> StreamStatistics:
    stream = StreamStatistics("lidar", {**ENTRY, **entry}, Limits())
    for number in numbers:
        stream.add(round(number * period_s * S), number)
    return stream


def test_a_stream_as_stated_has_no_finding() -> None:
    assert statistics(list(range(40))).findings() == []
    assert statistics(list(range(40)), period_s=1.0).findings() == []


def test_lost_samples_are_measured_and_limited_by_the_profile() -> None:
    numbers = [n for n in range(60) if n % 3]
    (finding,) = statistics(numbers).findings()
    assert finding.reason == "sensor_samples:lidar_0.32_lost"
    assert "32 %" in finding.what
    assert statistics(numbers, max_lost_fraction=0.5).findings() == []


def test_a_mode_with_a_lower_rate_that_skips_numbers_regularly_loses_nothing() -> None:
    assert statistics(list(range(0, 80, 2)), period_s=0.5).findings() == []  # slow: every second sweep


def test_a_rate_that_no_mode_states_is_named_with_the_stated_ones() -> None:
    (finding,) = statistics(list(range(40)), period_s=0.1).findings()
    assert finding.reason == "sensor_samples:lidar_10_hz"
    assert "1 Hz or 2 Hz" in finding.what
    assert statistics(list(range(40)), period_s=0.1, max_rate_ratio=6.0).findings() == []


def test_a_pause_is_no_loss() -> None:
    assert statistics([*range(30), *range(60, 90)]).findings() == []


def test_stamps_ahead_of_the_mission_clock_are_a_finding_with_the_lead() -> None:
    stream = statistics(list(range(5)))
    for k in range(5):
        stream.add_arrival(k * S + S, k * S)
    (finding,) = stream.findings()
    assert finding.reason == "sensor_clock:lidar_ahead_1.0_s"
    assert "ahead of the mission clock by 1.0 s" in finding.what


def scans(frame: str) -> list[Sample]:
    points, offsets = np.zeros((3, 3), np.float32), np.zeros(3, np.uint32)
    return [
        Sample(
            "scan", k * S, k, LidarScan.from_arrays(points, offsets, frame=frame, t0_ns=k * S, t1_ns=k * S)
        )
        for k in range(8)
    ]


def monitor_of(dfpc_context: DfpcContext) -> SensorMonitor:
    return SensorMonitor(dfpc_context, Registry.default().dfpc("digital_elevation_mapping").input_ports)


def test_samples_with_an_unknown_frame_are_counted_and_named_with_the_nearest_known_one() -> None:
    monitor = monitor_of(context())
    for sample in scans("mana/lidr"):
        monitor.add(sample)
    assert monitor.unknown_frames == {"mana/lidr": 8}
    (finding,) = monitor.findings
    assert finding.reason == "sensor_frame:lidar_mana/lidr"
    assert "did you mean mana/lidar?" in finding.what


@pytest.mark.parametrize("dfpc_context", [context(), DfpcContext("mana")], ids=["known", "no frames"])
def test_known_frames_and_robots_without_frames_have_no_finding(dfpc_context: DfpcContext) -> None:
    monitor = monitor_of(dfpc_context)
    for sample in scans("mana/lidar"):
        monitor.add(sample)
    assert monitor.unknown_frames == {}
    assert monitor.findings == ()


def test_the_limit_of_clock_offsets_is_that_of_the_sensors() -> None:
    sensors = {name: {**entry, "max_offset_s": 0.5} for name, entry in SENSORS.items()}
    monitor = monitor_of(replace(context(), sensors=sensors))
    assert monitor.limits.offset_s == 0.5
