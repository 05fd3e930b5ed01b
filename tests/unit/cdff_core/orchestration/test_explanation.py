# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Explanations of requests: the plan, its alternatives and the refused providers."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_core.orchestration.explanation import explain
from cdff_core.orchestration.planner import MODE_COST, plan
from cdff_core.orchestration.world import World
from tests.support.planner_worlds import (
    from_provider,
    from_sensor,
    provider,
    random_world,
    sensor,
    world,
)

WORLD = world(
    provider("cheap", "pose", from_sensor("x", "lidar"), cost=1.0, memory_mb=10.0),
    provider("costly", "pose", from_provider("x", "feeder"), cost=2.0, cpu=2.0, memory_mb=20.0),
    provider("feeder", None, from_sensor("x", "lidar"), cost=3.0, memory_mb=5.0, active=True),
    provider("dead", "pose", from_sensor("x", "lidar"), available=False, unavailable_reason="it crashed"),
    sensor("lidar"),
)


def explanation_of(world: World, product: str) -> dict[str, Any]:
    return explain(world, product, ["mana"], plan(world, product, ["mana"]))


@pytest.mark.req("CDFF-SUP-070")
def test_the_plan_its_alternatives_and_refused_providers_are_reported_cheapest_first() -> None:
    body = explanation_of(WORLD, "pose")
    assert body["plan"]["order"] == ["mana/cheap"]
    assert [p["order"] for p in body["alternatives"]] == [["mana/feeder", "mana/costly"]]
    assert body["refused"] == [{"provider": "mana/dead", "why_not": "mana/dead is not available: it crashed"}]
    assert body["plan"]["changes"] == {"mana/lidar": ["off", "on"]}
    assert body["plan"]["cost"] == pytest.approx(1.0 + MODE_COST)


def test_running_dfpcs_add_nothing_to_the_reported_cost() -> None:
    (alternative,) = explanation_of(WORLD, "pose")["alternatives"]
    assert (alternative["added_cpu_cores"], alternative["added_memory_mb"]) == (2.0, 20.0)
    assert [p["active"] for p in alternative["parts"]] == [True, False]


def test_costs_are_rounded_to_a_microcore_and_a_kilobyte_and_unchanged_sensors_are_not_listed() -> None:
    w = world(
        provider(
            "a", "pose", from_sensor("x", "lidar"), from_sensor("y", "imu"), cpu=0.12345678, memory_mb=1.23456
        ),
        sensor("lidar", current="on"),
        sensor("imu"),
    )
    selected = explanation_of(w, "pose")["plan"]
    assert (selected["added_cpu_cores"], selected["added_memory_mb"]) == (0.123457, 1.235)
    assert (selected["parts"][0]["cpu_cores"], selected["parts"][0]["memory_mb"]) == (0.12345678, 1.23456)
    assert selected["changes"] == {"mana/imu": ["off", "on"]}


def test_a_product_without_provider_is_reported_with_reasons_and_available_types() -> None:
    body = explanation_of(WORLD, "dem")
    assert body["plan"] is None
    assert "provides dem" in body["why_not"][0]
    assert body["possible"] == ["pose of mana"]


def test_in_generated_worlds_every_provider_is_planned_alternative_or_refused_with_a_reason() -> None:
    for seed in range(200):
        w = random_world(seed)
        body = explanation_of(w, "dem")
        roots = {str(m.id) for m in w.providers.values() if "dem" in m.products}
        chosen = {body["plan"]["provider"]} if body["plan"] else set()
        alternatives = {p["provider"] for p in body["alternatives"]}
        assert chosen | alternatives | {r["provider"] for r in body["refused"]} == roots, seed
        assert all(r["why_not"] for r in body["refused"]), seed
        if body["plan"]:
            assert all(p["cost"] >= body["plan"]["cost"] for p in body["alternatives"]), seed
        else:
            assert not alternatives, seed
