# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plans that cover the missing part of a region: their cost equals that of an enumeration."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest

from cdff_common.geometry.region import parse_region
from cdff_core.orchestration.coverage import RegionCells, RegionCoverage, plan_coverage
from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)

ROBOTS = ("mana", "minnie", "midi")


def robot_world(costs: dict[str, float], **fields: object) -> World:
    providers = [
        Provider(
            ProviderId(r, "dem"),
            {"map": "dem"},
            (Input("scan", (InputSource("sensor", r, "lidar", "scan"),)),),
            cost=c,
        )
        for r, c in costs.items()
    ]
    sensors = [SensorState(SensorId(r, "lidar"), {"off": False, "on": True}, "on") for r in costs]
    return World({p.id: p for p in providers}, {s.id: s for s in sensors}, **fields)  # type: ignore[arg-type]


def robots_of(result: Plan | NoPlan) -> list[str]:
    assert isinstance(result, Plan), result
    return [provider.robot for provider in result.order]


@pytest.mark.req("CDFF-SUP-142")
def test_the_robot_that_covers_the_remaining_region_is_selected_even_if_more_expensive() -> None:
    w = robot_world({"mana": 1.0, "minnie": 5.0})
    coverage = RegionCoverage(
        requested=0b1111,
        stored=0b0011,
        required_count=4,
        reach={"mana": 0b0011, "minnie": 0b1100},
        pooled=True,
    )
    assert robots_of(plan_coverage(w, "dem", ["mana", "minnie"], coverage)) == ["minnie"]


def test_two_robots_observe_one_half_each_if_their_maps_can_be_fused() -> None:
    w = robot_world({"mana": 1.0, "minnie": 5.0})
    reach = {"mana": 0b0011, "minnie": 0b1100}
    both = RegionCoverage(0b1111, 0, 4, reach, pooled=True)
    assert robots_of(plan_coverage(w, "dem", ["mana", "minnie"], both)) == ["mana", "minnie"]
    alone = plan_coverage(w, "dem", ["mana", "minnie"], RegionCoverage(0b1111, 0, 4, reach))
    assert isinstance(alone, NoPlan)
    assert "mana can observe 50% more" in alone.text
    assert "available: dem of 50% of the region" in alone.text


def test_a_region_that_no_robot_can_observe_in_time_is_refused_with_the_stored_coverage() -> None:
    planned = plan_coverage(
        robot_world({"mana": 1.0}), "dem", ["mana"], RegionCoverage(0b11, 0, 1, {"mana": 0})
    )
    assert isinstance(planned, NoPlan)
    assert "the DPM holds 0% of the region" in planned.text
    assert not planned.nearest


def test_a_robot_of_unknown_range_may_observe_everything() -> None:
    assert robots_of(
        plan_coverage(robot_world({"mana": 1.0}), "dem", ["mana"], RegionCoverage(0b11, 0, 2))
    ) == ["mana"]


@pytest.mark.req("CDFF-SUP-140")
@pytest.mark.parametrize("block", range(10))
def test_generated_partial_coverages_are_planned_at_the_optimal_cost(block: int) -> None:
    for seed in range(40 * block, 40 * block + 40):
        r = random.Random(seed)
        costs = {robot: float(r.randint(1, 9)) for robot in ROBOTS[: r.randint(1, 3)]}
        free = {robot: {"cpu_cores": r.choice([0.0, 10.0])} for robot in costs if r.random() < 0.2}
        w = robot_world(costs, free=free)
        providers = {  # each needs one core
            id_: Provider(p.id, p.outputs, p.inputs, cost=p.cost, cpu=1.0) for id_, p in w.providers.items()
        }
        w = World(providers, w.sensors, free=free)
        requested = r.getrandbits(8) | 1
        coverage = RegionCoverage(
            requested,
            r.getrandbits(8) & r.getrandbits(8),
            r.randint(1, requested.bit_count()),
            {robot: r.getrandbits(8) for robot in costs if r.random() < 0.8},
            pooled=r.random() < 0.6,
        )
        able = [robot for robot in costs if free.get(robot, {}).get("cpu_cores", 10.0) >= 1.0]
        best = None
        for size in range(1, (len(able) if coverage.pooled else 1) + 1):
            for team in itertools.combinations(able, size):
                cells = [i for i in range(8) if requested >> i & 1]
                observable = {i for i in cells for t in team if coverage.reach.get(t, 0xFF) >> i & 1}
                stored = {i for i in cells if coverage.stored >> i & 1}
                if observable - stored and len(observable | stored) >= coverage.required_count:
                    cost = sum(costs[t] for t in team)
                    best = cost if best is None else min(best, cost)
        planned = plan_coverage(w, "dem", list(costs), coverage)
        if best is None:
            assert isinstance(planned, NoPlan), seed
            assert planned.reasons, seed
        else:
            assert isinstance(planned, Plan), (seed, planned)
            assert planned.cost == pytest.approx(best), seed


def test_cells_near_a_point_or_containing_points_are_returned_as_bits() -> None:
    cells = RegionCells.of(parse_region("bbox:0,0,24,12"))
    assert len(cells.centres_m) == 24 * 12
    assert cells.near((12.0, 6.0), 100.0) == cells.all
    assert cells.near((-50.0, 0.0), 10.0) == 0
    assert cells.containing(cells.centres_m) == cells.all
    left = cells.containing(np.array([[0.1, 0.1], [0.9, 0.2], [-9.0, 0.0]]))
    assert left.bit_count() == 1
    assert RegionCells.of(parse_region("circle:1,1,0.001")).all >= 1
    assert len(RegionCells.of(parse_region("bbox:0,0,4,4"), 1.5).centres_m) == 9
