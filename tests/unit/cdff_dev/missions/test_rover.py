# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated rover that is told its way: its samples, its errors from leg to leg, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
import pytest

from cdff_common.codecs import encode
from cdff_common.errors import ConflictError, InputError
from cdff_dev.logs import LogSample
from cdff_dev.missions.driven import Driven
from cdff_dev.missions.rover import Rover
from cdff_dev.simulate.lidar import directions
from cdff_dev.simulate.world import World

MS = 1_000_000
#: Of each stream: samples a tick of half a second, and what is between two of them.
PER_TICK = {"imu.sample": (10, 50 * MS), "wheels.odometry": (5, 100 * MS), "truth.pose": (5, 100 * MS)}


@pytest.fixture
def rover(driven: Driven) -> Rover:
    return driven.rovers["mana"]


def taken(rover: Rover, first: int, last: int) -> dict[str, list[LogSample]]:
    """Samples of the ticks from the first to before the last, by stream."""
    found = sorted((s for tick in range(first, last) for s in rover.samples(tick)), key=lambda s: (s.stream, s.seq))
    return {name.removeprefix("/mana/"): list(group) for name, group in groupby(found, key=lambda s: s.stream)}


def poses(samples: list[LogSample]) -> Any:
    return np.array([s.value.transform.matrix for s in samples])


@pytest.mark.req("CDFF-DEV-070")
def test_each_tick_gives_every_sample_once_evenly_spaced_and_counted(rover: Rover) -> None:
    stopped = taken(rover, 0, 3)
    first, last = rover.drive(np.array([[0.0, 0.0], [1.0, 0.0]]), 3)
    going = taken(rover, first, last + 2)
    assert (first, set(stopped), set(going)) == (3, {*PER_TICK, "lidar.scan"}, {*PER_TICK, "lidar.scan"})
    for stream, (count, period_ns) in (*PER_TICK.items(), ("lidar.scan", (1, 500 * MS))):
        samples = stopped[stream] + going[stream]
        assert len(samples) == count * (last + 2)
        assert [s.seq for s in samples] == list(range(len(samples)))
        assert set(np.diff([s.stamp_ns for s in samples])) == {period_ns}
        assert [s.header.seq for s in samples if s.header] == list(range(len(samples)))


def test_an_imu_at_rest_reads_gravity_and_a_bias_that_lasts_from_leg_to_leg(world: World, rover: Rover) -> None:
    before = taken(rover, 0, 24)["imu.sample"]
    T_site_base = rover.pose()
    first, last = rover.drive(np.array([[0.0, 0.0], [2.0, 0.5]]), 24)
    taken(rover, first, last)
    T_after = rover.pose()
    after = taken(rover, last, last + 24)["imu.sample"]
    R_base_imu = world.scenario.imu.mount.matrix()[:3, :3]
    up = np.array([0.0, 0.0, world.scenario.gravity_m_s2])
    biases = [
        np.mean([s.value.acc for s in samples], axis=0) - R_base_imu.T @ T[:3, :3].T @ up
        for samples, T in ((before, T_site_base), (after, T_after))
    ]
    rates = [np.mean([s.value.gyro for s in samples], axis=0) for samples in (before, after)]
    assert np.linalg.norm(biases[0]) > 1e-3
    assert biases[1] == pytest.approx(biases[0], abs=2e-3)
    assert np.linalg.norm(rates[0]) > 5e-5
    assert rates[1] == pytest.approx(rates[0], abs=2e-4)
    spread = np.std([s.value.acc for s in before], axis=0)
    assert spread == pytest.approx(world.scenario.imu.acc_noise_m_s2_sqrt_hz * np.sqrt(20.0), rel=0.4)


@pytest.mark.req("CDFF-DEV-070")
def test_wheels_count_on_from_leg_to_leg_and_are_less_sure_each_time(rover: Rover) -> None:
    samples = taken(rover, 0, 2)["wheels.odometry"]
    for way in ([[0, 0], [2, 0]], [[0, 0], [2, 1]]):
        first, last = rover.drive(np.array(way, dtype=np.float64), int(len(samples) / 5))
        samples += taken(rover, first, last + 1)["wheels.odometry"]
    T = poses(samples)
    steps = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
    assert T[0] == pytest.approx(np.eye(4), abs=1e-12)
    assert steps.max() < 0.13  # 1 m/s at 10 Hz, and slip
    assert np.linalg.norm(T[-1, :2, 3]) > 3.5
    sure = np.array([np.trace(s.value.transform.covariance[:2, :2]) for s in samples])
    assert np.diff(sure).min() > -1e-6 * sure[-1]
    assert sure[-1] > sure[len(sure) // 2] > sure[0]
    turn = np.array([s.value.transform.covariance[5, 5] for s in samples])
    assert turn[-1] > turn[0]
    tilts = {round(float(s.value.transform.covariance[3, 3]), 3) for s in samples[len(samples) // 2 :]}
    assert max(tilts) < 2.0 * 0.15**2  # counted once, not once a leg


@pytest.mark.req("CDFF-DEV-070")
def test_the_truth_goes_where_the_way_says(world: World, rover: Rover) -> None:
    taken(rover, 0, 1)
    begin = rover.pose()
    first, last = rover.drive(np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 1.0]]), 1)
    true = poses(taken(rover, first, last + 1)["truth.pose"])
    assert true[0] == pytest.approx(begin, abs=1e-6)
    c, s = begin[:2, 0] / np.linalg.norm(begin[:2, 0])
    height_m = world.scenario.chassis.base_height_m
    at = true[:, :2, 3] - height_m * true[:, :2, 2] - (begin[:2, 3] - height_m * begin[:2, 2])
    ahead = at @ np.array([[c, -s], [s, c]])
    assert ahead[-1] == pytest.approx([3.0, 1.0], abs=5e-3)
    assert np.linalg.norm(ahead - [2.0, 0.0], axis=1).min() < 0.09
    assert ahead[-5:] == pytest.approx(np.tile(ahead[-1], (5, 1)), abs=1e-6)
    assert rover.pose() == pytest.approx(true[-1], abs=1e-6)


def test_a_scan_made_while_it_stands_holds_the_ground_where_rays_meet_it(
    world: World, scene: Any, rover: Rover
) -> None:
    import open3d as o3d

    model = world.scenario.lidar
    scan = taken(rover, 0, 1)["lidar.scan"][0].value
    T_site_lidar = rover.pose() @ model.mount.matrix()
    range_m = np.linalg.norm(scan.points_m, axis=1)
    rays = np.zeros((len(range_m), 6), dtype=np.float32)
    rays[:, :3] = T_site_lidar[:3, 3]
    rays[:, 3:] = (scan.points_m / range_m[:, None]) @ T_site_lidar[:3, :3].T
    there_m = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    assert len(range_m) > 0.3 * directions(model)[..., 0].size
    assert np.median(np.abs(range_m - there_m)) < 2.0 * model.range_sigma_m
    assert np.mean(np.abs(range_m - there_m) < 5.0 * model.range_sigma_m) > 0.98


@pytest.mark.req("CDFF-DEV-070")
def test_who_drives_is_not_told_another_way_until_it_stands(rover: Rover) -> None:
    taken(rover, 0, 1)
    way = np.array([[0.0, 0.0], [1.0, 0.0]])
    first, last = rover.drive(way, 1)
    taken(rover, first, last - 1)
    with pytest.raises(ConflictError, match=r"mana drives for another 0\.5 s"):
        rover.drive(way, last - 1)
    with pytest.raises(ConflictError, match="mana drives"):
        rover.follow(last - 1)
    taken(rover, last - 1, last)
    assert rover.drive(way, last)[0] == last


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ([[0.0, 0.0]], "at least two"),
        ([], "at least two"),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "at least two"),
        ([[0.0, 0.0], [np.nan, 0.0]], "finite"),
        ([[0.0, 0.0], [0.0, 0.0]], "leads away"),
        ([[1.0, 0.0], [2.0, 0.0]], "begins at the rover"),
        ([[0.0, 0.0], [30.0, 0.0]], "the ground ends 12 m"),
        ([[0.0, 0.0], [3.0, 0.0], [0.5, 0.5]], "turns by 169 deg"),
    ],
)
def test_a_way_that_cannot_be_driven_is_refused_and_the_rover_stands(rover: Rover, way: Any, said: str) -> None:
    taken(rover, 0, 1)
    before = rover.pose()
    with pytest.raises(InputError, match=said):
        rover.drive(np.array(way), 1)
    true = poses(taken(rover, 1, 3)["truth.pose"])
    assert true == pytest.approx(np.tile(before, (len(true), 1, 1)), abs=1e-9)


def test_it_follows_the_way_of_its_scenario_but_only_from_its_begin(world: World, rover: Rover) -> None:
    taken(rover, 0, 2)
    first, last = rover.follow(2)
    true = poses(taken(rover, first, last)["truth.pose"])
    assert (first, last) == (2, 10)
    assert true == pytest.approx(world.motions["mana"].poses(np.arange(40) / 10.0), abs=1e-9)
    assert np.linalg.norm(true[-1, :2, 3] - true[0, :2, 3]) > 2.0
    with pytest.raises(ConflictError, match="mana has left the begin"):
        rover.follow(last)


@pytest.mark.req("CDFF-DEV-071")
def test_equal_orders_at_equal_ticks_give_equal_samples(world: World) -> None:
    def run() -> list[tuple[str, int, bytes]]:
        rover = Driven(world, None).rovers["mana"]
        made = taken(rover, 0, 2)
        first, last = rover.drive(np.array([[0.0, 0.0], [0.5, 0.2]]), 2)
        made |= {f"{name} driving": samples for name, samples in taken(rover, first, last + 1).items()}
        return [(s.stream, s.stamp_ns, encode(s.value, "uper")) for samples in made.values() for s in samples]

    assert run() == run()


def test_a_rate_that_does_not_fit_into_ticks_is_refused(world: World) -> None:
    wheels = world.scenario.wheels.model_copy(update={"rate_hz": 7.0})
    uneven = replace(world, scenario=world.scenario.model_copy(update={"wheels": wheels}))
    with pytest.raises(InputError, match=r"wheels\.rate_hz 7 at lidar\.rate_hz 2"):
        Driven(uneven, None)
