# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A log of simulated rovers is computed while it is played."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ConflictError, InputError
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.missions.driven_log import GrowingLog
from cdff_dev.play.start import playable
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.world import World

TICK_NS = 500_000_000


def test_the_log_has_all_sensor_streams_and_an_end_after_more_than_an_hour(
    world: World, growing_log: GrowingLog
) -> None:
    assert sorted(growing_log.streams) == ["/mana/imu.sample", "/mana/lidar.scan", "/mana/wheels.odometry"]
    assert playable(growing_log) == list(growing_log.streams)
    info = growing_log.streams["/mana/lidar.scan"]
    assert (info.type_name, info.t0_ns) == ("LidarScan", world.scenario.epoch_ns)
    assert info.t1_ns - info.t0_ns > 3600 * 10**9


@pytest.mark.req("CDFF-DEV-070")
def test_ground_truth_is_passed_to_the_writer_only(world: World, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "truth") as truth:
        source = GrowingLog(world, truth)
        samples = [sample for sample, _ in zip(source.samples(), range(40), strict=False)]
    assert {s.stream for s in samples} == set(source.streams)
    reader = open_log(tmp_path / "truth")
    truth_samples = list(reader.samples())
    reader.close()
    assert {s.stream for s in truth_samples} == {"/mana/truth.pose"}
    assert len(truth_samples) == 15  # five samples for each of the three started ticks
    start = world.motions["mana"].poses(np.zeros(1))[0]
    assert truth_samples[0].value.transform.matrix == pytest.approx(start, abs=1e-9)


def test_samples_are_ordered_in_time_and_limited_to_the_requested_streams(growing_log: GrowingLog) -> None:
    order = [(s.stamp_ns, s.stream) for s, _ in zip(growing_log.samples(), range(64), strict=False)]
    assert order == sorted(order)
    scans = [s.stream for s, _ in zip(growing_log.samples(["/mana/lidar.scan"]), range(3), strict=False)]
    assert scans == ["/mana/lidar.scan"] * 3


def test_the_log_is_ready_up_to_the_tick_of_the_last_sample(world: World, growing_log: GrowingLog) -> None:
    epoch_ns = world.scenario.epoch_ns
    assert growing_log.ready_ns() == epoch_ns
    for count, sample in enumerate(growing_log.samples()):
        assert growing_log.ready_ns() <= sample.stamp_ns < growing_log.ready_ns() + TICK_NS
        assert growing_log.ready_ns() == epoch_ns + count // 16 * TICK_NS
        if count == 50:
            break


def test_drive_commands_return_start_and_end_in_mission_time(world: World, growing_log: GrowingLog) -> None:
    source, path = growing_log.samples(), np.array([[0.0, 0.0], [1.0, 0.0]])
    next(source)
    start_ns, end_ns = growing_log.drive("mana", path)
    assert start_ns == world.scenario.epoch_ns + TICK_NS
    with pytest.raises(ConflictError, match="mana drives"):
        growing_log.follow("mana")
    while growing_log.ready_ns() < end_ns:
        next(source)
    assert growing_log.drive("mana", path)[0] >= end_ns


def test_a_closed_log_produces_no_more_samples(growing_log: GrowingLog) -> None:
    source = growing_log.samples()
    next(source)
    growing_log.close()
    assert len(list(source)) == 15


def test_a_scenario_with_cameras_is_refused(world: World) -> None:
    scenario = load_scenario("rover_traverse")
    world_with_cameras = World(scenario, world.relief, world.rocks, world.motions, None)
    with pytest.raises(InputError, match=r"rover_traverse.*remove navcam"):
        GrowingLog(world_with_cameras, None)
