# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What would be done, what else could be, and why not."""

from __future__ import annotations

import pytest

from cdff_core.orchestration.explain import explain
from cdff_core.orchestration.planner import MODE_COST, NoPlan, Plan, plan
from tests.unit.cdff_core.orchestration.test_planner import (
    from_maker,
    from_sensor,
    maker,
    names,
    random_world,
    sensor,
    world,
)

WORLD = world(
    maker("cheap", "pose", from_sensor("x", "lidar"), cost=1.0, memory_mb=10.0),
    maker("dear", "pose", from_maker("x", "feeder"), cost=2.0, cpu=2.0, memory_mb=20.0),
    maker("feeder", None, from_sensor("x", "lidar"), cost=3.0, memory_mb=5.0, active=True),
    maker("dead", "pose", from_sensor("x", "lidar"), available=False, why_not="it crashed"),
    sensor("lidar"),
)


@pytest.mark.req("CDFF-SUP-070")
def test_the_plan_its_alternatives_and_who_cannot_are_told_cheapest_first() -> None:
    told = explain(WORLD, "pose", ["mana"])
    assert names(told.chosen) == ["cheap"]
    assert [names(p) for p in told.alternatives] == [["feeder", "dear"]]
    body = told.describe(WORLD)
    assert body["refused"] == [{"maker": "mana/dead", "why_not": "mana/dead is not available: it crashed"}]
    assert body["plan"]["changes"] == {"mana/lidar": ["off", "on"]}
    assert body["plan"]["cost"] == pytest.approx(1.0 + MODE_COST)


def test_what_runs_already_adds_nothing_to_the_cost_told() -> None:
    (other,) = explain(WORLD, "pose", ["mana"]).describe(WORLD)["alternatives"]
    assert (other["added_cpu_cores"], other["added_memory_mb"]) == (2.0, 20.0)
    assert [p["active"] for p in other["parts"]] == [True, False]


def test_what_cannot_be_made_is_told_with_the_reasons_and_what_can_be() -> None:
    body = explain(WORLD, "dem", ["mana"]).describe(WORLD)
    assert body["plan"] is None
    assert "makes dem" in body["why_not"][0]
    assert body["possible"] == ["pose of mana"]


def test_in_generated_worlds_every_maker_is_the_plan_an_alternative_or_refused_with_a_reason() -> None:
    for seed in range(200):
        w = random_world(seed)
        told = explain(w, "dem", ["mana"])
        assert told.chosen == plan(w, "dem", ["mana"]), seed
        roots = {m.id for m in w.makers.values() if "dem" in m.products}
        chosen = {told.chosen.maker} if isinstance(told.chosen, Plan) else set()
        assert chosen | {p.maker for p in told.alternatives} | set(told.refused or {}) == roots, seed
        assert all((told.refused or {}).values()), seed
        if isinstance(told.chosen, NoPlan):
            assert not told.alternatives, seed
        else:
            assert all(p.cost >= told.chosen.cost for p in told.alternatives), seed
