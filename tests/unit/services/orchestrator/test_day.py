# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A day of virtual time with random requests and faults: the orchestrator's own service keeps its invariants.

The whole service runs (flow, finder, sharing, delivery, control, watcher, journal, history) on a simulated
bus; only the other side of the bus is simulated. DFPCs crash, hang, raise, refuse, degrade and go deaf;
sensors are refused and lost; the DPM and the ICU go away; the orchestrator is killed and restarted. A seed
replays its day, thread for thread.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from cdff_common.bus import Request, keys
from cdff_common.errors import CdffError, NoAnswerError
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.catalogue import sensors_used, upstream_providers
from cdff_core.orchestration.leases import ALWAYS
from cdff_core.orchestration.lifecycle import FINAL_STATES
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator.service import Orchestrator
from tests.support import orchestrator_mission
from tests.support.simulated_bus import Mission, SimulatedBus

HOUR_S, DAY_S = 3600.0, 86_400.0
CAPACITY = 12
#: Clocks agree to this: a wait that ends at the deadline ends in it.
EPSILON_S = 1e-4


@dataclass
class Asked:
    """A request of the day and what became of it."""

    name: str
    process: object
    until_s: float
    finals: int = 0
    how: str = ""


class Day:
    """A mission, an orchestrator, clients and faults; after each step of any thread the invariants are
    checked.
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self.scheduler = Scheduler()
        self.mission = Mission(self.scheduler, orchestrator_mission.profile(), seed)
        self.random = self.mission.random
        self.journal = folder / f"journal{seed}.jsonl"
        self.asked: dict[str, Asked] = {}
        self.ended: Counter[str] = Counter()
        self.log: list[str] = []
        self.count = self.events = self.restarts = 0
        self.most: Counter[str] = Counter()
        self.over = False
        self.lead()

    def lead(self) -> None:
        """Start an orchestrator, as its supervisor does."""
        self.timing = VirtualTiming(self.scheduler)
        self.bus: SimulatedBus = self.mission.connect(self.timing)
        self.orchestrator = Orchestrator(self.bus, self.mission.profile, self.journal, CAPACITY, self.timing)  # type: ignore[arg-type]
        self.timing.start(self.orchestrator.start, "start")

    def run(self, until_s: float) -> None:
        for every_s, event in (
            (40.0, self.arrive),
            (900.0, self.crash),
            (1200.0, self.hang),
            (1200.0, self.raise_),
            (1500.0, self.refuse),
            (1500.0, self.degrade),
            (2400.0, self.go_deaf),
            (2400.0, self.lose_sensor),
            (3000.0, self.dpm_away),
            (5000.0, self.icu_away),
            (9000.0, self.kill),
        ):
            self.scheduler.start(lambda e=every_s, f=event: self.every(e, f, until_s), event.__name__)  # type: ignore[misc]
        while not self.over or self.asked:
            self.over = self.scheduler.now_s >= until_s
            assert self.scheduler.step()
            self.events += 1
            self.check()

    def every(self, mean_s: float, event: Callable[[], None], until_s: float) -> None:
        while self.scheduler.now_s < until_s:
            self.scheduler.sleep(self.random.expovariate(1.0 / mean_s))
            if self.scheduler.now_s < until_s:
                event()

    # -- clients
    # -----------------------------------------------------------------------------------------------------

    def arrive(self) -> None:
        wish = self.wish()
        for _ in range(20 if self.random.random() < 0.02 else self.random.choice([1, 1, 1, 2])):
            self.count += 1
            self.ask(f"r{self.count}", wish)

    def wish(self) -> dict[str, str]:
        r = self.random
        product = r.choice(["pose", "pose", "dem", "dem", "navigation_map"])
        p = {"type": product, "robot": r.choice(["mana", "mana", "minnie", "any"])}
        p["deadline_ms"] = str(r.choice([1000, 4000, 8000, 20_000, 60_000]))
        p["priority"] = str(r.randrange(10))
        p["max_age_s"] = str(r.choice([3, 10, 60, 600]))
        if product != "pose" and r.random() < 0.6:
            p["region"] = r.choice(["bbox:0,0,4,4", "bbox:1,1,3,3", "circle:2,2,1", "bbox:300,300,304,304"])
            if r.random() < 0.6:
                p["min_coverage"] = r.choice(["0.2", "0.6", "1"])
        if r.random() < 0.05:
            p["frame"] = "nowhere"
        if r.random() < 0.1:
            p |= {"every_s": r.choice(["0", "5"]), "deadline_ms": "30000"}
        if r.random() < 0.1:
            p["progress"] = "true"
        if r.random() < 0.05:
            p["explain"] = "true"
        return p

    def ask(self, name: str, wish: dict[str, str]) -> None:
        asked = Asked(name, self.timing, self.scheduler.now_s + int(wish["deadline_ms"]) / 1000)
        self.asked[name] = asked
        bus = self.bus
        self.timing.start(lambda: self.client(bus, asked, {**wish, "request": name}), name)
        if self.random.random() < 0.08:
            after_s = self.random.uniform(0.1, 20.0)
            self.timing.start(lambda: self.meddle(bus, asked, "cancel", after_s), f"cancel {name}")
        if "every_s" in wish and self.random.random() < 0.5:
            self.timing.start(lambda: self.meddle(bus, asked, "renew", 10.0), f"renew {name}")

    def client(self, bus: SimulatedBus, asked: Asked, wish: dict[str, str]) -> None:
        try:
            for reply in bus.query(keys.orchestrator_rpc("ground", "request"), wish):
                if reply.final:
                    asked.finals += 1
                    asked.how = str(reply.attachment.get("kind"))
        except CdffError as error:
            asked.finals += 1
            asked.how = type(error).__name__
        self.end(asked)

    def meddle(self, bus: SimulatedBus, asked: Asked, verb: str, after_s: float) -> None:
        """Cancel a request, or renew its lease, while it is open."""
        self.scheduler.sleep(after_s)
        key = keys.orchestrator_rpc("ground", verb)
        if asked.name in self.asked and key in bus.handlers:
            more = {"deadline_ms": "20000"} if verb == "renew" else {}
            try:
                bus.handlers[key](Request(key, {"job": asked.name, "robot": "any", **more}, b"", "", b""))
                asked.until_s = max(asked.until_s, self.scheduler.now_s + 20.0) if more else asked.until_s
            except CdffError:
                pass  # it has not been taken, or has ended

    def end(self, asked: Asked) -> None:
        del self.asked[asked.name]
        self.ended[asked.name] += 1
        assert self.ended[asked.name] == 1, f"{asked.name} ended twice"
        late = asked.how != NoAnswerError.__name__ and self.scheduler.now_s > asked.until_s + EPSILON_S
        assert asked.finals == 1, f"{asked.name} got {asked.finals} final answers"
        assert not late, (
            f"{asked.name} answered {self.scheduler.now_s - asked.until_s:.3f} s late: {asked.how}"
        )
        self.log.append(f"{self.scheduler.now_s:.6f} {asked.name} {asked.how}")

    # -- faults
    # ------------------------------------------------------------------------------------------------------

    def process(self):  # type: ignore[no-untyped-def]
        return self.mission.processes[self.random.choice(sorted(self.mission.processes))]

    def crash(self) -> None:
        process = self.process()
        if process.alive:
            self.mission.stop(process)
            self.scheduler.sleep(self.random.uniform(1.0, 20.0))
            self.mission.start(process)

    def hang(self) -> None:
        """Until its watchdog ends it and its supervisor starts it again."""
        process = self.process()
        if process.alive:
            process.is_hung = True
            self.scheduler.sleep(10.0)
            self.mission.stop(process)
            self.scheduler.sleep(2.0)
            self.mission.start(process)

    def raise_(self) -> None:
        self.mission.fail(self.process())

    def refuse(self) -> None:
        self.for_a_while("produces_nothing")

    def degrade(self) -> None:
        self.for_a_while("degraded")

    def go_deaf(self) -> None:
        self.for_a_while("receives_nothing")

    def for_a_while(self, fault: str) -> None:
        process = self.process()
        assert not getattr(process, fault), f"{fault} of {process.id}: two faults of one kind at a time"
        setattr(process, fault, True)
        self.scheduler.sleep(self.random.uniform(10.0, 120.0))
        setattr(process, fault, False)

    def lose_sensor(self) -> None:
        robot, sensor = (
            self.random.choice(self.mission.profile.robot_ids),
            self.random.choice(["lidar", "navcam"]),
        )
        self.mission.icu.lose(robot, sensor, "simulated")
        self.scheduler.sleep(self.random.uniform(5.0, 60.0))
        self.mission.icu.recover(robot, sensor)

    def dpm_away(self) -> None:
        self.mission.dpm_up = False
        self.scheduler.sleep(self.random.uniform(1.0, 15.0))
        self.mission.dpm_up = True

    def icu_away(self) -> None:
        self.mission.icu_up = False
        for robot in self.mission.profile.robot_ids:
            self.mission.token(keys.alive(robot, "icu"), here=False)
        self.scheduler.sleep(self.random.uniform(1.0, 15.0))
        self.mission.icu_up = True
        for robot in self.mission.profile.robot_ids:
            self.mission.token(keys.alive(robot, "icu"), here=True)

    def kill(self) -> None:
        """Kill the orchestrator; its clients lose the connection, and a new one starts with its
        journal.
        """
        self.restarts += 1
        old = self.timing
        self.scheduler.kill(old)
        self.mission.buses.clear()
        for scope in (*self.mission.profile.robot_ids, keys.GROUND):
            self.mission.token(keys.alive(scope, "orchestrator"), here=False)
        for asked in [a for a in self.asked.values() if a.process is old]:
            asked.finals, asked.how = asked.finals + 1, NoAnswerError.__name__
            self.end(asked)
        self.scheduler.sleep(self.random.uniform(0.5, 3.0))
        self.lead()

    # -- invariants
    # --------------------------------------------------------------------------------------------------

    def check(self) -> None:
        where = f"event {self.events} at {self.scheduler.now_s:.3f} s"
        state, book = self.orchestrator._state, self.orchestrator._jobs
        o, leases = state._observed, state._leases
        open_jobs = {j.id for j in book._jobs.values() if j.state not in FINAL_STATES}
        holders = {h for m in leases.wanted for h in leases.holders(m)}
        assert holders <= open_jobs | {ALWAYS}, (
            f"{where}: {holders - open_jobs} hold something and have ended"
        )
        # memory
        flow = self.orchestrator._flow
        sizes = {
            "open": len(open_jobs),
            "jobs": len(book._jobs),
            "looks": len(flow._shared),
            "attempts": len(o.failures),
            "tasks": len(self.scheduler.tasks),
            "cached": len(flow.finder.dpm._values),
        }
        self.most |= Counter(sizes)
        if self.scheduler.is_waiting("control", self.timing) and self.scheduler.is_waiting(
            "watcher", self.timing
        ):
            self.check_control(where)

    def check_control(self, where: str) -> None:
        """Check that running and wanted providers agree, except those with an action in progress."""
        state, busy = self.orchestrator._state, self.orchestrator._reconciler._busy
        o, leases, now_s = state._observed, state._leases, self.scheduler.now_s
        world = state.world(optimistic=True)
        upstream = upstream_providers(
            world, {m: leases.chosen_sources(m) for m in leases.wanted if leases.chosen_sources(m)}
        )
        uses, wanted = sensors_used(world), leases.wanted

        def seen_to(what: object) -> bool:
            return what in busy or what in o.failures

        modes = leases.wanted_modes()
        for sensor, mode in modes.items():
            settled = o.modes.get(sensor) == mode or sensor in o.lost
            assert settled or seen_to(sensor), (
                f"{where}: {sensor} is not brought into mode {mode}, which is held"
            )
            for job in (h for h in leases._demands.get(sensor, {}) if sensor not in leases.displaced(h)):
                accepted = leases._demands[sensor][job].accepts
                assert mode in accepted, f"{where}: {sensor} is in {mode}, {job} needs {accepted}"
        for provider in (o.active & o.owned & o.alive) - wanted:
            lingers = any(provider in upstream[m] for m in (o.active & o.owned) - wanted)
            assert seen_to(provider) or lingers, f"{where}: {provider} runs without a request"
        pending = {s for s, mode in modes.items() if o.modes.get(s) != mode and s not in o.lost}
        for provider in (wanted & o.alive) - o.active:
            cold = {m for m in upstream[provider] if m in wanted and o.warm_at_s.get(m, now_s) > now_s}
            waits = uses[provider] & pending or upstream[provider] & (wanted & o.alive) - o.active or cold
            assert seen_to(provider) or waits, f"{where}: {provider} is not started"


@pytest.fixture(autouse=True)
def simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    monkeypatch.setattr(os, "fsync", lambda _: None)


def endings(day: Day) -> Counter[str]:
    return Counter(line.rsplit(" ", 1)[1] for line in day.log)


@pytest.mark.req("CDFF-SUP-074")
@pytest.mark.parametrize(
    ("seed", "hours"),
    [(1, 0.5), (2, 0.5), pytest.param(3, 24.0, marks=[pytest.mark.slow, pytest.mark.timeout(900)])],
)
def test_the_service_keeps_its_invariants_over_requests_and_faults(
    seed: int, hours: float, tmp_path: Path
) -> None:
    day = Day(seed, tmp_path)
    day.run(hours * HOUR_S)
    assert not day.asked
    assert all(n == 1 for n in day.ended.values())
    assert len(day.ended) == day.count > 80 * hours
    how = endings(day)
    assert how["product"] > day.count / 4, how
    assert {"product", "UnavailableError"} <= set(how)
    numbers = [int(r["n"]) for r in day.orchestrator._journal.records() if "n" in r]
    assert numbers[-1] - day.mission.history <= 200, (
        "the DPM's history has followed the journal, each record once"
    )
    assert day.most["open"] <= 2 * CAPACITY, "those that made room end at once"
    assert day.most["jobs"] <= CAPACITY + 200
    assert day.most["looks"] <= CAPACITY
    assert day.most["cached"] <= 16
    assert day.most["attempts"] <= 16


def test_a_seed_reproduces_its_day(tmp_path: Path) -> None:
    days = []
    for i in range(2):
        (tmp_path / str(i)).mkdir()
        days.append(Day(7, tmp_path / str(i)))
        days[-1].run(HOUR_S / 6)
    assert days[0].log == days[1].log
    assert days[0].events == days[1].events
    assert days[0].log
