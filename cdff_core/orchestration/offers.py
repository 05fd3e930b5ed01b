# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Offers of the catalogue: the providers of each product on each robot, with plans or obstacles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.explanation import plan_with_costs
from cdff_core.orchestration.planner import NoPlan, Plan, plan, possible_products
from cdff_core.orchestration.world import Provider, ProviderId, World


def product_offers(
    world: World, optimistic: World, products: Iterable[str], robots: Sequence[str]
) -> list[dict[str, Any]]:
    """Return one offer for each product and robot: plan and providers, or the reasons against it.

    In the ``optimistic`` world all processes run; ``waits_for`` names the missing processes. Products without
    a provider have an offer, too. ``nearest`` lists available products: the same product of other robots,
    then other products of the robot.
    """
    fleet = sorted({provider_id.robot for provider_id in world.providers})
    offers = []
    for product in products:
        on_robots: list[str] | None = None  # those with a plan, determined if another robot has none
        for robot in robots:
            offer = _offer(world, optimistic, product, robot)
            if not offer["possible"]:
                if on_robots is None:
                    on_robots = [r for r in fleet if f"{product} of {r}" in possible_products(world, [r])]
                others = [f"{product} of {r}" for r in on_robots if r != robot]
                offer["nearest"] = [*others, *possible_products(world, [robot])]
            offers.append(offer)
    return offers


def _offer(world: World, optimistic: World, product: str, robot: str) -> dict[str, Any]:
    """Return an offer without its ``nearest``."""
    by_id = {provider.id: provider for provider, _ in world.outputs_of(product, [robot])}
    providers = [by_id[provider_id] for provider_id in sorted(by_id)]
    current = plan(world, product, [robot])
    entry: dict[str, Any] = {
        "type": product,
        "robot": robot,
        "possible": isinstance(current, Plan),
        "by": [
            _provider_offer(
                provider, current if len(providers) == 1 else _plan_with(world, product, provider)
            )
            for provider in providers
        ],
    }
    if isinstance(current, Plan):
        return entry | {"plan": plan_with_costs(current, world)}
    if_all_run = plan(optimistic, product, [robot])
    if isinstance(if_all_run, Plan):
        entry["waits_for"] = [str(p) for p in if_all_run.order if not world.providers[p].available]
    return entry | {"why_not": current.text}


def _plan_with(world: World, product: str, provider: Provider) -> Plan | NoPlan:
    """Return the cheapest plan in which a provider provides a product, or the reasons against it."""
    return plan(world, product, [provider.id.robot], roots=frozenset({provider.id}))


def _provider_offer(provider: Provider, result: Plan | NoPlan) -> dict[str, Any]:
    """Return cost and performance of a provider, and the cheapest plan with it or the reasons against it."""
    offer: dict[str, Any] = {
        "dfpc": provider.id.dfpc,
        "implementation": provider.implementation,
        "active": provider.active,
        "cpu_cores": round(provider.cpu, 4),
        "memory_mb": provider.memory_mb,
        "ready_s": round(provider.ready_s, 3),
        "resolution_m": provider.resolution_m,
        "implementations": [choice.implementation for choice in provider.choices],
        "adjustable": {a.follows: [a.least, a.greatest] for a in provider.adjustables},
    }
    if isinstance(result, Plan):
        return offer | {
            "needs": [str(provider_id) for provider_id in result.order],
            "modes": {str(sensor): mode for sensor, mode in result.modes.items()},
        }
    return offer | {"why_not": list(result.reasons)}


def describe_world(
    world: World,
    profile: Profile,
    descriptions: Mapping[ProviderId, Mapping[str, Any]],
    robots: Sequence[str],
) -> dict[str, Any]:
    """Return DFPCs, sensors and remaining budgets of some robots as plain data."""
    selected, sensors_of = frozenset(robots), {robot.id: robot.sensors for robot in profile.robots}
    unlimited: dict[str, float | None] = {"memory_mb": None, "cpu_cores": None}
    remaining = {robot: {**unlimited, **world.free[robot]} for robot in robots if robot in world.free}
    dfpcs = [
        {**descriptions[provider_id], "cpu_cores": round(provider.cpu, 4), "memory_mb": provider.memory_mb}
        for provider_id, provider in sorted(world.providers.items())
        if provider_id.robot in selected
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
        if state.id.robot in selected
        for sensor in [sensors_of[state.id.robot][state.id.sensor]]
    ]
    return {"dfpcs": dfpcs, "sensors": sensors, "left": remaining}
