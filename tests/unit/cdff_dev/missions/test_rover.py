# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated rover produces consistent samples over several paths and refuses infeasible commands."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
import pytest

from cdff_common.codecs import encode
from cdff_common.errors import ConfigurationError, ConflictError, InputError
from cdff_dev.logs import LogSample
from cdff_dev.missions.driven_log import GrowingLog
from cdff_dev.missions.rover import Rover
from cdff_dev.simulate.faults.model import Faults
from cdff_dev.simulate.lidar import directions
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.world import World

MS = 1_000_000
#: For each stream: samples per tick of 0.5 s, and their period in ns.
PER_TICK = {"imu.sample": (10, 50 * MS), "wheels.odometry": (5, 100 * MS), "truth.pose": (5, 100 * MS)}


@pytest.fixture
def rover(growing_log: GrowingLog) -> Rover:
    return growing_log.rovers["mana"]


def samples_of_ticks(rover: Rover, first: int, last: int) -> dict[str, list[LogSample]]:
    """Return the samples of the ticks from ``first`` up to ``last - 1``, by stream."""
    samples = sorted(
        (s for tick in range(first, last) for s in rover.samples(tick)), key=lambda s: (s.stream, s.seq)
    )
    return {
        name.removeprefix("/mana/"): list(group) for name, group in groupby(samples, key=lambda s: s.stream)
    }


def poses(samples: list[LogSample]) -> Any:
    return np.array([s.value.transform.matrix for s in samples])


@pytest.mark.req("CDFF-DEV-070")
def test_each_tick_gives_evenly_spaced_numbered_samples(rover: Rover) -> None:
    at_rest = samples_of_ticks(rover, 0, 3)
    first, last = rover.drive(np.array([[0.0, 0.0], [1.0, 0.0]]), 3)
    in_motion = samples_of_ticks(rover, first, last + 2)
    assert (first, set(at_rest), set(in_motion)) == (3, {*PER_TICK, "lidar.scan"}, {*PER_TICK, "lidar.scan"})
    for stream, (count, period_ns) in (*PER_TICK.items(), ("lidar.scan", (1, 500 * MS))):
        samples = at_rest[stream] + in_motion[stream]
        assert len(samples) == count * (last + 2)
        assert [s.seq for s in samples] == list(range(len(samples)))
        assert set(np.diff([s.stamp_ns for s in samples])) == {period_ns}
        assert [s.header.seq for s in samples if s.header] == list(range(len(samples)))


def test_an_imu_at_rest_measures_gravity_and_a_constant_bias(world: World, rover: Rover) -> None:
    before = samples_of_ticks(rover, 0, 24)["imu.sample"]
    T_site_base = rover.pose()
    first, last = rover.drive(np.array([[0.0, 0.0], [2.0, 0.5]]), 24)
    samples_of_ticks(rover, first, last)
    T_after = rover.pose()
    after = samples_of_ticks(rover, last, last + 24)["imu.sample"]
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
    noise = np.std([s.value.acc for s in before], axis=0)
    assert noise == pytest.approx(world.scenario.imu.acc_noise_m_s2_sqrt_hz * np.sqrt(20.0), rel=0.4)


@pytest.mark.req("CDFF-DEV-070")
def test_wheel_odometry_continues_over_legs_with_growing_covariance(rover: Rover) -> None:
    samples = samples_of_ticks(rover, 0, 2)["wheels.odometry"]
    for path in ([[0, 0], [2, 0]], [[0, 0], [2, 1]]):
        first, last = rover.drive(np.array(path, dtype=np.float64), int(len(samples) / 5))
        samples += samples_of_ticks(rover, first, last + 1)["wheels.odometry"]
    T = poses(samples)
    steps = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
    assert T[0] == pytest.approx(np.eye(4), abs=1e-12)
    assert steps.max() < 0.13  # 1 m/s at 10 Hz, and slip
    assert np.linalg.norm(T[-1, :2, 3]) > 3.5
    variance_m2 = np.array([np.trace(s.value.transform.covariance[:2, :2]) for s in samples])
    assert np.diff(variance_m2).min() > -1e-6 * variance_m2[-1]
    assert variance_m2[-1] > variance_m2[len(variance_m2) // 2] > variance_m2[0]
    yaw_variance = np.array([s.value.transform.covariance[5, 5] for s in samples])
    assert yaw_variance[-1] > yaw_variance[0]
    tilt_variances = {
        round(float(s.value.transform.covariance[3, 3]), 3) for s in samples[len(samples) // 2 :]
    }
    assert max(tilt_variances) < 2.0 * 0.15**2  # added once and not for each leg


@pytest.mark.req("CDFF-DEV-070")
def test_the_ground_truth_follows_the_path(world: World, rover: Rover) -> None:
    samples_of_ticks(rover, 0, 1)
    start = rover.pose()
    first, last = rover.drive(np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 1.0]]), 1)
    true = poses(samples_of_ticks(rover, first, last + 1)["truth.pose"])
    assert true[0] == pytest.approx(start, abs=1e-6)
    c, s = start[:2, 0] / np.linalg.norm(start[:2, 0])
    height_m = world.scenario.chassis.base_height_m
    from_start = true[:, :2, 3] - height_m * true[:, :2, 2] - (start[:2, 3] - height_m * start[:2, 2])
    path_xy = from_start @ np.array([[c, -s], [s, c]])
    assert path_xy[-1] == pytest.approx([3.0, 1.0], abs=5e-3)
    assert np.linalg.norm(path_xy - [2.0, 0.0], axis=1).min() < 0.09
    assert path_xy[-5:] == pytest.approx(np.tile(path_xy[-1], (5, 1)), abs=1e-6)
    assert rover.pose() == pytest.approx(true[-1], abs=1e-6)


def test_points_of_a_scan_at_rest_are_on_the_terrain(world: World, scene: Any, rover: Rover) -> None:
    import open3d as o3d

    model = world.scenario.lidar
    scan = samples_of_ticks(rover, 0, 1)["lidar.scan"][0].value
    T_site_lidar = rover.pose() @ model.mount.matrix()
    range_m = np.linalg.norm(scan.points_m, axis=1)
    rays = np.zeros((len(range_m), 6), dtype=np.float32)
    rays[:, :3] = T_site_lidar[:3, 3]
    rays[:, 3:] = (scan.points_m / range_m[:, None]) @ T_site_lidar[:3, :3].T
    true_range_m = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    assert len(range_m) > 0.3 * directions(model)[..., 0].size
    assert np.median(np.abs(range_m - true_range_m)) < 2.0 * model.range_sigma_m
    assert np.mean(np.abs(range_m - true_range_m) < 5.0 * model.range_sigma_m) > 0.98


@pytest.mark.req("CDFF-DEV-070")
def test_a_new_path_is_accepted_only_at_rest(rover: Rover) -> None:
    samples_of_ticks(rover, 0, 1)
    path = np.array([[0.0, 0.0], [1.0, 0.0]])
    first, last = rover.drive(path, 1)
    samples_of_ticks(rover, first, last - 1)
    with pytest.raises(ConflictError, match=r"mana drives for another 0\.5 s"):
        rover.drive(path, last - 1)
    with pytest.raises(ConflictError, match="mana drives"):
        rover.follow(last - 1)
    samples_of_ticks(rover, last - 1, last)
    assert rover.drive(path, last)[0] == last


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ([[0.0, 0.0]], "at least two"),
        ([], "at least two"),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "at least two"),
        ([[0.0, 0.0], [np.nan, 0.0]], "finite"),
        ([[0.0, 0.0], [0.0, 0.0]], "leads away"),
        ([[1.0, 0.0], [2.0, 0.0]], "starts at the rover"),
        ([[0.0, 0.0], [30.0, 0.0]], "the terrain ends 12 m"),
        ([[0.0, 0.0], [3.0, 0.0], [0.5, 0.5]], "turns by 169 deg"),
    ],
)
def test_an_infeasible_path_is_refused_and_the_rover_does_not_move(
    rover: Rover, path: Any, reason: str
) -> None:
    samples_of_ticks(rover, 0, 1)
    before = rover.pose()
    with pytest.raises(InputError, match=reason):
        rover.drive(np.array(path), 1)
    true = poses(samples_of_ticks(rover, 1, 3)["truth.pose"])
    assert true == pytest.approx(np.tile(before, (len(true), 1, 1)), abs=1e-9)


def test_the_scenario_path_is_followed_only_from_its_start(world: World, rover: Rover) -> None:
    samples_of_ticks(rover, 0, 2)
    first, last = rover.follow(2)
    true = poses(samples_of_ticks(rover, first, last)["truth.pose"])
    assert (first, last) == (2, 10)
    assert true == pytest.approx(world.motions["mana"].poses(np.arange(40) / 10.0), abs=1e-9)
    assert np.linalg.norm(true[-1, :2, 3] - true[0, :2, 3]) > 2.0
    with pytest.raises(ConflictError, match="mana has left the start"):
        rover.follow(last)


@pytest.mark.req("CDFF-DEV-071")
def test_equal_commands_at_equal_ticks_give_equal_samples(world: World) -> None:
    def run() -> list[tuple[str, int, bytes]]:
        rover = GrowingLog(world, None).rovers["mana"]
        result = samples_of_ticks(rover, 0, 2)
        first, last = rover.drive(np.array([[0.0, 0.0], [0.5, 0.2]]), 2)
        result |= {
            f"{name} driving": samples for name, samples in samples_of_ticks(rover, first, last + 1).items()
        }
        return [
            (s.stream, s.stamp_ns, encode(s.value, "uper")) for samples in result.values() for s in samples
        ]

    assert run() == run()


def test_a_rate_that_is_not_a_multiple_of_the_tick_is_refused(world: World) -> None:
    wheels = world.scenario.wheels.model_copy(update={"rate_hz": 7.0})
    uneven = replace(world, scenario=world.scenario.model_copy(update={"wheels": wheels}))
    with pytest.raises(InputError, match=r"wheels\.rate_hz 7 at lidar\.rate_hz 2"):
        GrowingLog(uneven, None)


def test_a_scenario_with_sensor_faults_is_refused(world: World, scene: Any, smoothed_relief: Relief) -> None:
    scenario = world.scenario.model_copy(update={"faults": Faults()})
    with pytest.raises(ConfigurationError, match="cdff simulate"):
        Rover(replace(world, scenario=scenario), "mana", scene, smoothed_relief)
