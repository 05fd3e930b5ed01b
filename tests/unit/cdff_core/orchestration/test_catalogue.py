# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""World of the planner from a profile, descriptions, observations and leases."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.catalogue import ResourceUsage, description_of, provider_of, world_of
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import InputSource, ProviderId, SensorId, SensorState, World

A, B, C, OTHER = (ProviderId(*x.split("/")) for x in ("mana/a", "mana/b", "mana/c", "minnie/a"))


def describe(provider: ProviderId) -> dict[str, Any]:
    return {
        "name": provider.dfpc,
        "robot": provider.robot,
        "implementation": "I",
        "inputs": [],
        "modes": {},
        "outputs": [{"port": "pose", "product": "pose"}],
        "cost": {"x": {"cpu_s": 0.1, "memory_mb": 100.0}},
    }


@pytest.mark.req("CDFF-SUP-076")
def test_running_and_leased_dfpcs_use_the_memory_budget_of_their_robot() -> None:
    robots = [{"id": "mana", "limits": {"memory_mb": 350.0}}, {"id": "minnie"}]
    profile = Profile.model_validate({"name": "test", "robots": robots})
    leases = Leases()
    leases.acquire("request", [A], {})
    observed = ObservedState(alive={A, B, C, OTHER}, active={A, B, OTHER})
    world = world_of(profile, {p: describe(p) for p in (A, B, C, OTHER)}, observed, leases, {})
    assert world.free == {"mana": {"memory_mb": 150.0}}
    assert world.reserved == {A, B, OTHER}


def test_running_dfpcs_use_the_declared_or_measured_cpu() -> None:
    lidar = {
        "kind": "lidar",
        "frame": "mana/lidar",
        "streams": {"scan": "LidarScan"},
        "initial_mode": "off",
        "modes": {"off": {"on": False}, "slow": {"rate_hz": 2.0}, "fast": {"rate_hz": 10.0}},
    }
    profile = Profile.model_validate(
        {
            "name": "test",
            "robots": [{"id": "mana", "limits": {"cpu_cores": 2.0}, "sensors": {"lidar": lidar}}],
        }
    )
    with_lidar = describe(A) | {
        "inputs": [{"port": "scan", "optional": False, "source": "sensor/lidar/scan"}],
        "modes": {"lidar": "slow|fast"},
    }
    observed = ObservedState(alive={A}, active={A})
    world = world_of(profile, {A: with_lidar}, observed, Leases(), {})
    assert world.providers[A].cpu == pytest.approx(1.0), (
        "0.1 s per sample at no more than 10 samples per second"
    )
    assert world.free == {"mana": {"cpu_cores": pytest.approx(1.0)}}
    previous = ResourceUsage.of({"samples": 100, "mean_step_cpu_s": 0.02, "last_step_s": 0.3}, None, 1.0)
    current = ResourceUsage.of({"samples": 110, "mean_step_cpu_s": 0.02, "last_step_s": 0.3}, previous, 2.0)
    assert current.load == pytest.approx(0.1)
    measured = world_of(profile, {A: with_lidar}, observed, Leases(), {}, measured={A: current})
    assert measured.free == {"mana": {"cpu_cores": pytest.approx(1.9)}}
    assert measured.providers[A].ready_s == 0.3
    idle = provider_of(
        with_lidar, alive=True, active=False, measured=current, rates_hz={SensorId("mana", "lidar"): 10.0}
    )
    assert idle.cpu == pytest.approx(0.2), "the measured time per sample precedes the declared one"
    with pytest.raises(InputError, match="status of a DFPC"):
        ResourceUsage.of({"samples": "many"}, None, 1.0)


def test_a_provider_without_a_stated_cost_counts_as_one_core_in_plans_and_as_none_in_budgets() -> None:
    result = provider_of(describe(A) | {"cost": {}}, alive=True, active=False)
    assert (result.cost, result.cpu, result.memory_mb) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("performance", "expected"),
    [
        ({"sigma_m": 0.1}, Accuracy(0.1, None)),
        ({"sigma_deg": 2.0}, Accuracy(None, 2.0)),
        ({"sigma_m": 0.1, "sigma_deg": 2.0}, Accuracy(0.1, 2.0)),
        ({}, None),
    ],
)
def test_the_accuracy_of_a_provider_is_that_of_its_implementation(
    performance: dict[str, float], expected: Accuracy | None
) -> None:
    described = describe(A)
    name = described["implementation"]
    described["implementations"] = [
        {"name": f"not_{name}", "performance": {"sigma_m": 9.0}},
        {"name": name, "performance": performance},
    ]
    assert provider_of(described, alive=True, active=False).accuracy == expected


def test_the_measured_data_volume_of_an_active_dfpc_replaces_the_declared_one() -> None:
    described = describe(A) | {"data_mb_h": 5.0}
    status = {"samples": 10, "mean_step_cpu_s": 0.01}
    first = ResourceUsage.of(status, None, 1.0)
    storing = ResourceUsage.of({**status, "samples": 20, "stored_bytes": 2_000_000}, first, 3600.0)
    silent = ResourceUsage.of({**status, "samples": 20}, first, 3600.0)
    volumes_mb_h = [
        provider_of(described, alive=True, active=active, measured=measured).data_mb_h
        for active, measured in ((True, storing), (True, silent), (False, storing), (True, None))
    ]
    assert volumes_mb_h == pytest.approx([2.0, 5.0, 5.0, 5.0])


@pytest.mark.parametrize("active", [True, False])
def test_only_an_active_dfpc_has_current_sources(active: bool) -> None:
    result = provider_of(describe(A), alive=True, active=active, wired={"scan": "sensor/lidar/scan"})
    assert dict(result.wired) == ({"scan": InputSource("sensor", "mana", "lidar", "scan")} if active else {})


def test_the_cost_is_that_of_the_active_implementation() -> None:
    costs = {"I": {"cpu_s": 0.1, "memory_mb": 10.0}, "J": {"cpu_s": 0.7, "memory_mb": 90.0}}
    result = provider_of(describe(A) | {"cost": costs}, alive=True, active=False)
    assert (result.cost, result.memory_mb) == (0.1, 10.0)


def test_a_declared_cost_is_that_of_its_ports_and_a_measured_one_that_of_all_samples() -> None:
    described = describe(A) | {
        "inputs": [
            {"port": "scan", "optional": False, "source": "sensor/lidar/scan"},
            {"port": "imu", "optional": True, "source": "sensor/imu/sample"},
        ],
        "cost": {"I": {"cpu_s": 0.04, "samples": 2, "memory_mb": 1.0, "ports": ["scan"]}},
    }
    rates = {SensorId("mana", "lidar"): 10.0, SensorId("mana", "imu"): 100.0}
    declared = provider_of(described, alive=True, active=False, rates_hz=rates)
    assert declared.cpu == pytest.approx(0.02 * 10.0)
    every_port = described | {"cost": {"I": {"cpu_s": 0.04, "samples": 2, "memory_mb": 1.0}}}
    assert provider_of(every_port, alive=True, active=False, rates_hz=rates).cpu == pytest.approx(2.2)
    # A host measures the mean over the samples of all ports, so that both agree for the same rates.
    mean_s = 0.02 * 10.0 / 110.0
    status = {"samples": 1100, "mean_step_cpu_s": mean_s, "last_step_s": 0.0}
    measured = ResourceUsage.of(status, None, 1.0)
    again = provider_of(described, alive=True, active=False, rates_hz=rates, measured=measured)
    assert again.cpu == pytest.approx(declared.cpu)


def test_a_leased_sensor_can_be_taken_only_by_a_request_of_higher_priority() -> None:
    modes = {"off": {"on": False}, "slow": {}, "fast": {}}
    wheels = {
        "kind": "wheels",
        "frame": "mana/base",
        "streams": {"odometry": "X"},
        "modes": modes,
        "switch_s": 2.0,
    }
    wheels["initial_mode"] = "off"
    profile = Profile.model_validate(
        {"name": "test", "robots": [{"id": "mana", "sensors": {"wheels": wheels}}]}
    )
    sensor, leases = SensorId("mana", "wheels"), Leases()
    leases.acquire("low", [], {sensor: "slow"}, priority=3)

    def sensor_state(priority: int) -> Any:
        return world_of(profile, {}, ObservedState(), leases, {}, priority=priority).sensors[sensor]

    assert "kept in mode slow" in sensor_state(3).obstacle("fast")
    assert sensor_state(4).obstacle("fast") is None
    assert sensor_state(4).takes_from_others("fast")
    assert not sensor_state(4).takes_from_others("slow")
    refused = replace(sensor_state(4), refused={"slow": "no power", "fast": "too hot"}, current="fast")
    assert refused.obstacle("slow") == "no power"
    assert refused.obstacle("fast") is None
    assert sensor_state(4).switch_s == {"off": 0.0, "slow": 2.0, "fast": 2.0}
    leases.acquire("high", [], {sensor: "fast"}, priority=7)
    assert leases.displaced("low") == {sensor: "fast"}
    assert leases.wanted_modes() == {sensor: "fast"}
    leases.release("high", 0.0)
    assert leases.displaced("low") == {}
    leases.acquire("both", [], {sensor: "fast"}, accepts={sensor: ["slow", "fast"]}, priority=3)
    assert leases.held_mode(sensor) == "slow", "a single mode that satisfies both leases"


def test_for_a_single_acquisition_only_the_modes_that_perform_it_provide_samples() -> None:
    """A sensor without a mode for the acquisition streams as without one."""
    video = {"off": {"on": False}, "video": {"rate_hz": 5.0}}
    shot = {"acquires": 1, "parameters": {"pan_deg": {"least": -90.0, "greatest": 90.0}}}
    common = {"kind": "camera", "frame": "mana/mast", "streams": {"image": "Frame"}, "initial_mode": "off"}
    sensors = {
        "mast": common | {"modes": video | {"shot": shot}},
        "navcam": common | {"modes": video},
    }
    profile = Profile.model_validate({"name": "test", "robots": [{"id": "mana", "sensors": sensors}]})

    def modes(acquire: str | None, sensor: str) -> dict[str, bool]:
        parameters = None if acquire is None else AcquisitionParameters.parse(acquire)
        world = world_of(profile, {}, ObservedState(), Leases(), {}, acquire=parameters)
        return dict(world.sensors[SensorId("mana", sensor)].modes)

    assert modes(None, "mast") == {"off": False, "video": True, "shot": False}
    assert modes("pan_deg:30", "mast") == {"off": False, "video": False, "shot": True}
    assert modes("pan_deg:120", "mast") == modes(None, "mast"), "beyond the limits of the mode"
    assert modes("pan_deg:30", "navcam") == {"off": False, "video": True}


@pytest.mark.parametrize("is_required", [False, True])
def test_no_plan_omits_an_input_that_the_profile_requires(is_required: bool) -> None:
    """Without the detections a tracker that does not search the body itself could never start."""
    (servicer,) = load_profile("close_approach").robots
    entry = servicer.dfpc("lidar_target_tracking")
    entry = entry.model_copy(update={"required_inputs": ("detections",) if is_required else ()})
    description = description_of(servicer, entry, Registry.default().dfpc(entry.name))
    tracker = provider_of(description, alive=True, active=False)
    lidar = SensorId("servicer", "lidar")
    world = World({tracker.id: tracker}, {lidar: SensorState(lidar, {"nominal": True}, "nominal")})
    selected = plan(world, "track", ["servicer"])
    if is_required:
        assert isinstance(selected, NoPlan)
        assert "target_detection/detections" in selected.text
    else:
        assert isinstance(selected, Plan)
        assert selected.omitted_inputs == ("servicer/lidar_target_tracking.detections",)
