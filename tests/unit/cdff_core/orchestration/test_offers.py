# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Offers of products: plans and providers of each robot, or the reasons against them and the alternatives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cdff_common.interfaces.profile import load_profile
from cdff_core.orchestration.explanation import plan_with_costs
from cdff_core.orchestration.offers import describe_world, product_offers
from cdff_core.orchestration.planner import Plan, plan
from cdff_core.orchestration.world import ProviderId, SensorId, SensorState, World
from tests.support.planner_worlds import from_provider, from_sensor, provider, sensor, world

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
DEM, POSE = ProviderId("mana", "dem"), ProviderId("mana", "position")


def example() -> World:
    """Return a robot with a DEM from lidar and poses, and another robot with a pose only."""
    here = world(
        provider(
            "dem", "dem", from_sensor("scan", "lidar"), from_provider("poses", "position"),
            implementation="A", cpu=0.123456, memory_mb=12.5, ready_s=1.23456, resolution_m=0.1,
        ),
        provider("position", "pose", from_sensor("x", "wheels"), active=True, cpu=0.5),
        sensor("lidar"),
        sensor("wheels", current="on"),
    )  # fmt: skip
    other = replace(provider("position", "pose"), id=ProviderId("minnie", "position"))
    return replace(here, providers={**here.providers, other.id: other})


def test_an_offer_has_the_plan_and_the_cost_of_each_provider() -> None:
    here = example()
    (offer,) = product_offers(here, here, ["dem"], ["mana"])
    planned = plan(here, "dem", ["mana"])
    assert isinstance(planned, Plan)
    assert offer == {
        "type": "dem",
        "robot": "mana",
        "possible": True,
        "plan": plan_with_costs(planned, here),
        "by": [
            {
                "dfpc": "dem",
                "implementation": "A",
                "active": False,
                "cpu_cores": 0.1235,
                "memory_mb": 12.5,
                "ready_s": 1.235,
                "resolution_m": 0.1,
                "implementations": ["A"],
                "adjustable": {},
                "needs": ["mana/position", "mana/dem"],
                "modes": {"mana/lidar": "on", "mana/wheels": "on"},
            }
        ],
    }


def test_there_is_an_offer_for_each_product_and_robot_in_this_order() -> None:
    here = example()
    offers = product_offers(here, here, ["dem", "pose"], ["mana", "minnie"])
    named = [(o["type"], o["robot"], o["possible"], [by["dfpc"] for by in o["by"]]) for o in offers]
    assert named == [
        ("dem", "mana", True, ["dem"]),
        ("dem", "minnie", False, []),
        ("pose", "mana", True, ["position"]),
        ("pose", "minnie", True, ["position"]),
    ]


def test_an_impossible_product_has_reasons_and_the_nearest_products() -> None:
    here = example()
    _, offer = product_offers(here, here, ["dem"], ["mana", "minnie"])
    assert offer["nearest"] == ["dem of mana", "pose of minnie"]
    assert offer["why_not"]
    assert "plan" not in offer
    assert "waits_for" not in offer


def test_a_product_that_lacks_only_processes_names_those_it_waits_for() -> None:
    ideal = example()
    stopped = replace(ideal.providers[DEM], available=False, unavailable_reason="not started")
    here = replace(ideal, providers={**ideal.providers, DEM: stopped})
    (offer,) = product_offers(here, ideal, ["dem"], ["mana"])
    assert offer["possible"] is False
    assert offer["waits_for"] == ["mana/dem"]
    assert "not started" in offer["why_not"]
    assert offer["nearest"] == ["pose of mana"]
    (by,) = offer["by"]
    assert any("not started" in reason for reason in by["why_not"])
    assert "needs" not in by


def test_the_world_is_described_for_the_named_robots_only() -> None:
    name, definition = next(iter(PROFILE.robot("mana").sensors.items()))
    here = example()
    modes = dict.fromkeys(definition.modes, True)
    state = SensorState(
        SensorId("mana", name), modes, next(iter(modes)), held="x", refused={"z": "", "a": ""}
    )
    here = replace(
        here,
        sensors={state.id: state},
        free={"mana": {"memory_mb": 100.0}, "minnie": {"cpu_cores": 0.5}, "third": {"cpu_cores": 1.0}},
    )
    descriptions = {provider_id: {"dfpc": str(provider_id)} for provider_id in here.providers}
    described = describe_world(here, PROFILE, descriptions, ["mana", "minnie", "fourth"])
    assert described["left"] == {
        "mana": {"memory_mb": 100.0, "cpu_cores": None},
        "minnie": {"memory_mb": None, "cpu_cores": 0.5},
    }
    assert described["dfpcs"] == [
        {"dfpc": "mana/dem", "cpu_cores": 0.1235, "memory_mb": 12.5},
        {"dfpc": "mana/position", "cpu_cores": 0.5, "memory_mb": 0.0},
        {"dfpc": "minnie/position", "cpu_cores": 0.0, "memory_mb": 0.0},
    ]
    assert described["sensors"] == [
        {
            "robot": "mana",
            "sensor": name,
            "kind": definition.kind,
            "mode": state.current,
            "held": "x",
            "lost": "",
            "modes": sorted(modes),
            "mode_table": {key: mode.model_dump() for key, mode in definition.modes.items()},
            "refused": ["a", "z"],
            "range_m": definition.range_m,
        }
    ]
    of_minnie = describe_world(here, PROFILE, descriptions, ["minnie"])
    assert [d["dfpc"] for d in of_minnie["dfpcs"]] == ["minnie/position"]
    assert of_minnie["sensors"] == []
