# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated rovers as a log that is made while it is played."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ConflictError, InputError
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.missions.driven import Driven
from cdff_dev.play.player import playable
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.world import World

TICK_NS = 500_000_000


def test_its_streams_are_what_sensors_give_and_never_end(world: World, driven: Driven) -> None:
    assert sorted(driven.streams) == ["/mana/imu.sample", "/mana/lidar.scan", "/mana/wheels.odometry"]
    assert playable(driven) == list(driven.streams)
    info = driven.streams["/mana/lidar.scan"]
    assert (info.type_name, info.t0_ns) == ("LidarScan", world.scenario.epoch_ns)
    assert info.t1_ns - info.t0_ns > 3600 * 10**9


@pytest.mark.req("CDFF-DEV-070")
def test_the_truth_goes_to_the_writer_and_to_nobody_else(world: World, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "truth") as truth:
        source = Driven(world, truth)
        handed = [sample for sample, _ in zip(source.samples(), range(40), strict=False)]
    assert {s.stream for s in handed} == set(source.streams)
    reader = open_log(tmp_path / "truth")
    kept = list(reader.samples())
    reader.close()
    assert {s.stream for s in kept} == {"/mana/truth.pose"}
    assert len(kept) == 15  # three ticks were begun
    begin = world.motions["mana"].poses(np.zeros(1))[0]
    assert kept[0].value.transform.matrix == pytest.approx(begin, abs=1e-9)


def test_samples_come_in_order_of_time_and_only_of_streams_that_were_asked_for(driven: Driven) -> None:
    all_of_them = [(s.stamp_ns, s.stream) for s, _ in zip(driven.samples(), range(64), strict=False)]
    assert all_of_them == sorted(all_of_them)
    scans = [s.stream for s, _ in zip(driven.samples(["/mana/lidar.scan"]), range(3), strict=False)]
    assert scans == ["/mana/lidar.scan"] * 3


def test_it_is_ready_only_up_to_what_was_taken(world: World, driven: Driven) -> None:
    epoch_ns = world.scenario.epoch_ns
    assert driven.ready_ns() == epoch_ns
    for taken, sample in enumerate(driven.samples()):
        assert driven.ready_ns() <= sample.stamp_ns < driven.ready_ns() + TICK_NS
        assert driven.ready_ns() == epoch_ns + taken // 16 * TICK_NS
        if taken == 50:
            break


def test_orders_say_when_they_begin_and_end_in_mission_time(world: World, driven: Driven) -> None:
    source, way = driven.samples(), np.array([[0.0, 0.0], [1.0, 0.0]])
    next(source)
    begin_ns, end_ns = driven.drive("mana", way)
    assert begin_ns == world.scenario.epoch_ns + TICK_NS
    with pytest.raises(ConflictError, match="mana drives"):
        driven.follow("mana")
    while driven.ready_ns() < end_ns:
        next(source)
    assert driven.drive("mana", way)[0] >= end_ns


def test_it_makes_no_more_once_it_is_closed(driven: Driven) -> None:
    source = driven.samples()
    next(source)
    driven.close()
    assert len(list(source)) == 15


def test_cameras_are_refused(world: World) -> None:
    with_cameras = load_scenario("rover_traverse")
    world = World(with_cameras, world.relief, world.rocks, world.motions, None)
    with pytest.raises(InputError, match=r"rover_traverse.*leave navcam out"):
        Driven(world, None)
