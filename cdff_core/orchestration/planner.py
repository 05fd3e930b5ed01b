# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a wanted product to the cheapest set of DFPCs and sensor modes that makes it.

A plan is *sound* when one of its makers has the product, every input of every maker that is not optional is fed (by a
sensor in a mode that streams, or by a maker of the plan), each maker has at least one input fed if it is wired at all,
each sensor is in one mode that serves all makers of the plan and all holders of at least our priority, nothing waits
for itself, and no robot's budget of memory or CPU is exceeded. Its cost is the sum of the makers that do not run yet,
``MODE_COST`` for each sensor that has to change, ``TAKE_COST`` for each one that is taken from a request of lower
priority, ``REWIRE_COST`` for each input of a running maker that is fed otherwise than now, and ``UNFED_COST`` for each
optional input that the mission wires and the plan leaves out: what a mission wires is wanted where it can be had.

The search is depth first over the inputs still to feed, cheapest alternative first, cut where the cost so far reaches
the best plan known; it is exact, as tests check against enumeration. So is the cut by the *least* cost still to come:
a plan has no loops, so what feeds an input is none of the makers between it and the product, and their costs add up.
Which mode a sensor gets is open until the end: the modes that serve grow fewer with each maker, so the cheapest of them
is a lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

MODE_COST = 0.5
TAKE_COST = 50.0
REWIRE_COST = 1.0
UNFED_COST = 100.0
#: Steps of the search after which the best plan so far is taken: a bound on time, not met by missions of 100 DFPCs.
MAX_STEPS = 20_000


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run and which modes to set.

    Attributes
    ----------
    maker : MakerId
        The one that has the product; of a plan for several robots, the first.
    port : str
        Its output port.
    order : tuple of MakerId
        All makers, those that feed others first.
    modes : mapping of SensorId to str
        Sensors and the mode each must be in.
    cost : float
    unfed : tuple of str
        Optional inputs left out, ``robot/dfpc.port``.
    accepts : mapping of SensorId to tuple of str
        Of the same sensors: all modes that would serve this plan.
    feeding : mapping of MakerId to mapping of str to str
        What feeds each wired port, as wiring: ``sensor/lidar/scan``.
    ready_s : float
        Until the product may be relied on: modes reached, makers warm, one after the other; seconds.
    """

    maker: MakerId
    port: str
    order: tuple[MakerId, ...]
    modes: Mapping[SensorId, str]
    cost: float
    unfed: tuple[str, ...] = ()
    accepts: Mapping[SensorId, tuple[str, ...]] = field(default_factory=dict)
    feeding: Mapping[MakerId, Mapping[str, str]] = field(default_factory=dict)
    ready_s: float = 0.0

    def describe(self) -> dict[str, object]:
        """Plain data for the journal and for answers."""
        return {
            "maker": str(self.maker),
            "port": self.port,
            "order": [str(m) for m in self.order],
            "modes": {str(s): mode for s, mode in sorted(self.modes.items())},
            "cost": round(self.cost, 6),
            "unfed": list(self.unfed),
            "feeding": {str(m): dict(ports) for m, ports in sorted(self.feeding.items()) if ports},
            "ready_s": round(self.ready_s, 3),
        }


def together(plans: Sequence[Plan]) -> Plan:
    """Several plans, each of a robot of its own, as one."""
    if len(plans) == 1:
        return plans[0]
    first = plans[0]
    return Plan(
        first.maker,
        first.port,
        tuple(m for p in plans for m in p.order),
        {s: mode for p in plans for s, mode in p.modes.items()},
        sum(p.cost for p in plans),
        tuple(text for p in plans for text in p.unfed),
        {s: modes for p in plans for s, modes in p.accepts.items()},
        {m: ports for p in plans for m, ports in p.feeding.items()},
        max(p.ready_s for p in plans),
    )


@dataclass(frozen=True, slots=True)
class NoPlan:
    """Why nothing can make the product; ``nearest`` names what could be asked for instead."""

    reasons: tuple[str, ...]
    nearest: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """One line for an error's detail."""
        line = "; ".join(self.reasons) or "no DFPC makes it"
        return line + (f"; what can be made: {', '.join(self.nearest)}" if self.nearest else "")


@dataclass(slots=True)
class _State:
    """A partial plan during the search.

    ``accepts`` holds, for each sensor of the plan, the modes that serve it so far, cheapest first; ``cost`` holds what
    the cheapest of each adds.
    """

    makers: dict[MakerId, Maker] = field(default_factory=dict)
    feeds: dict[MakerId, frozenset[MakerId]] = field(default_factory=dict)
    feeding: dict[MakerId, dict[str, str]] = field(default_factory=dict)
    above: dict[MakerId, float] = field(default_factory=dict)
    accepts: dict[SensorId, tuple[str, ...]] = field(default_factory=dict)
    fed: dict[MakerId, int] = field(default_factory=dict)
    unfed: tuple[str, ...] = ()
    cost: float = 0.0
    used: dict[tuple[str, str], float] = field(default_factory=dict)

    def copy(self) -> _State:
        return _State(
            dict(self.makers),
            dict(self.feeds),
            dict(self.feeding),
            dict(self.above),
            dict(self.accepts),
            dict(self.fed),
            self.unfed,
            self.cost,
            dict(self.used),
        )

    def depends(self, on: MakerId, maker: MakerId) -> bool:
        """Whether ``maker`` (transitively) feeds ``on``, or is it."""
        stack, seen = [on], set()
        while stack:
            m = stack.pop()
            if m == maker:
                return True
            if m not in seen:
                seen.add(m)
                stack.extend(self.feeds.get(m, ()))
        return False


def mode_cost(sensor: SensorState, mode: str) -> float:
    """What it costs to rely on a sensor in a mode."""
    return MODE_COST * (mode != sensor.current) + TAKE_COST * sensor.takes_from_others(mode)


class _Least:
    """The least that a maker with all that feeds it can cost, whatever else a plan has: the dearest of its chains.

    A source that leads back to a maker being looked at counts nothing, which keeps every figure a lower bound.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[MakerId, float] = {}

    def of_maker(self, maker_id: MakerId) -> float:
        known = self._known.get(maker_id)
        if known is not None:
            return known
        maker = self._world.makers.get(maker_id)
        if maker is None or not maker.available:
            self._known[maker_id] = math.inf
            return math.inf
        self._known[maker_id] = 0.0
        below = max((self.of_input(port) for port in maker.inputs), default=0.0)
        self._known[maker_id] = below + (0.0 if maker.active else maker.cost)
        return self._known[maker_id]

    def of_input(self, port: Input) -> float:
        if not port.sources:
            return 0.0 if port.optional else math.inf
        least = min(self.of_source(source) for source in port.sources)
        return min(least, UNFED_COST) if port.optional else least

    def of_source(self, source: Source) -> float:
        return self.of_maker(MakerId(source.robot, source.owner)) if source.kind == "product" else 0.0


class _Search:
    def __init__(self, world: World) -> None:
        self.world = world
        self.best: _State | None = None
        self.best_root: tuple[MakerId, str] | None = None
        self.reasons: dict[str, None] = {}
        self.steps = 0
        self.least = _Least(world)

    def root(self, maker: Maker, port: str) -> None:
        state = _State()
        todo: list[tuple[MakerId, Input]] = []
        if self.best is not None and self.least.of_maker(maker.id) >= self.best.cost:
            return
        if self._add_maker(state, todo, maker):
            state.above[maker.id] = state.cost
            self._extend(state, todo, (maker.id, port))

    def _extend(self, state: _State, todo: list[tuple[MakerId, Input]], root: tuple[MakerId, str]) -> None:
        self.steps += 1
        if self.steps > MAX_STEPS or (self.best is not None and state.cost >= self.best.cost):
            return
        if not todo:
            self._finish(state, root)
            return
        (owner, port), rest = todo[0], todo[1:]
        if self.best is not None and state.above[owner] + self.least.of_input(port) >= self.best.cost:
            return
        for source in sorted(port.sources, key=self.least.of_source) if len(port.sources) > 1 else port.sources:
            for next_state, next_todo in self._feed(state, rest, owner, port.port, source):
                self._extend(next_state, next_todo, root)
        if port.optional:
            skipped = state.copy()
            if port.sources:
                skipped.cost += UNFED_COST
                skipped.unfed = (*skipped.unfed, f"{owner}.{port.port}")
            self._extend(skipped, rest, root)
        elif not port.sources:
            self.reasons[f"input {port.port} of {owner} is not wired"] = None

    def _finish(self, state: _State, root: tuple[MakerId, str]) -> None:
        """Take a plan whose inputs are all decided."""
        starved = next((m for m in state.makers.values() if state.fed[m.id] == 0 and _wired(m)), None)
        if starved is not None:
            self.reasons[f"none of the inputs of {starved.id} can be fed"] = None
        elif self.best is None or state.cost < self.best.cost:
            self.best, self.best_root = state.copy(), root

    def _feed(
        self, state: _State, rest: list[tuple[MakerId, Input]], owner: MakerId, port: str, source: Source
    ) -> Iterator[tuple[_State, list[tuple[MakerId, Input]]]]:
        """The partial plan with one input fed from ``source``, or nothing where that cannot be."""
        state, todo = state.copy(), list(rest)
        state.fed[owner] += 1
        state.feeding[owner] = {**state.feeding[owner], port: source.wiring}
        now = state.makers[owner].wired.get(port)
        state.cost += REWIRE_COST if now is not None and now != source else 0.0
        if source.kind == "sensor":
            if self._narrow(state, SensorId(source.robot, source.owner), None):
                yield state, todo
            return
        if source.kind == "dpm":  # stored: whether it is there is seen when it is read
            yield state, todo
            return
        maker = self.world.makers.get(MakerId(source.robot, source.owner))
        if maker is None or source.item not in maker.outputs:
            self.reasons[f"{owner} needs {source}, which nobody makes"] = None
        elif state.depends(maker.id, owner):
            self.reasons[f"{owner} and {maker.id} wait for each other"] = None
        elif maker.id in state.makers or self._add_maker(state, todo, maker):
            state.feeds[owner] |= {maker.id}
            through = state.above[owner] + (0.0 if maker.active else maker.cost)
            state.above[maker.id] = max(state.above.get(maker.id, 0.0), through)
            yield state, todo

    def _add_maker(self, state: _State, todo: list[tuple[MakerId, Input]], maker: Maker) -> bool:
        if not maker.available:
            self.reasons[f"{maker.id} is not available: {maker.why_not or 'its process does not answer'}"] = None
            return False
        if not self._fits(state, maker):
            return False
        state.makers[maker.id] = maker
        state.feeds[maker.id] = frozenset()
        state.feeding[maker.id] = {}
        state.fed[maker.id] = 0
        state.cost += 0.0 if maker.active else maker.cost
        todo.extend((maker.id, port) for port in maker.inputs)
        return all(
            self._narrow(state, SensorId(maker.id.robot, s), modes.split("|")) for s, modes in maker.modes.items()
        )

    def _fits(self, state: _State, maker: Maker) -> bool:
        """Take a maker's memory and CPU from its robot's budgets, where it has any."""
        robot = maker.id.robot
        if maker.id in self.world.reserved:
            return True
        for free, needs, unit in (
            (self.world.memory_free_mb.get(robot), maker.memory_mb, "MB"),
            (self.world.cpu_free.get(robot), maker.cpu, "cores"),
        ):
            if free is None:
                continue
            needed = state.used.get((robot, unit), 0.0) + needs
            if needed > free * (1.0 + 1e-9):
                have = f"{robot} has {max(free, 0.0):.6g} {unit} left"
                self.reasons[f"{maker.id} does not fit: {needed:.6g} {unit}, {have}"] = None
                return False
            state.used[robot, unit] = needed
        return True

    def _narrow(self, state: _State, sensor: SensorId, modes: Sequence[str] | None) -> bool:
        """Keep only the modes of a sensor that serve one more: those named, or (None) all that stream."""
        known = self.world.sensors.get(sensor)
        if known is None:
            self.reasons[f"there is no sensor {sensor}"] = None
            return False
        wanted = known.streaming_modes() if modes is None else modes
        before = state.accepts.get(sensor)
        common = tuple(m for m in (wanted if before is None else before) if m in wanted)
        if not common and before is not None:
            if modes is None:
                self.reasons[f"sensor {sensor} does not stream in mode {'|'.join(before)}"] = None
            else:
                both = f"modes {'|'.join(before)} and {'|'.join(modes)}"
                self.reasons[f"sensor {sensor} would have to be in {both} at once"] = None
            return False
        obstacles = {m: known.obstacle(m) for m in common}
        possible = [m for m in common if obstacles[m] is None]
        if not possible:
            whys = [why for why in obstacles.values() if why is not None]
            self.reasons |= dict.fromkeys(whys or [f"sensor {sensor} cannot be set to any mode that streams"])
            return False
        state.cost -= 0.0 if before is None else mode_cost(known, before[0])
        state.accepts[sensor] = tuple(sorted(possible, key=lambda m: mode_cost(known, m)))
        state.cost += mode_cost(known, state.accepts[sensor][0])
        return True


def plan(
    world: World,
    product: str,
    robots: Iterable[str],
    exclude: frozenset[MakerId] = frozenset(),
    roots: frozenset[MakerId] | None = None,
) -> Plan | NoPlan:
    """Return the cheapest sound plan for ``product`` on one of ``robots``, or why there is none.

    Parameters
    ----------
    world : World
    product : str
        ``pose``, ``dem``, … (contract §5).
    robots : iterable of str
        Robots whose product would do.
    exclude : frozenset of MakerId
        Makers that failed already for this request.
    roots : frozenset of MakerId, optional
        The only makers that may have the product; their feeders may be any. Default: all.
    """
    wanted = set(robots)
    usable = replace(world, makers={k: m for k, m in world.makers.items() if k not in exclude})
    search = _Search(usable)
    starts = [
        (m, port)
        for m in usable.makers.values()
        if m.id.robot in wanted and (roots is None or m.id in roots)
        for port, made in sorted(m.outputs.items())
        if made == product
    ]
    starts.sort(key=lambda r: (0.0 if r[0].active else r[0].cost, r[0].id))
    for maker, port in starts:
        search.root(maker, port)
    if search.best is None or search.best_root is None:
        reasons = tuple(search.reasons) or (f"no DFPC of {', '.join(sorted(wanted)) or 'any robot'} makes {product}",)
        tried = tuple(f"{m} failed for this request" for m in sorted(exclude) if product in world.makers[m].products)
        return NoPlan(reasons + tried, possible_products(usable, wanted))
    state = search.best
    order = _dependency_order(state.feeds)
    return Plan(
        search.best_root[0],
        search.best_root[1],
        order,
        {sensor: modes[0] for sensor, modes in state.accepts.items()},
        state.cost,
        state.unfed,
        dict(state.accepts),
        {m: dict(ports) for m, ports in state.feeding.items()},
        _ready_s(usable, order, state),
    )


def possible_products(world: World, robots: Iterable[str]) -> tuple[str, ...]:
    """``product of robot`` for everything that some sound plan makes."""
    found = []
    for robot in sorted(robots):
        for product in sorted({p for m in world.makers.values() if m.id.robot == robot for p in m.products}):
            search = _Search(world)
            for maker in world.makers.values():
                for port, made in maker.outputs.items():
                    if maker.id.robot == robot and made == product:
                        search.root(maker, port)
            if search.best is not None:
                found.append(f"{product} of {robot}")
    return tuple(found)


def _ready_s(world: World, order: Sequence[MakerId], state: _State) -> float:
    """The longest chain of a mode to reach and makers to warm up, seconds; what runs is warm."""
    until_s: dict[MakerId, float] = {}
    for m in order:
        maker = state.makers[m]
        sensors = {SensorId(s.robot, s.owner) for i in maker.inputs for s in i.sources if s.kind == "sensor"}
        sensors |= {SensorId(m.robot, s) for s in maker.modes}
        switches = [world.sensors[s].switch_s.get(state.accepts[s][0], 0.0) for s in sensors & state.accepts.keys()]
        before_s = max([*switches, *(until_s[f] for f in state.feeds[m])], default=0.0)
        until_s[m] = before_s + (0.0 if maker.active else maker.ready_s)
    return max(until_s.values(), default=0.0)


def _wired(maker: Maker) -> bool:
    return any(port.sources for port in maker.inputs)


def _dependency_order(feeds: Mapping[MakerId, frozenset[MakerId]]) -> tuple[MakerId, ...]:
    """Makers so that each comes after those that feed it; names decide among equals."""
    order: list[MakerId] = []
    waiting = {m: set(f) for m, f in feeds.items()}
    while waiting:
        ready = sorted(m for m, f in waiting.items() if not f)
        for m in ready:
            del waiting[m]
        order.extend(ready)
        for f in waiting.values():
            f.difference_update(ready)
    return tuple(order)
