# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The planner's world, from a profile and descriptions."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.catalogue import Measured, maker_of, world_of
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconcile import Observed
from cdff_core.orchestration.world import MakerId, SensorId

A, B, C, OTHER = (MakerId(*x.split("/")) for x in ("mana/a", "mana/b", "mana/c", "minnie/a"))


def described(maker: MakerId) -> dict[str, Any]:
    return {
        "name": maker.dfpc, "robot": maker.robot, "implementation": "I", "inputs": [], "modes": {},
        "outputs": [{"port": "pose", "product": "pose"}], "cost": {"x": {"cpu_s": 0.1, "memory_mb": 100.0}},
    }  # fmt: skip


@pytest.mark.req("CDFF-SUP-076")
def test_what_runs_or_is_held_has_taken_its_memory_from_its_robot_s_budget() -> None:
    robots = [{"id": "mana", "limits": {"memory_mb": 350.0}}, {"id": "minnie"}]
    profile = Profile.model_validate({"name": "test", "robots": robots})
    leases = Leases()
    leases.acquire("request", [A], {})
    observed = Observed(alive={A, B, C, OTHER}, active={A, B, OTHER})
    world = world_of(profile, {m: described(m) for m in (A, B, C, OTHER)}, observed, leases, {})
    assert world.memory_free_mb == {"mana": 150.0}
    assert world.reserved == {A, B, OTHER}


def test_what_runs_has_taken_its_cpu_as_declared_for_its_rate_or_as_measured() -> None:
    lidar = {
        "kind": "lidar", "frame": "mana/lidar", "streams": {"scan": "LidarScan"}, "initial_mode": "off",
        "modes": {"off": {"on": False}, "slow": {"rate_hz": 2.0}, "fast": {"rate_hz": 10.0}},
    }  # fmt: skip
    profile = Profile.model_validate(
        {"name": "test", "robots": [{"id": "mana", "limits": {"cpu_cores": 2.0}, "sensors": {"lidar": lidar}}]}
    )
    fed = described(A) | {
        "inputs": [{"port": "scan", "optional": False, "source": "sensor/lidar/scan"}], "modes": {"lidar": "slow|fast"},
    }  # fmt: skip
    observed = Observed(alive={A}, active={A})
    world = world_of(profile, {A: fed}, observed, Leases(), {})
    assert world.makers[A].cpu == pytest.approx(1.0), "0.1 s a sample, at most 10 samples a second"
    assert world.cpu_free == {"mana": pytest.approx(1.0)}
    before = Measured.of({"samples": 100, "mean_step_cpu_s": 0.02, "last_step_s": 0.3}, None, 1.0)
    now = Measured.of({"samples": 110, "mean_step_cpu_s": 0.02, "last_step_s": 0.3}, before, 2.0)
    assert now.load == pytest.approx(0.1)
    measured = world_of(profile, {A: fed}, observed, Leases(), {}, measured={A: now})
    assert measured.cpu_free == {"mana": pytest.approx(1.9)}
    assert measured.makers[A].ready_s == 0.3
    idle = maker_of(fed, alive=True, active=False, measured=now, rates_hz={SensorId("mana", "lidar"): 10.0})
    assert idle.cpu == pytest.approx(0.2), "measured time of a sample goes before the declared one"
    with pytest.raises(InputError, match="status of a DFPC"):
        Measured.of({"samples": "many"}, None, 1.0)


def test_the_cost_is_that_of_the_implementation_that_runs() -> None:
    costs = {"I": {"cpu_s": 0.1, "memory_mb": 10.0}, "J": {"cpu_s": 0.7, "memory_mb": 90.0}}
    made = maker_of(described(A) | {"cost": costs}, alive=True, active=False)
    assert (made.cost, made.memory_mb) == (0.1, 10.0)


def test_a_sensor_is_seen_as_held_firmly_or_by_lower_priorities() -> None:
    modes = {"off": {"on": False}, "slow": {}, "fast": {}}
    wheels = {"kind": "wheels", "frame": "mana/base", "streams": {"odometry": "X"}, "modes": modes, "switch_s": 2.0}
    wheels["initial_mode"] = "off"
    profile = Profile.model_validate({"name": "test", "robots": [{"id": "mana", "sensors": {"wheels": wheels}}]})
    sensor, leases = SensorId("mana", "wheels"), Leases()
    leases.acquire("low", [], {sensor: "slow"}, priority=3)

    def seen(priority: int) -> Any:
        return world_of(profile, {}, Observed(), leases, {}, priority=priority).sensors[sensor]

    assert "kept in mode slow" in seen(3).obstacle("fast")
    assert seen(4).obstacle("fast") is None
    assert seen(4).takes_from_others("fast")
    assert not seen(4).takes_from_others("slow")
    assert seen(4).switch_s == {"off": 0.0, "slow": 2.0, "fast": 2.0}
    leases.acquire("high", [], {sensor: "fast"}, priority=7)
    assert leases.displaced("low") == {sensor: "fast"}
    assert leases.wanted_modes() == {sensor: "fast"}
    leases.release("high", 0.0)
    assert leases.displaced("low") == {}
    leases.acquire("both", [], {sensor: "fast"}, accepts={sensor: ["slow", "fast"]}, priority=3)
    assert leases.held_mode(sensor) == "slow", "one mode that serves both"
