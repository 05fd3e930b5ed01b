# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Explanation of a request: the plan, its alternatives and costs, and refused providers; nothing is run."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.world import World


def explain(world: World, product: str, robots: Iterable[str], chosen: Plan | NoPlan) -> dict[str, Any]:
    """Return the plan of a request, and plans with each other provider of the product, as plain data.

    ``plan`` is None if the product is unavailable; alternatives are sorted by cost, and ``refused`` lists the
    unavailable providers with the reason.
    """
    robots = tuple(robots)
    roots = {m.id for m in world.providers.values() if m.id.robot in robots and product in m.products}
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

    ``cpu_cores`` and ``memory_mb`` are declared or measured; running DFPCs add nothing. ``changes`` lists the
    sensors with a mode change: current and new mode.
    """
    parts = [world.providers[m] for m in selected.order]
    new = [m for m in parts if not m.active]
    return {
        **selected.describe(),
        "parts": [
            {
                "dfpc": str(m.id),
                "implementation": m.implementation,
                "active": m.active,
                "cpu_cores": m.cpu,
                "memory_mb": m.memory_mb,
            }
            for m in parts
        ],
        "added_cpu_cores": round(sum(m.cpu for m in new), 6),
        "added_memory_mb": round(sum(m.memory_mb for m in new), 3),
        "changes": {
            str(s): [world.sensors[s].current, mode]
            for s, mode in sorted(selected.modes.items())
            if world.sensors[s].current != mode
        },
    }
