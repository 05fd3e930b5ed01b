# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What would be done for a request, what else could be, what each would cost, and why not: nothing is run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from cdff_core.orchestration.cover import Cover, plan_cover
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.world import MakerId, World


@dataclass(frozen=True, slots=True)
class Explanation:
    """Every way to a product, best first.

    Attributes
    ----------
    chosen : Plan or NoPlan
        What a request would get now.
    alternatives : tuple of Plan
        The cheapest plan of each other maker of the product, cheapest first.
    refused : mapping of MakerId to str
        Makers of the product that cannot make it now, and why not.
    """

    chosen: Plan | NoPlan
    alternatives: tuple[Plan, ...] = ()
    refused: Mapping[MakerId, str] | None = None

    def describe(self, world: World) -> dict[str, Any]:
        """Plain data for an answer; ``plan`` is None where nothing can make the product."""
        chosen = self.chosen
        return {
            "plan": costed(chosen, world) if isinstance(chosen, Plan) else None,
            "why_not": list(chosen.reasons) if isinstance(chosen, NoPlan) else [],
            "possible": list(chosen.nearest) if isinstance(chosen, NoPlan) else [],
            "alternatives": [costed(p, world) for p in self.alternatives],
            "refused": [{"maker": str(m), "why_not": why} for m, why in sorted((self.refused or {}).items())],
        }


def explain(
    world: World,
    product: str,
    robots: Iterable[str],
    cover: Cover | None = None,
    chosen: Plan | NoPlan | None = None,
) -> Explanation:
    """Plan for ``product`` once as a request would, and once with each maker of it as the only one.

    Parameters
    ----------
    world : World
    product : str
        ``pose``, ``dem``, … (contract §5).
    robots : iterable of str
        Robots whose product would do.
    cover : Cover, optional
        Where a region is asked: what of it is held, and who sees the rest.
    chosen : Plan or NoPlan, optional
        What a request would get, where more than the product decides it.
    """
    robots = tuple(robots)
    roots = sorted(m.id for m in world.makers.values() if m.id.robot in robots and product in m.products)
    if chosen is None:
        chosen = plan(world, product, robots) if cover is None else plan_cover(world, product, robots, cover)
    alternatives: list[Plan] = []
    refused: dict[MakerId, str] = {}
    for root in roots:
        if isinstance(chosen, Plan) and root == chosen.maker:
            continue
        made = plan(world, product, robots, roots=frozenset({root}))
        if isinstance(made, Plan):
            alternatives.append(made)
        else:
            refused[root] = "; ".join(made.reasons)
    alternatives.sort(key=lambda p: (p.cost, p.maker))
    return Explanation(chosen, tuple(alternatives), refused)


def costed(made: Plan, world: World) -> dict[str, Any]:
    """A plan as plain data, with what each of its parts costs.

    ``cpu_cores`` and ``memory_mb`` are what the DFPCs declare or were measured to take; one that runs already adds
    nothing. ``changes`` are sensors that have to change their mode, from and to.
    """
    parts = [world.makers[m] for m in made.order]
    new = [m for m in parts if not m.active]
    return {
        **made.describe(),
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
            for s, mode in sorted(made.modes.items())
            if world.sensors[s].current != mode
        },
    }
