# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for the cheapest set of DFPCs and sensor modes that provides a product.

A plan is *sound* if

* one of its providers has the product;
* every mandatory input has a source (a sensor in a streaming mode, a provider of the plan or a stored
  product), and each provider with inputs wired in the profile has a source for at least one of them;
* each sensor is in one mode that serves all providers of the plan and all holders of at least the priority
  of the request;
* there is no loop, and no robot exceeds a budget (memory, CPU, power, heat, data volume).

Where the profile admits several implementations of a DFPC, the plan selects one.

The cost of a plan is the sum of the costs of the providers that do not run yet, ``MODE_COST`` for each mode
change, ``TAKE_COST`` for each sensor or provider taken from requests of lower priority, ``REWIRE_COST`` for
each changed source of a running provider, and ``OMITTED_INPUT_COST`` for each wired optional input that the
plan omits.

The search is depth first over the unconnected inputs, cheapest source first. A branch is pruned once its cost
reaches that of the best plan, or the cost on the path from the product to an input plus a lower bound of the
cost upstream of this input does: a plan has no loops, so that these providers are different and their costs
add up. The mode of a sensor is selected at the end: each provider restricts the acceptable modes, and the
cost of the cheapest of them is a lower bound. The search is exact; tests compare it with enumeration.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import TopologicalSorter
from operator import itemgetter
from typing import TypeAlias

from cdff_common.contract.wiring import mode_names
from cdff_core.orchestration.budgets import BUDGET_UNITS, Amounts, added, excess, excess_fraction
from cdff_core.orchestration.plans import NoPlan as NoPlan
from cdff_core.orchestration.plans import Plan as Plan
from cdff_core.orchestration.plans import combine_plans as combine_plans
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)

MODE_COST = 0.5
TAKE_COST = 50.0
REWIRE_COST = 1.0
OMITTED_INPUT_COST = 100.0
#: Largest number of combinations of sensor modes that are compared with the budgets of a robot.
_MAX_MODES = 1024
#: A provider, or one implementation of it.
Root: TypeAlias = "ProviderId | tuple[ProviderId, str]"
#: Maximum number of search steps, after which the best plan so far is returned; 100 DFPCs need fewer.
MAX_STEPS = 20_000


#: Combination of modes in a queue: cost, excess of the budgets, order of equal ones, needs by budget.
_Combination: TypeAlias = "tuple[float, float, tuple[int, ...], dict[str, float]]"


@dataclass(slots=True)
class _PartialPlan:
    """A partial plan during the search.

    ``accepts`` holds the acceptable modes of each sensor, cheapest first; ``cost`` includes the cheapest one.
    ``path_cost`` is the cost of the providers on the path from the product to a provider, including this one,
    ``connected`` the number of its connected inputs, ``used`` the allocated part of each budget by robot.
    """

    providers: dict[ProviderId, Provider] = field(default_factory=dict)
    upstream: dict[ProviderId, frozenset[ProviderId]] = field(default_factory=dict)
    chosen_sources: dict[ProviderId, dict[str, str]] = field(default_factory=dict)
    path_cost: dict[ProviderId, float] = field(default_factory=dict)
    accepts: dict[SensorId, tuple[str, ...]] = field(default_factory=dict)
    connected: dict[ProviderId, int] = field(default_factory=dict)
    omitted_inputs: tuple[str, ...] = ()
    cost: float = 0.0
    used: dict[str, dict[str, float]] = field(default_factory=dict)

    def copy(self) -> _PartialPlan:
        return _PartialPlan(
            dict(self.providers),
            dict(self.upstream),
            dict(self.chosen_sources),
            dict(self.path_cost),
            dict(self.accepts),
            dict(self.connected),
            self.omitted_inputs,
            self.cost,
            dict(self.used),
        )

    def depends(self, on: ProviderId, provider: ProviderId) -> bool:
        """Return whether ``provider`` is ``on`` or upstream of it."""
        stack, visited = [on], set()
        while stack:
            current = stack.pop()
            if current == provider:
                return True
            if current not in visited:
                visited.add(current)
                stack.extend(self.upstream.get(current, ()))
        return False


def mode_cost(sensor: SensorState, mode: str) -> float:
    """Return the cost of using a sensor in a mode."""
    return MODE_COST * (mode != sensor.current) + TAKE_COST * sensor.takes_from_others(mode)


class _LowerBound:
    """Lower bound of the cost of a provider and its upstream: the cost along its most expensive input chain.

    In a loop, a provider that is being evaluated counts 0, so that the result remains a lower bound.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._bounds: dict[ProviderId, float] = {}

    def of_provider(self, provider_id: ProviderId) -> float:
        cached_bound = self._bounds.get(provider_id)
        if cached_bound is not None:
            return cached_bound
        provider = self._world.providers.get(provider_id)
        bound = math.inf
        if provider is not None and provider.available:
            self._bounds[provider_id] = 0.0
            upstream_bound = max((self.of_input(port) for port in provider.inputs), default=0.0)
            bound = upstream_bound + min(0.0 if c.active else c.cost for c in provider.choices)
        self._bounds[provider_id] = bound
        return bound

    def of_input(self, port: Input) -> float:
        if not port.sources:
            return 0.0 if port.optional else math.inf
        lowest = min(self.of_source(source) for source in port.sources)
        return min(lowest, OMITTED_INPUT_COST) if port.optional else lowest

    def of_source(self, source: InputSource) -> float:
        return self.of_provider(ProviderId(source.robot, source.owner)) if source.kind == "product" else 0.0


class _Search:
    """Depth-first search with the best plan so far, and the reasons why partial plans were refused."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.best: _PartialPlan | None = None
        self.best_root: tuple[ProviderId, str] | None = None
        self.reasons: dict[str, None] = {}
        self.steps = 0
        self.lower_bound = _LowerBound(world)

    def search_root(self, provider: Provider, port: str) -> None:
        """Search the plans in which an output port of a provider provides the product."""
        state = _PartialPlan()
        todo: list[tuple[ProviderId, Input]] = []
        if self.best is not None and self.lower_bound.of_provider(provider.id) >= self.best.cost:
            return
        if self._add_provider(state, todo, provider):
            state.path_cost[provider.id] = state.cost
            self._extend(state, todo, (provider.id, port))

    def _extend(
        self, state: _PartialPlan, todo: list[tuple[ProviderId, Input]], root: tuple[ProviderId, str]
    ) -> None:
        """Search all complete plans that extend a partial plan; ``todo`` are its unconnected inputs."""
        self.steps += 1
        if self.steps > MAX_STEPS or (self.best is not None and state.cost >= self.best.cost):
            return
        if not todo:
            self._finish(state, root)
            return
        (owner, port), remaining = todo[0], todo[1:]
        if (
            self.best is not None
            and state.path_cost[owner] + self.lower_bound.of_input(port) >= self.best.cost
        ):
            return
        for source in (
            sorted(port.sources, key=self.lower_bound.of_source) if len(port.sources) > 1 else port.sources
        ):
            for next_state, next_todo in self._connect(state, remaining, owner, port.port, source):
                self._extend(next_state, next_todo, root)
        if port.optional:
            skipped = state.copy()
            if port.sources:
                skipped.cost += OMITTED_INPUT_COST
                skipped.omitted_inputs = (*skipped.omitted_inputs, f"{owner}.{port.port}")
            self._extend(skipped, remaining, root)
        elif not port.sources:
            self.reasons[f"input {port.port} of {owner} is not wired"] = None

    def _finish(self, state: _PartialPlan, root: tuple[ProviderId, str]) -> None:
        """Keep a complete plan if it is sound and cheaper than the best one."""
        state = state.copy()
        unconnected = next(
            (p for p in state.providers.values() if state.connected[p.id] == 0 and _is_wired(p)), None
        )
        if unconnected is not None:
            self.reasons[f"none of the inputs of {unconnected.id} can be connected"] = None
        elif self._select_modes(state) and (self.best is None or state.cost < self.best.cost):
            self.best, self.best_root = state, root

    def _select_modes(self, state: _PartialPlan) -> bool:
        """Put the cheapest modes within the budgets first; return False if no modes are."""
        for robot, free in self.world.free.items():
            sensors = [s for s in state.accepts if s.robot == robot and self.world.sensors[s].needs]
            if not sensors:
                continue
            modes = self._cheapest_modes(state, robot, sensors, free)
            if modes is None:
                return False
            first = [state.accepts[s][0] for s in sensors]
            state.cost += self._modes_cost(sensors, modes) - self._modes_cost(sensors, first)
            for sensor, mode in zip(sensors, modes, strict=True):
                others = (m for m in state.accepts[sensor] if m != mode)
                state.accepts[sensor] = (mode, *others)
        return True

    def _cheapest_modes(
        self, state: _PartialPlan, robot: str, sensors: Sequence[SensorId], free: Amounts
    ) -> tuple[str, ...] | None:
        """Return the cheapest modes of the sensors of a robot within its budgets; None, with the reason, if
        there are none.

        At most ``_MAX_MODES`` combinations are compared: cheaper ones first, of equal costs those that exceed
        the budgets less.
        """
        used = state.used.get(robot, {})
        costs = [[(mode_cost(self.world.sensors[s], m), m) for m in state.accepts[s]] for s in sensors]
        options = [sorted(modes, key=itemgetter(0)) for modes in costs]

        def entry(indices: tuple[int, ...]) -> _Combination:
            chosen = [modes[i] for modes, i in zip(options, indices, strict=True)]
            changes = [
                self.world.sensors[s].added_needs(m) for s, (_, m) in zip(sensors, chosen, strict=True)
            ]
            needed = added([used, *changes])
            order = tuple(-i for i in indices)
            return sum(cost for cost, _ in chosen), excess_fraction(needed, free), order, needed

        queue = [entry((0,) * len(sensors))]
        reason = ""
        for _ in range(_MAX_MODES):
            if not queue:
                break
            _, _, order, needed = heapq.heappop(queue)
            indices = tuple(-i for i in order)
            names = tuple(modes[i][1] for modes, i in zip(options, indices, strict=True))
            over = excess(needed, free)
            if over is None:
                return names
            chosen = ", ".join(f"{s} {m}" for s, m in zip(sensors, names, strict=True))
            reason = reason or f"modes {chosen} do not fit: {_excess_text(over, robot)}"
            # Each combination follows exactly one other: that with its last changed index reduced by one.
            for k in range(max((k for k, i in enumerate(indices) if i), default=0), len(sensors)):
                if indices[k] + 1 < len(options[k]):
                    heapq.heappush(queue, entry((*indices[:k], indices[k] + 1, *indices[k + 1 :])))
        if queue:
            reason += f"; more than {_MAX_MODES} combinations of modes, the others are not compared"
        self.reasons[reason] = None
        return None

    def _modes_cost(self, sensors: Sequence[SensorId], modes: Sequence[str]) -> float:
        return sum(mode_cost(self.world.sensors[s], m) for s, m in zip(sensors, modes, strict=True))

    def _connect(
        self,
        state: _PartialPlan,
        remaining: list[tuple[ProviderId, Input]],
        owner: ProviderId,
        port: str,
        source: InputSource,
    ) -> Iterator[tuple[_PartialPlan, list[tuple[ProviderId, Input]]]]:
        """Yield the partial plan with ``source`` connected to an input, or nothing if that is impossible."""
        state, todo = state.copy(), list(remaining)
        state.connected[owner] += 1
        state.chosen_sources[owner] = {**state.chosen_sources[owner], port: source.wiring}
        current_source = state.providers[owner].wired.get(port)
        state.cost += REWIRE_COST if current_source is not None and current_source != source else 0.0
        if source.kind != "product":  # availability of a stored product is checked when it is read
            if source.kind == "dpm" or self._restrict_modes(
                state, SensorId(source.robot, source.owner), None
            ):
                yield state, todo
            return
        provider = self.world.providers.get(ProviderId(source.robot, source.owner))
        if provider is None or source.item not in provider.outputs:
            self.reasons[f"{owner} needs {source}, which no DFPC provides"] = None
        elif state.depends(provider.id, owner):
            self.reasons[f"{owner} and {provider.id} depend on each other"] = None
        elif provider.id in state.providers:
            yield self._with_upstream(state, owner, state.providers[provider.id]), todo
        else:
            for choice in provider.choices:
                chosen, chosen_todo = state.copy(), list(todo)
                if self._add_provider(chosen, chosen_todo, choice):
                    yield self._with_upstream(chosen, owner, choice), chosen_todo

    @staticmethod
    def _with_upstream(state: _PartialPlan, owner: ProviderId, provider: Provider) -> _PartialPlan:
        """Record that ``owner`` takes an input from ``provider``."""
        state.upstream[owner] |= {provider.id}
        path_cost = state.path_cost[owner] + (0.0 if provider.active else provider.cost)
        state.path_cost[provider.id] = max(state.path_cost.get(provider.id, 0.0), path_cost)
        return state

    def _add_provider(
        self, state: _PartialPlan, todo: list[tuple[ProviderId, Input]], provider: Provider
    ) -> bool:
        """Add a provider with its inputs and modes to a partial plan; return False if that is impossible."""
        if not provider.available:
            self.reasons[f"{provider.id} is not available: {provider.unavailable_reason or 'no answer'}"] = (
                None
            )
            return False
        if not self._fits(state, provider):
            return False
        state.providers[provider.id] = provider
        state.upstream[provider.id] = frozenset()
        state.chosen_sources[provider.id] = {}
        state.connected[provider.id] = 0
        state.cost += 0.0 if provider.active else provider.cost
        todo.extend((provider.id, port) for port in provider.inputs)
        return all(
            self._restrict_modes(state, SensorId(provider.id.robot, s), mode_names(modes))
            for s, modes in provider.modes.items()
        )

    def _fits(self, state: _PartialPlan, provider: Provider) -> bool:
        """Allocate the needs of a provider; return False if they exceed a budget of its robot."""
        robot = provider.id.robot
        free = self.world.free.get(robot)
        if free is None:
            return True
        needs = provider.needs
        if provider.id in self.world.reserved:
            running = self.world.providers[provider.id]
            if running.implementation == provider.implementation:
                return True
            needs = {budget: max(value - running.needs[budget], 0.0) for budget, value in needs.items()}
        needed = added([state.used.get(robot, {}), needs])
        over = excess(needed, free)
        if over is not None:
            self.reasons[f"{provider.id} does not fit: {_excess_text(over, robot)}"] = None
            return False
        state.used[robot] = needed
        return True

    def _restrict_modes(self, state: _PartialPlan, sensor: SensorId, modes: Sequence[str] | None) -> bool:
        """Restrict a sensor to ``modes`` (None: streaming modes); return False if none is left."""
        candidate = self.world.sensors.get(sensor)
        if candidate is None:
            self.reasons[f"there is no sensor {sensor}"] = None
            return False
        allowed = candidate.streaming_modes() if modes is None else modes
        accepted = state.accepts.get(sensor)
        common = tuple(m for m in (allowed if accepted is None else accepted) if m in allowed)
        if not common and accepted is not None:
            if modes is None:
                self.reasons[f"sensor {sensor} does not stream in mode {'|'.join(accepted)}"] = None
            else:
                modes_text = f"modes {'|'.join(accepted)} and {'|'.join(modes)}"
                self.reasons[f"sensor {sensor} would have to be in {modes_text} at once"] = None
            return False
        obstacles = {m: candidate.obstacle(m) for m in common}
        possible = [m for m in common if obstacles[m] is None]
        if not possible:
            texts = [obstacle for obstacle in obstacles.values() if obstacle is not None]
            self.reasons |= dict.fromkeys(
                texts or [f"sensor {sensor} cannot be set to any mode that streams"]
            )
            return False
        state.cost -= 0.0 if accepted is None else mode_cost(candidate, accepted[0])
        state.accepts[sensor] = tuple(sorted(possible, key=lambda m: mode_cost(candidate, m)))
        state.cost += mode_cost(candidate, state.accepts[sensor][0])
        return True


def plan(
    world: World,
    product: str,
    robots: Iterable[str],
    exclude: frozenset[ProviderId] = frozenset(),
    roots: frozenset[Root] | None = None,
) -> Plan | NoPlan:
    """Return the cheapest sound plan for ``product`` on one of ``robots``, or the reasons if there is none.

    ``exclude`` are providers that failed for this request; ``roots``, by default all, are the providers, or
    their implementations, that may provide the product itself. Providers of requests of lower priority are
    stopped for their budgets only if there is no other plan.
    """
    arguments = (product, frozenset(robots), exclude, roots)
    known: Plan | NoPlan | None = world.plans.get(arguments)
    if known is None:
        known = world.plans[arguments] = _plan(world, *arguments)
    return known


def _plan(
    world: World,
    product: str,
    robots: frozenset[str],
    exclude: frozenset[ProviderId],
    roots: frozenset[Root] | None,
) -> Plan | NoPlan:
    result = _cheapest(world, product, robots, exclude, roots)
    if isinstance(result, Plan) or not world.takeable:
        return result
    freed = _without(world, world.takeable)
    taking = _cheapest(freed, product, robots, exclude, roots)
    if isinstance(taking, NoPlan):
        return result
    takes = _least_takes(freed, taking.order, world.takeable)
    return replace(taking, takes=takes, cost=taking.cost + TAKE_COST * len(takes))


def _without(world: World, providers: Collection[ProviderId]) -> World:
    """Return a world in which the budgets of some reserved providers are free."""
    free = {
        robot: added([amounts, *(world.providers[p].needs for p in providers if p.robot == robot)])
        for robot, amounts in world.free.items()
    }
    limited = {robot: {budget: free[robot][budget] for budget in world.free[robot]} for robot in free}
    return replace(world, free=limited, reserved=world.reserved - frozenset(providers), takeable={})


def _least_takes(
    freed: World, order: Iterable[ProviderId], takeable: Mapping[ProviderId, int]
) -> tuple[ProviderId, ...]:
    """Return the providers that must be stopped for a plan; those of higher priority are kept first."""
    order = frozenset(order)
    used: dict[str, dict[str, float]] = {}

    def allocate(provider: Provider) -> bool:
        robot = provider.id.robot
        needed = added([used.get(robot, {}), provider.needs])
        if excess(needed, freed.free.get(robot, {})) is not None:
            return False
        used[robot] = needed
        return True

    for provider_id in order - freed.reserved:
        allocate(freed.providers[provider_id])
    others = sorted(takeable.keys() - order, key=lambda p: (-takeable[p], p))
    return tuple(p for p in others if not allocate(freed.providers[p]))


def _cheapest(
    world: World,
    product: str,
    robots: frozenset[str],
    exclude: frozenset[ProviderId],
    roots: frozenset[Root] | None,
) -> Plan | NoPlan:
    usable = world
    if exclude:
        usable = replace(world, providers={i: p for i, p in world.providers.items() if i not in exclude})
    search = _Search(usable)
    candidates = [
        (choice, port)
        for provider, port in usable.outputs_of(product, sorted(robots))
        for choice in provider.choices
        if roots is None or _is_root(choice, roots)
    ]
    candidates.sort(key=lambda pair: (0.0 if pair[0].active else pair[0].cost, pair[0].id))
    for provider, port in candidates:
        search.search_root(provider, port)
    if search.best is None or search.best_root is None:
        reasons = tuple(search.reasons) or (
            f"no DFPC of {', '.join(sorted(robots)) or 'any robot'} provides {product}",
        )
        excluded = tuple(
            f"{failed} failed for this request"
            for failed in sorted(exclude)
            if product in world.providers[failed].products
        )
        return NoPlan(reasons + excluded, possible_products(usable, robots))
    state = search.best
    order = _dependency_order(state.upstream)
    return Plan(
        provider=search.best_root[0],
        port=search.best_root[1],
        order=order,
        modes={sensor: modes[0] for sensor, modes in state.accepts.items()},
        cost=state.cost,
        omitted_inputs=state.omitted_inputs,
        accepts=dict(state.accepts),
        chosen_sources={provider: dict(ports) for provider, ports in state.chosen_sources.items()},
        ready_s=_ready_s(usable, order, state),
        implementations=_implementations(usable, state, search.best_root[0], roots),
        root_implementation=state.providers[search.best_root[0]].implementation,
        acquisitions={
            sensor: acquisition
            for sensor, modes in state.accepts.items()
            if (acquisition := usable.sensors[sensor].acquisitions.get(modes[0])) is not None
        },
    )


def _is_root(provider: Provider, roots: frozenset[Root]) -> bool:
    return provider.id in roots or (provider.id, provider.implementation) in roots


def _implementations(
    world: World, state: _PartialPlan, root: ProviderId, roots: frozenset[Root] | None
) -> dict[ProviderId, tuple[str, ...]]:
    """Return the acceptable implementations of the providers with a choice, the selected one first."""
    implementations = {}
    for provider_id, selected in state.providers.items():
        choices = world.providers[provider_id].choices
        if len(choices) > 1:
            others = (
                c.implementation
                for c in choices
                if provider_id != root or roots is None or _is_root(c, roots)
            )
            implementations[provider_id] = tuple(dict.fromkeys((selected.implementation, *others)))
    return implementations


def _excess_text(over: tuple[str, float, float], robot: str) -> str:
    budget, needed, limit = over
    unit = BUDGET_UNITS[budget]
    return f"{needed:.6g} {unit}, {robot} has {max(limit, 0.0):.6g} {unit} left"


def possible_products(world: World, robots: Iterable[str]) -> tuple[str, ...]:
    """Return ``product of robot`` for each product with a sound plan."""
    return tuple(f"{product} of {robot}" for robot in sorted(robots) for product in _possible(world, robot))


def _possible(world: World, robot: str) -> tuple[str, ...]:
    """Return the products of a robot with a sound plan; determined once in each world."""
    possible = world.possible.get(robot)
    if possible is None:
        possible = tuple(p for p in sorted(world.products_of(robot)) if has_plan(world, p, robot))
        world.possible[robot] = possible
    return possible


def has_plan(world: World, product: str, robot: str) -> bool:
    """Return whether there is a sound plan for a product of a robot."""
    search = _Search(world)
    for provider, port in world.outputs_of(product, [robot]):
        for choice in provider.choices:
            search.search_root(choice, port)
            if search.best is not None:
                return True
    return False


def _ready_s(world: World, order: Sequence[ProviderId], state: _PartialPlan) -> float:
    """Return the duration of the longest chain of mode switches and warm-ups; running providers are warm."""
    ready_s: dict[ProviderId, float] = {}
    for provider_id in order:
        provider = state.providers[provider_id]
        sensors = {
            SensorId(s.robot, s.owner) for i in provider.inputs for s in i.sources if s.kind == "sensor"
        }
        sensors |= {SensorId(provider_id.robot, s) for s in provider.modes}
        switches = [
            world.sensors[s].switch_s.get(state.accepts[s][0], 0.0) for s in sensors & state.accepts.keys()
        ]
        acquisitions = [
            a.duration_s
            for s in sensors & state.accepts.keys()
            if (a := world.sensors[s].acquisitions.get(state.accepts[s][0])) is not None
        ]
        start_s = max([*switches, *(ready_s[p] for p in state.upstream[provider_id])], default=0.0)
        start_s += max(acquisitions, default=0.0)
        ready_s[provider_id] = start_s + (0.0 if provider.active else provider.ready_s)
    return max(ready_s.values(), default=0.0)


def _is_wired(provider: Provider) -> bool:
    return any(port.sources for port in provider.inputs)


def _dependency_order(upstream: Mapping[ProviderId, frozenset[ProviderId]]) -> tuple[ProviderId, ...]:
    """Return the providers, upstream ones first; among equals in the order of their names."""
    order: list[ProviderId] = []
    sorter = TopologicalSorter(upstream)
    sorter.prepare()
    while ready := sorted(sorter.get_ready()):
        order += ready
        sorter.done(*ready)
    return tuple(order)
