# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Explanation of a request without its execution: the plan, its alternatives and costs, refused providers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cdff_core.orchestration.budgets import added
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.world import World


def explain(world: World, product: str, robots: Iterable[str], chosen: Plan | NoPlan) -> dict[str, Any]:
    """Return, as plain data, the plan of a request and a plan with each other provider of the product.

    ``plan`` is None if the product is unavailable; alternatives are sorted by cost, and ``refused`` lists the
    unavailable providers with the reason.
    """
    robots = tuple(robots)
    roots = {p.id for p in world.providers.values() if p.id.robot in robots and product in p.products}
    if isinstance(chosen, Plan):
        roots.discard(chosen.provider)
    results = {root: plan(world, product, robots, roots=frozenset({root})) for root in sorted(roots)}
    alternatives = [p for p in results.values() if isinstance(p, Plan)]
    return {
        "plan": plan_with_costs(chosen, world) if isinstance(chosen, Plan) else None,
        "why_not": list(chosen.reasons) if isinstance(chosen, NoPlan) else [],
        "possible": list(chosen.nearest) if isinstance(chosen, NoPlan) else [],
        "alternatives": [
            plan_with_costs(p, world) for p in sorted(alternatives, key=lambda p: (p.cost, p.provider))
        ],
        "refused": [
            {"provider": str(root), "why_not": "; ".join(p.reasons)}
            for root, p in results.items()
            if isinstance(p, NoPlan)
        ],
    }


def plan_with_costs(selected: Plan, world: World) -> dict[str, Any]:
    """Return a plan as plain data with the cost of each part.

    ``cpu_cores`` and ``memory_mb`` are declared or measured; running DFPCs add nothing. Power, heat and data
    volume include the changes of sensor modes. ``changes`` lists the current and the new mode of each sensor
    that changes its mode.
    """
    parts = [world.choice(p, selected.implementation(p)) for p in selected.order]
    inactive = [provider for provider in parts if not provider.active]
    changes = [world.sensors[s].added_needs(mode) for s, mode in selected.modes.items()]
    needs = added([*(provider.needs for provider in inactive), *changes])
    return {
        **selected.describe(),
        "parts": [
            {
                "dfpc": str(provider.id),
                "implementation": provider.implementation,
                "active": provider.active,
                "cpu_cores": provider.cpu,
                "memory_mb": provider.memory_mb,
            }
            for provider in parts
        ],
        "added_cpu_cores": round(sum(provider.cpu for provider in inactive), 6),
        "added_memory_mb": round(sum(provider.memory_mb for provider in inactive), 3),
        "added_power_w": round(needs.get("power_w", 0.0), 3),
        "energy_j": round(sum(a.energy_j for a in selected.acquisitions.values()), 3),
        "added_heat_w": round(needs.get("heat_w", 0.0), 3),
        "added_data_mb_h": round(needs.get("data_mb_h", 0.0), 3),
        "changes": {
            str(s): [world.sensors[s].current, mode]
            for s, mode in sorted(selected.modes.items())
            if world.sensors[s].current != mode
        },
    }
