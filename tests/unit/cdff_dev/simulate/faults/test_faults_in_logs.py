# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults are off unless a scenario has them, repeatable, and independent of each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import validated
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.traverse import proprioceptive_entries, simulate, stamped_samples
from cdff_dev.simulate.world import World


def with_faults(world: World, **faults: Any) -> World:
    scenario = Scenario.model_validate(world.scenario.model_dump() | {"faults": faults})
    return World(scenario, world.relief, world.rocks, world.motions, world.appearance)


def entries(world: World, stream: str) -> list[Any]:
    return [e for e in proprioceptive_entries(world, "mana") if e.stream == f"/mana/{stream}"]


def test_a_scenario_without_faults_has_the_digest_that_it_had_without_the_section(world: World) -> None:
    assert "faults" not in world.scenario.model_dump(mode="json", exclude_none=True)
    assert with_faults(world).scenario.digest != world.scenario.digest


def test_an_unknown_fault_is_refused_by_name(world: World) -> None:
    data = world.scenario.model_dump() | {"faults": {"camera": {"rust": {}}}}
    with pytest.raises(ConfigurationError, match=r"faults\.camera\.rust"):
        validated(Scenario, data, "odd")


def test_a_fault_of_one_sensor_leaves_the_others_unchanged(world: World) -> None:
    faulty = with_faults(
        world, imu={"vibration": {"acc_m_s2": 1.0}}, timing={"imu": {"loss": 0.3, "offset_s": 0.02}}
    )
    for stream in ("wheels.odometry", "truth.pose"):
        plain, same = entries(world, stream), entries(faulty, stream)
        assert [e.stamp_ns for e in plain] == [e.stamp_ns for e in same]
        for a, b in zip(plain, same, strict=True):
            np.testing.assert_array_equal(a.value.transform.matrix, b.value.transform.matrix)
    assert len(entries(faulty, "imu.sample")) < len(entries(world, "imu.sample"))


def test_a_clock_moves_stamp_header_and_value_and_lost_samples_leave_gaps_in_the_sequence(
    world: World,
) -> None:
    faulty = with_faults(world, timing={"imu": {"offset_s": 0.02, "loss": 0.3}})
    samples = entries(faulty, "imu.sample")
    sequence = [e.header.seq for e in samples]
    assert sequence == sorted(set(sequence))
    assert len(sequence) < 101
    epoch_ns = world.scenario.epoch_ns
    for e in samples:
        assert e.stamp_ns - epoch_ns == e.header.seq * 10_000_000 + 20_000_000
        assert e.value.stamp_ns == e.header.t1_ns == e.stamp_ns
    with_lidar = with_faults(world, timing={"lidar": {"offset_s": -0.1}})
    assert next(stamped_samples(with_lidar.scenario, "mana", "lidar", np.zeros(1, int))) == (0, -100_000)


@pytest.mark.slow
def test_all_faults_together_give_the_same_samples_twice(world: World) -> None:
    faulty = with_faults(
        world,
        camera={
            "calibration": {"focal_sigma": 0.01},
            "rolling_shutter": {"readout_s": 0.03},
            "exposure": {"time_s": 0.01, "stops_sigma": 0.2},
            "glare": {"veil": 0.1, "hood_deg": 120.0},
            "dust": {"specks": 5, "diameter_px": [5, 10]},
        },
        lidar={
            "rings": {"range_sigma_m": 0.01},
            "mount": {"rotation_sigma_deg": 0.2},
            "beam": {"divergence_mrad": 3.0},
            "range_walk": {"rise_m": 0.2, "threshold": 0.01},
            "dust": {"returns_per_m": 0.2},
        },
        wheels={"skid": {"yaw_ratio": 1.2}, "slip": {"per_m": 0.5}, "alternation": 0.1, "delay_s": 0.1},
        imu={"vibration": {"acc_m_s2": 0.5}, "warm_up": {}, "misalignment": {"rotation_sigma_deg": 0.5}},
        timing={"navcam": {"jitter_s": 0.002}, "lidar": {"loss": 0.1}, "wheels": {"drift_ppm": 100.0}},
        body=[{"mount": {"xyz_m": [1.2, 0, 0.3]}, "size_m": [0.5, 0.1, 0.1]}],
        objects=[{"size_m": [1, 1, 1], "start_xy_m": [0, 0], "velocity_m_s": [0.2, 0]}],
    )
    runs = [list(simulate(faulty.scenario, workers=0, world=faulty)) for _ in range(2)]
    assert [e.header.id for e, _ in runs[0]] == [e.header.id for e, _ in runs[1]]
    for (entry, value), (_, again) in zip(*runs, strict=True):
        if entry.stream.endswith("navcam.pair"):
            np.testing.assert_array_equal(value.left.image, again.left.image)
        if entry.stream.endswith("lidar.scan"):
            np.testing.assert_array_equal(value.points_m, again.points_m)
