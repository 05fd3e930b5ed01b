# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The catalogue's answer to "what could you give me, and why not that?": per product and robot, every way to it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.explain import costed
from cdff_core.orchestration.planner import Plan, plan, possible_products
from cdff_core.orchestration.world import Maker, MakerId, World


def offers(world: World, hopeful: World, products: Iterable[str], robots: Sequence[str]) -> list[dict[str, Any]]:
    """Say for each product of each robot whether it can be made, how, by what else, and why not otherwise.

    Parameters
    ----------
    world : World
        As it is.
    hopeful : World
        As it would be with every known process there: what only waits for one says so in ``waits_for``.
    products, robots
        What is asked about; a product that no DFPC of a robot has is there too, with that reason.
    """
    return [_offer(world, hopeful, product, robot) for product in products for robot in robots]


def _offer(world: World, hopeful: World, product: str, robot: str) -> dict[str, Any]:
    makers = sorted((m for m in world.makers.values() if m.id.robot == robot and product in m.products), key=_name)
    found = plan(world, product, [robot])
    entry: dict[str, Any] = {
        "type": product,
        "robot": robot,
        "possible": isinstance(found, Plan),
        "by": [_way(world, product, maker) for maker in makers],
    }
    if isinstance(found, Plan):
        return entry | {"plan": costed(found, world)}
    later = plan(hopeful, product, [robot])
    if isinstance(later, Plan):
        entry["waits_for"] = [str(m) for m in later.order if not world.makers[m].available]
    return entry | {"why_not": found.text, "nearest": _nearest(world, product, robot)}


def _way(world: World, product: str, maker: Maker) -> dict[str, Any]:
    """One maker of a product: what it costs and achieves, and the cheapest plan with it or why there is none."""
    made = plan(world, product, [maker.id.robot], roots=frozenset({maker.id}))
    way: dict[str, Any] = {
        "dfpc": maker.id.dfpc,
        "implementation": maker.implementation,
        "active": maker.active,
        "cpu_cores": round(maker.cpu, 4),
        "memory_mb": maker.memory_mb,
        "ready_s": round(maker.ready_s, 3),
        "resolution_m": maker.resolution_m,
    }
    if isinstance(made, Plan):
        return way | {"needs": [str(m) for m in made.order], "modes": {str(s): m for s, m in made.modes.items()}}
    return way | {"why_not": list(made.reasons)}


def _nearest(world: World, product: str, robot: str) -> list[str]:
    """What can be made instead: the same product of other robots first, then other products of this one."""
    others = sorted({m.robot for m in world.makers} - {robot})
    same = [text for text in possible_products(world, others) if text.startswith(f"{product} of ")]
    return [*same, *possible_products(world, [robot])]


def _name(maker: Maker) -> MakerId:
    return maker.id


def describe_world(
    world: World, profile: Profile, descriptions: Mapping[MakerId, Mapping[str, Any]], robots: Sequence[str]
) -> dict[str, Any]:
    """DFPCs and sensors of some robots, as plain data."""
    left = {
        robot: {"memory_mb": world.memory_free_mb.get(robot), "cpu_cores": world.cpu_free.get(robot)}
        for robot in robots
        if robot in world.memory_free_mb or robot in world.cpu_free
    }
    dfpcs = [
        {**descriptions[m], "cpu_cores": round(maker.cpu, 4), "memory_mb": maker.memory_mb}
        for m, maker in sorted(world.makers.items())
        if m.robot in robots
    ]
    sensors = [
        {
            "robot": s.id.robot,
            "sensor": s.id.sensor,
            "kind": profile.robot(s.id.robot).sensors[s.id.sensor].kind,
            "mode": s.current,
            "held": s.held,
            "lost": s.lost,
            "modes": sorted(s.modes),
            "mode_table": {
                name: mode.model_dump() for name, mode in profile.robot(s.id.robot).sensors[s.id.sensor].modes.items()
            },
            "refused": sorted(s.refused),
            "range_m": profile.robot(s.id.robot).sensors[s.id.sensor].range_m,
        }
        for s in world.sensors.values()
        if s.id.robot in robots
    ]
    return {"dfpcs": dfpcs, "sensors": sensors, "left": left}
