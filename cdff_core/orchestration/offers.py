# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Offers of the catalogue: the providers of each product on each robot, with plans or obstacles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.explanation import plan_with_costs
from cdff_core.orchestration.planner import Plan, plan, possible_products
from cdff_core.orchestration.world import Provider, ProviderId, World


def product_offers(
    world: World, optimistic: World, products: Iterable[str], robots: Sequence[str]
) -> list[dict[str, Any]]:
    """Return one offer for each product and robot: plan and providers, or the reasons against it.

    In the ``optimistic`` world all processes run; ``waits_for`` names the missing processes. Products without
    a provider have an offer, too.
    """
    return [_offer(world, optimistic, product, robot) for product in products for robot in robots]


def _offer(world: World, optimistic: World, product: str, robot: str) -> dict[str, Any]:
    providers = sorted(
        (p for p in world.providers.values() if p.id.robot == robot and product in p.products),
        key=lambda p: p.id,
    )
    current = plan(world, product, [robot])
    entry: dict[str, Any] = {
        "type": product,
        "robot": robot,
        "possible": isinstance(current, Plan),
        "by": [_provider_offer(world, product, provider) for provider in providers],
    }
    if isinstance(current, Plan):
        return entry | {"plan": plan_with_costs(current, world)}
    if_all_run = plan(optimistic, product, [robot])
    if isinstance(if_all_run, Plan):
        entry["waits_for"] = [str(p) for p in if_all_run.order if not world.providers[p].available]
    return entry | {"why_not": current.text, "nearest": _nearest(world, product, robot)}


def _provider_offer(world: World, product: str, provider: Provider) -> dict[str, Any]:
    """Return cost and performance of a provider, and the cheapest plan with it or the reasons against it."""
    result = plan(world, product, [provider.id.robot], roots=frozenset({provider.id}))
    offer: dict[str, Any] = {
        "dfpc": provider.id.dfpc,
        "implementation": provider.implementation,
        "active": provider.active,
        "cpu_cores": round(provider.cpu, 4),
        "memory_mb": provider.memory_mb,
        "ready_s": round(provider.ready_s, 3),
        "resolution_m": provider.resolution_m,
    }
    if isinstance(result, Plan):
        return offer | {
            "needs": [str(provider_id) for provider_id in result.order],
            "modes": {str(sensor): mode for sensor, mode in result.modes.items()},
        }
    return offer | {"why_not": list(result.reasons)}


def _nearest(world: World, product: str, robot: str) -> list[str]:
    """Return available products: the same product of other robots, then other products of this robot."""
    others = sorted({provider_id.robot for provider_id in world.providers} - {robot})
    same_product = [text for text in possible_products(world, others) if text.startswith(f"{product} of ")]
    return [*same_product, *possible_products(world, [robot])]


def describe_world(
    world: World,
    profile: Profile,
    descriptions: Mapping[ProviderId, Mapping[str, Any]],
    robots: Sequence[str],
) -> dict[str, Any]:
    """Return DFPCs, sensors and remaining budgets of some robots as plain data."""
    remaining = {
        robot: {"memory_mb": world.memory_free_mb.get(robot), "cpu_cores": world.cpu_free.get(robot)}
        for robot in robots
        if robot in world.memory_free_mb or robot in world.cpu_free
    }
    dfpcs = [
        {**descriptions[provider_id], "cpu_cores": round(provider.cpu, 4), "memory_mb": provider.memory_mb}
        for provider_id, provider in sorted(world.providers.items())
        if provider_id.robot in robots
    ]
    sensors = [
        {
            "robot": state.id.robot,
            "sensor": state.id.sensor,
            "kind": sensor.kind,
            "mode": state.current,
            "held": state.held,
            "lost": state.lost,
            "modes": sorted(state.modes),
            "mode_table": {name: mode.model_dump() for name, mode in sensor.modes.items()},
            "refused": sorted(state.refused),
            "range_m": sensor.range_m,
        }
        for state in world.sensors.values()
        if state.id.robot in robots
        for sensor in [profile.robot(state.id.robot).sensors[state.id.sensor]]
    ]
    return {"dfpcs": dfpcs, "sensors": sensors, "left": remaining}
