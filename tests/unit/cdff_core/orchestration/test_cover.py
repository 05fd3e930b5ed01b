# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions that are partly covered: only the rest is made, by whoever reaches it, as cheaply as enumeration finds."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest

from cdff_common.geometry.region import parse_region
from cdff_core.orchestration.cover import Cells, Cover, plan_cover
from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

ROBOTS = ("mana", "minnie", "midi")


def robot_world(costs: dict[str, float], **more: object) -> World:
    makers = [
        Maker(MakerId(r, "dem"), {"map": "dem"}, (Input("scan", (Source("sensor", r, "lidar", "scan"),)),), cost=c)
        for r, c in costs.items()
    ]
    sensors = [SensorState(SensorId(r, "lidar"), {"off": False, "on": True}, "on") for r in costs]
    return World({m.id: m for m in makers}, {s.id: s for s in sensors}, **more)  # type: ignore[arg-type]


def robots_of(made: Plan | NoPlan) -> list[str]:
    assert isinstance(made, Plan), made
    return [m.robot for m in made.order]


@pytest.mark.req("CDFF-SUP-142")
def test_the_robot_that_sees_the_rest_makes_it_though_another_is_cheaper() -> None:
    w = robot_world({"mana": 1.0, "minnie": 5.0})
    cover = Cover(wanted=0b1111, held=0b0011, least=4, reach={"mana": 0b0011, "minnie": 0b1100}, pooled=True)
    assert robots_of(plan_cover(w, "dem", ["mana", "minnie"], cover)) == ["minnie"]


def test_two_robots_make_a_half_each_where_maps_are_pooled() -> None:
    w = robot_world({"mana": 1.0, "minnie": 5.0})
    reach = {"mana": 0b0011, "minnie": 0b1100}
    both = Cover(0b1111, 0, 4, reach, pooled=True)
    assert robots_of(plan_cover(w, "dem", ["mana", "minnie"], both)) == ["mana", "minnie"]
    alone = plan_cover(w, "dem", ["mana", "minnie"], Cover(0b1111, 0, 4, reach))
    assert isinstance(alone, NoPlan)
    assert "mana can see 50% more" in alone.text
    assert "what can be made: dem of 50% of the region" in alone.text


def test_what_no_robot_can_see_in_time_is_refused_with_what_is_held() -> None:
    made = plan_cover(robot_world({"mana": 1.0}), "dem", ["mana"], Cover(0b11, 0, 1, {"mana": 0}))
    assert isinstance(made, NoPlan)
    assert "the DPM holds 0% of the region" in made.text
    assert not made.nearest


def test_a_robot_whose_reach_is_not_known_may_see_everything() -> None:
    assert robots_of(plan_cover(robot_world({"mana": 1.0}), "dem", ["mana"], Cover(0b11, 0, 2))) == ["mana"]


@pytest.mark.req("CDFF-SUP-140")
@pytest.mark.parametrize("block", range(10))
def test_generated_partial_covers_are_planned_as_cheaply_as_exhaustive_search_finds(block: int) -> None:
    for seed in range(40 * block, 40 * block + 40):
        r = random.Random(seed)
        costs = {robot: float(r.randint(1, 9)) for robot in ROBOTS[: r.randint(1, 3)]}
        free = {robot: r.choice([0.0, 10.0]) for robot in costs if r.random() < 0.2}
        w = robot_world(costs, cpu_free=free)
        makers = {m: Maker(x.id, x.outputs, x.inputs, cost=x.cost, cpu=1.0) for m, x in w.makers.items()}
        w = World(makers, w.sensors, cpu_free=free)
        wanted = r.getrandbits(8) | 1
        cover = Cover(
            wanted, r.getrandbits(8) & r.getrandbits(8), r.randint(1, wanted.bit_count()),
            {robot: r.getrandbits(8) for robot in costs if r.random() < 0.8}, pooled=r.random() < 0.6,
        )  # fmt: skip
        able = [robot for robot in costs if free.get(robot, 10.0) >= 1.0]
        best = None
        for size in range(1, (len(able) if cover.pooled else 1) + 1):
            for team in itertools.combinations(able, size):
                cells = [i for i in range(8) if wanted >> i & 1]
                seen = {i for i in cells for t in team if cover.reach.get(t, 0xFF) >> i & 1}
                old = {i for i in cells if cover.held >> i & 1}
                if seen - old and len(seen | old) >= cover.least:
                    cost = sum(costs[t] for t in team)
                    best = cost if best is None else min(best, cost)
        made = plan_cover(w, "dem", list(costs), cover)
        if best is None:
            assert isinstance(made, NoPlan), seed
            assert made.reasons, seed
        else:
            assert isinstance(made, Plan), (seed, made)
            assert made.cost == pytest.approx(best), seed


def test_cells_of_a_region_know_what_is_near_and_what_holds_points() -> None:
    cells = Cells.of(parse_region("bbox:0,0,24,12"))
    assert len(cells.centres_m) == 24 * 12
    assert cells.near((12.0, 6.0), 100.0) == cells.all
    assert cells.near((-50.0, 0.0), 10.0) == 0
    assert cells.holding(cells.centres_m) == cells.all
    left = cells.holding(np.array([[0.1, 0.1], [0.9, 0.2], [-9.0, 0.0]]))
    assert left.bit_count() == 1
    assert Cells.of(parse_region("circle:1,1,0.001")).all >= 1
    assert len(Cells.of(parse_region("bbox:0,0,4,4"), 1.5).centres_m) == 9
