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


def test_a_driven_rover_takes_stereo_pairs_at_the_poses_of_its_motion(camera_world: World) -> None:
    source = GrowingLog(camera_world, None)
    rover = source.rovers["mana"]
    model = camera_world.scenario.navcam
    assert model is not None
    samples = list(rover.samples(0))
    first, last = rover.drive(np.array([[0.0, 0.0], [1.0, 0.0]]), 1)
    samples += [s for tick in range(1, last + 1) for s in rover.samples(tick)]
    pairs = [s for s in samples if s.stream == "/mana/navcam.pair"]
    assert first == 1
    assert [s.seq for s in pairs] == list(range(last + 1))
    assert set(np.diff([s.stamp_ns for s in pairs])) == {TICK_NS}
    value = pairs[0].value
    assert (value.left.image.shape, value.frame) == ((48, 64), "mana/navcam_left")
    np.testing.assert_allclose(value.camera_matrix, model.camera_matrix)
    # At rest, two pairs differ by their noise only; the images of the motion differ.
    before, moved = (np.array(s.value.left.image, float) for s in (pairs[0], pairs[-1]))
    at_rest = np.array(pairs[1].value.left.image, float)
    assert 0.1 < np.abs(at_rest - before).mean() < 3.0 < np.abs(moved - before).mean()
    truth = [s for s in samples if s.stream == "/mana/truth.pose"]
    assert {s.stamp_ns for s in pairs} <= {s.stamp_ns for s in truth}


def test_the_streams_of_a_camera_are_announced(camera_world: World, growing_log: GrowingLog) -> None:
    source = GrowingLog(camera_world, None)
    assert set(source.streams) - set(growing_log.streams) == {"/mana/navcam.pair"}
    assert source.streams["/mana/navcam.pair"].type_name == "FramePair"
    assert source.ahead_bytes == growing_log.ahead_bytes + 4 * 48 * 64


def test_a_scenario_with_rovers_in_view_is_refused(world: World) -> None:
    scenario = load_scenario("distant_rovers")
    other = World(scenario, world.relief, world.rocks, world.motions, None)
    with pytest.raises(InputError, match=r"distant_rovers: rovers_in_view: expected none"):
        GrowingLog(other, None)
