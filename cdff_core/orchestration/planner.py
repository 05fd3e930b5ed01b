# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a wanted product to the cheapest set of DFPCs and sensor modes that makes it.

A plan is *sound* when one of its makers has the product, every input of every maker that is not optional is fed (by a
sensor in a mode that streams, or by a maker of the plan), each maker has at least one input fed if it is wired at all,
no sensor is in two modes, nothing waits for itself, and no robot's budget of memory is exceeded. Its cost is the sum of
the makers that do not run yet, ``MODE_COST`` for each sensor that has to change, and ``UNFED_COST`` for each optional
input that the mission wires and the plan leaves out: what a mission wires is wanted where it can be had.

The search is depth first over the inputs still to feed, cheapest alternative first, cut where the cost so far reaches
the best plan known; it is exact, as tests check against enumeration. So is the cut by the *least* cost still to come:
a plan has no loops, so what feeds an input is none of the makers between it and the product, and their costs add up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, Source, World

MODE_COST = 0.5
UNFED_COST = 100.0
#: Steps of the search after which the best plan so far is taken: a bound on time, not met by missions of 100 DFPCs.
MAX_STEPS = 20_000


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run and which modes to set.

    Attributes
    ----------
    maker : MakerId
        The one that has the product.
    port : str
        Its output port.
    order : tuple of MakerId
        All makers, those that feed others first.
    modes : mapping of SensorId to str
        Sensors and the mode each must be in.
    cost : float
    unfed : tuple of str
        Optional inputs left out, ``robot/dfpc.port``.
    """

    maker: MakerId
    port: str
    order: tuple[MakerId, ...]
    modes: Mapping[SensorId, str]
    cost: float
    unfed: tuple[str, ...] = ()

    def describe(self) -> dict[str, object]:
        """Plain data for the journal and for answers."""
        return {
            "maker": str(self.maker),
            "port": self.port,
            "order": [str(m) for m in self.order],
            "modes": {str(s): mode for s, mode in sorted(self.modes.items())},
            "cost": round(self.cost, 6),
            "unfed": list(self.unfed),
        }


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
    """A partial plan during the search."""

    makers: dict[MakerId, Maker] = field(default_factory=dict)
    feeds: dict[MakerId, frozenset[MakerId]] = field(default_factory=dict)
    above: dict[MakerId, float] = field(default_factory=dict)
    modes: dict[SensorId, str] = field(default_factory=dict)
    streams: frozenset[SensorId] = frozenset()
    fed: dict[MakerId, int] = field(default_factory=dict)
    unfed: tuple[str, ...] = ()
    cost: float = 0.0
    memory_mb: dict[str, float] = field(default_factory=dict)

    def copy(self) -> _State:
        return _State(
            dict(self.makers),
            dict(self.feeds),
            dict(self.above),
            dict(self.modes),
            self.streams,
            dict(self.fed),
            self.unfed,
            self.cost,
            dict(self.memory_mb),
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
        return 0.0 if source.kind == "sensor" else self.of_maker(MakerId(source.robot, source.owner))


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
            for next_state, next_todo in self._feed(state, rest, owner, source):
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
        """Take a plan whose inputs are all decided, once sensors of which only samples are wanted have a mode."""
        starved = next((m for m in state.makers.values() if state.fed[m.id] == 0 and _wired(m)), None)
        if starved is not None:
            self.reasons[f"none of the inputs of {starved.id} can be fed"] = None
            return
        state = state.copy()
        if all(self._stream(state, sensor) for sensor in sorted(state.streams)) and (
            self.best is None or state.cost < self.best.cost
        ):
            self.best, self.best_root = state, root

    def _feed(
        self, state: _State, rest: list[tuple[MakerId, Input]], owner: MakerId, source: Source
    ) -> Iterator[tuple[_State, list[tuple[MakerId, Input]]]]:
        """The partial plan with one input fed from ``source``, or nothing where that cannot be."""
        state, todo = state.copy(), list(rest)
        state.fed[owner] += 1
        if source.kind == "sensor":
            sensor = SensorId(source.robot, source.owner)
            if sensor in self.world.sensors:
                state.streams |= {sensor}
                yield state, todo
            else:
                self.reasons[f"there is no sensor {sensor}"] = None
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
        state.fed[maker.id] = 0
        state.cost += 0.0 if maker.active else maker.cost
        todo.extend((maker.id, port) for port in maker.inputs)
        return all(self._mode(state, SensorId(maker.id.robot, s), mode) for s, mode in maker.modes.items())

    def _fits(self, state: _State, maker: Maker) -> bool:
        """Take a maker's memory from its robot's budget, where it has one."""
        robot = maker.id.robot
        free_mb = self.world.memory_free_mb.get(robot)
        if free_mb is None or maker.id in self.world.reserved:
            return True
        needed_mb = state.memory_mb.get(robot, 0.0) + maker.memory_mb
        if needed_mb > free_mb:
            self.reasons[f"{maker.id} does not fit: {needed_mb:g} MB, {robot} has {max(free_mb, 0.0):g} MB left"] = None
            return False
        state.memory_mb[robot] = needed_mb
        return True

    def _stream(self, state: _State, sensor: SensorId) -> bool:
        """Have samples of a sensor: in the mode the plan names, else in whichever streams."""
        known = self.world.sensors[sensor]
        if sensor in state.modes:
            if not known.modes.get(state.modes[sensor]):
                self.reasons[f"sensor {sensor} does not stream in mode {state.modes[sensor]}"] = None
                return False
            return True
        mode = known.streaming_mode()
        if mode is None:
            self.reasons[f"sensor {sensor} cannot be set to any mode that streams"] = None
            return False
        return self._mode(state, sensor, mode)

    def _mode(self, state: _State, sensor: SensorId, mode: str) -> bool:
        known = self.world.sensors.get(sensor)
        obstacle = f"there is no sensor {sensor}" if known is None else known.obstacle(mode)
        if obstacle is None and state.modes.get(sensor, mode) != mode:
            obstacle = f"sensor {sensor} would have to be in modes {state.modes[sensor]} and {mode} at once"
        if obstacle is not None or known is None:
            self.reasons[str(obstacle)] = None
            return False
        if sensor not in state.modes:
            state.modes[sensor] = mode
            state.cost += 0.0 if known.current == mode else MODE_COST
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
    return Plan(
        search.best_root[0],
        search.best_root[1],
        _dependency_order(state.feeds),
        dict(state.modes),
        state.cost,
        state.unfed,
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
