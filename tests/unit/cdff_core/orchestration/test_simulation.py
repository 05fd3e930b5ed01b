# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A day of virtual time with random requests and faults: the decisions of the orchestrator keep their invariants.

Plans, leases and reconciliation are the code's own; only the world they act on is simulated: DFPCs that crash, hang and
come back, activations that fail, a sensor whose modes are refused or take their time. A seed replays a day.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest

from cdff_core.orchestration.catalogue import feeds_of, uses_of
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.reconcile import Activate, Observed, SetMode, dependency_order, next_actions
from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

DAY_S = 86_400.0
LINGER_S = 30.0
LIDAR, CAMERA = SensorId("mana", "lidar"), SensorId("mana", "camera")


def _id(name: str) -> MakerId:
    return MakerId("mana", name)


def _of(port: str, kind: str, owner: str, optional: bool = False) -> Input:
    return Input(port, (Source(kind, "mana", owner, "out"),), optional)


MAKERS = {
    m.id: m
    for m in (
        Maker(_id("vo"), {"out": None}, (_of("stereo", "sensor", "camera"),), {"camera": "stereo"}),
        Maker(_id("slam"), {"out": "pose"}, (_of("scan", "sensor", "lidar"),), {"lidar": "fast"}, cost=1.5),
        Maker(_id("position"), {"out": None}, (_of("visual_odometry", "product", "vo"),)),
        Maker(
            _id("dem"), {"out": "dem"}, (_of("scan", "sensor", "lidar"), _of("poses", "product", "position")),
            {"lidar": "slow"}, cost=2.0,
        ),
        Maker(_id("navigation"), {"out": "navigation_map"}, (_of("dem", "product", "dem"),)),
    )
}  # fmt: skip
SENSORS = {
    LIDAR: SensorState(LIDAR, {"off": False, "slow": True, "fast": True}, "off"),
    CAMERA: SensorState(CAMERA, {"off": False, "mono": True, "stereo": True}, "off"),
}
FEEDS, USES = feeds_of(World(MAKERS, SENSORS)), uses_of(World(MAKERS, SENSORS))


@dataclass
class _Request:
    product: str
    deadline_s: float
    plan: Plan | None = None
    answers: list[str] = field(default_factory=list)


class Day:
    """Events in virtual time; after each one the invariants are checked."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.now_s = 0.0
        self.queue: list[tuple[float, int, Callable[[], None]]] = []
        self.count = self.events = 0
        self.leases = Leases(dict.fromkeys(MAKERS, LINGER_S))
        self.observed = Observed(alive=set(MAKERS))
        self.busy: set[MakerId | SensorId] = set()
        self.open: dict[str, _Request] = {}
        self.ended: dict[str, int] = {}
        self.refused: dict[SensorId, frozenset[str]] = {}
        self.log: list[str] = []

    def after(self, delay_s: float, event: Callable[[], None]) -> None:
        self.count += 1
        heapq.heappush(self.queue, (self.now_s + delay_s, self.count, event))

    def run(self, until_s: float) -> None:
        self.after(self.random.expovariate(1 / 60), self.arrive)
        self.after(self.random.expovariate(1 / 600), self.crash)
        self.after(self.random.expovariate(1 / 1800), self.refuse)
        while self.queue and (self.queue[0][0] <= until_s or self.open):
            self.now_s, _, event = heapq.heappop(self.queue)
            self.arriving = self.now_s < until_s
            event()
            self.leases.expire(self.now_s)
            self.step()
            self.events += 1
            self.check()

    # -- what happens ---------------------------------------------------------------------------------------------

    def arrive(self) -> None:
        if not self.arriving:
            return
        name = f"r{self.count}"
        wanted = self.random.choice(["pose", "dem", "navigation_map"])
        self.open[name] = _Request(wanted, self.now_s + self.random.uniform(5, 120))
        self.after(self.open[name].deadline_s - self.now_s, lambda: self.answer(name, "deadline"))
        self.make_plan(name)
        self.after(self.random.expovariate(1 / 60), self.arrive)

    def make_plan(self, name: str) -> None:
        request = self.open[name]
        self.leases.release(name, self.now_s)
        made = plan(self.world(), request.product, ["mana"])
        if isinstance(made, NoPlan):
            self.answer(name, "refused")
            return
        request.plan = made
        self.leases.acquire(name, made.order, made.modes)

    def answer(self, name: str, how: str) -> None:
        request = self.open.pop(name, None)
        if request is None:
            return
        self.log.append(f"{self.now_s:.3f} {name} {how}")
        self.ended[name] = self.ended.get(name, 0) + 1
        self.leases.release(name, self.now_s)
        self.after(LINGER_S, lambda: None)

    def crash(self) -> None:
        maker = self.random.choice(sorted(MAKERS))
        self.observed.alive.discard(maker)
        self.observed.active.discard(maker)
        self.after(self.random.uniform(1, 20), lambda: self.observed.alive.add(maker))
        self.after(self.random.expovariate(1 / 600), self.crash)

    def refuse(self) -> None:
        sensor = self.random.choice(sorted(SENSORS))
        mode = self.random.choice([m for m, on in SENSORS[sensor].modes.items() if on])
        self.refused[sensor] = frozenset({mode})
        self.after(30.0, lambda: self.refused.pop(sensor, None))
        self.after(self.random.expovariate(1 / 1800), self.refuse)

    def step(self) -> None:
        """What the control loop does, each action ending after a while, or failing, or hanging until it times out."""
        wanted = dependency_order(sorted(self.leases.wanted), FEEDS)
        for action in next_actions(wanted, self.leases.wanted_modes(), USES, FEEDS, self.observed, self.now_s):
            subject: MakerId | SensorId = action.sensor if isinstance(action, SetMode) else action.maker
            if subject in self.busy:
                continue
            self.busy.add(subject)
            hangs = self.random.random() < 0.02
            delay_s = 5.0 if hangs else self.random.uniform(0.05, 0.5)
            fails = hangs or self.random.random() < 0.05
            if isinstance(action, SetMode):
                self.after(delay_s, lambda s=subject, m=action.mode, f=fails: self.mode_set(s, m, f))  # type: ignore[misc]
            elif isinstance(action, Activate):
                self.observed.owned.add(action.maker)
                self.after(delay_s, lambda m=subject, f=fails: self.activated(m, f))  # type: ignore[misc]
            else:
                self.after(delay_s, lambda m=subject, f=fails: self.deactivated(m, f))  # type: ignore[misc]
        for name, request in list(self.open.items()):
            if request.plan is not None and self.runs(request.plan):
                self.after(self.random.uniform(0.1, 3.0), lambda n=name: self.produced(n))  # type: ignore[misc]
                request.plan = None

    def mode_set(self, sensor: SensorId, mode: str, fails: bool) -> None:
        self.busy.discard(sensor)
        if fails or mode in self.refused.get(sensor, ()):
            self.failed(sensor)
        else:
            self.observed.modes[sensor] = mode
            self.observed.succeeded(sensor)

    def activated(self, maker: MakerId, fails: bool) -> None:
        self.busy.discard(maker)
        if fails or maker not in self.observed.alive:
            self.failed(maker)
        else:
            self.observed.active.add(maker)
            self.observed.succeeded(maker)

    def deactivated(self, maker: MakerId, fails: bool) -> None:
        self.busy.discard(maker)
        if fails and maker in self.observed.alive:
            self.failed(maker)
            return
        self.observed.active.discard(maker)
        self.observed.owned.discard(maker)
        self.observed.succeeded(maker)

    def failed(self, what: MakerId | SensorId) -> None:
        self.observed.attempt(what).failed("a fault", self.now_s)
        self.after(self.observed.attempts[what].not_before_s - self.now_s, lambda: None)

    def produced(self, name: str) -> None:
        """The product is there if nothing went down on the way; else the request plans again."""
        request = self.open.get(name)
        if request is None:
            return
        self.make_plan(name)
        request = self.open.get(name)
        if request is not None and request.plan is not None and self.runs(request.plan):
            self.answer(name, "product")

    # -- what is so -----------------------------------------------------------------------------------------------

    def world(self) -> World:
        makers = {m: replace(x, active=m in self.observed.active) for m, x in MAKERS.items()}
        sensors = {
            s: replace(
                x, current=self.observed.modes.get(s, x.current), held=self.leases.held_mode(s),
                refused=self.refused.get(s, frozenset()),
            ) for s, x in SENSORS.items()
        }  # fmt: skip
        return World(makers, sensors)

    def runs(self, made: Plan) -> bool:
        return all(m in self.observed.active for m in made.order) and all(
            self.observed.modes.get(s) == mode for s, mode in made.modes.items()
        )

    def check(self) -> None:
        where = f"event {self.events} at {self.now_s:.3f} s"
        assert all(n == 1 for n in self.ended.values()), where
        assert not set(self.ended) & set(self.open), where
        wanted, o = self.leases.wanted, self.observed

        def attempted(what: MakerId | SensorId) -> bool:
            return what in self.busy or what in o.attempts

        for maker in o.active - wanted:
            fed = any(maker in FEEDS[m] for m in o.active - wanted)
            assert attempted(maker) or fed, f"{where}: {maker} runs for nobody"
        pending = {s for s, mode in self.leases.wanted_modes().items() if o.modes.get(s) != mode}
        for sensor in pending:
            assert attempted(sensor), f"{where}: {sensor} is not brought into the mode that is held"
        for maker in (wanted & o.alive) - o.active:
            waits = bool(USES[maker] & pending) or bool(FEEDS[maker] & (wanted & o.alive) - o.active)
            assert attempted(maker) or waits, f"{where}: nobody starts {maker}"
        holders = {h for m in wanted for h in self.leases.holders(m)}
        assert holders <= set(self.open), f"{where}: holders {holders - set(self.open)} have ended"
        for sensor in SENSORS:
            held = {mode for r in self.open for s, mode in self.held(r).items() if s == sensor}
            assert len(held) <= 1, f"{where}: {sensor} is held in {held}"
        assert len(self.queue) < 1000, where
        assert len(o.attempts) <= len(MAKERS) + len(SENSORS), where

    def held(self, name: str) -> dict[SensorId, str]:
        return self.leases.held_modes(name)


@pytest.mark.req("CDFF-SUP-074")
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_day_of_requests_and_faults_keeps_the_invariants(seed: int) -> None:
    day = Day(seed)
    day.run(DAY_S)
    assert day.events > 5_000
    assert not day.open
    how = [line.rsplit(" ", 1)[1] for line in day.log]
    assert set(how) == {"product", "deadline", "refused"}
    assert how.count("product") > len(how) / 3


def test_a_seed_replays_its_day() -> None:
    days = [Day(7) for _ in range(2)]
    for day in days:
        day.run(DAY_S / 12)
    assert days[0].log == days[1].log
    assert days[0].log
