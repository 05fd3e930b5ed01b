# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Invariants of the orchestrator during a day of virtual time with random requests and faults.

The whole service runs (flow, finder, sharing, delivery, control, watcher, journal, history); the components
on the other side of the bus are simulated. DFPCs crash, hang, fail, produce nothing, receive nothing or give
degraded products; sensor modes are refused and sensors lost; the DPM and the ICU are interrupted; the
orchestrator is killed and restarted. The same seed gives the same sequence of steps in all threads.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
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
from tests.support.simulated_bus import Mission, Process, SimulatedBus

HOUR_S, DAY_S = 3600.0, 86_400.0
CAPACITY = 12
#: Tolerance of the deadline, because a wait may end exactly at it.
EPSILON_S = 1e-4


@dataclass
class SentRequest:
    """A request, the orchestrator process that received it, and its outcome."""

    name: str
    process: object
    deadline_s: float
    final_replies: int = 0
    #: Kind of the final reply, or name of the error.
    outcome: str = ""


class Day:
    """A mission, an orchestrator, clients and faults; checks the invariants after each step of a thread."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.scheduler = Scheduler()
        self.mission = Mission(self.scheduler, orchestrator_mission.profile(), seed)
        self.random = self.mission.random
        self.journal = folder / f"journal{seed}.jsonl"
        self.open_requests: dict[str, SentRequest] = {}
        self.ended: Counter[str] = Counter()
        self.log: list[str] = []
        self.request_count = self.steps = self.restarts = 0
        #: Largest size of each collection of the service.
        self.max_sizes: Counter[str] = Counter()
        self.is_over = False
        self.start_orchestrator()

    def start_orchestrator(self) -> None:
        """Start an orchestrator process with the journal of the previous one."""
        self.timing = VirtualTiming(self.scheduler)
        self.bus: SimulatedBus = self.mission.connect(self.timing)
        self.orchestrator = Orchestrator(self.bus, self.mission.profile, self.journal, CAPACITY, self.timing)  # type: ignore[arg-type]
        self.timing.start(self.orchestrator.start, "start")

    def run(self, until_s: float) -> None:
        """Run requests and faults, each at random intervals with the given mean."""
        for mean_s, event in (
            (40.0, self.send_requests),
            (900.0, self.crash),
            (1200.0, self.hang),
            (1200.0, self.fail),
            (1500.0, self.interrupt_output),
            (1500.0, self.degrade),
            (2400.0, self.interrupt_input),
            (2400.0, self.lose_sensor),
            (3000.0, self.interrupt_dpm),
            (5000.0, self.interrupt_icu),
            (9000.0, self.kill_orchestrator),
        ):
            self.scheduler.start(partial(self.repeat, mean_s, event, until_s), event.__name__)
        while not self.is_over or self.open_requests:
            self.is_over = self.scheduler.now_s >= until_s
            assert self.scheduler.step()
            self.steps += 1
            self.check()

    def repeat(self, mean_s: float, event: Callable[[], None], until_s: float) -> None:
        while self.scheduler.now_s < until_s:
            self.scheduler.sleep(self.random.expovariate(1.0 / mean_s))
            if self.scheduler.now_s < until_s:
                event()

    def send_requests(self) -> None:
        """Send one or two equal requests, rarely more than the capacity."""
        parameters = self.random_parameters()
        for _ in range(20 if self.random.random() < 0.02 else self.random.choice([1, 1, 1, 2])):
            self.request_count += 1
            self.send(f"r{self.request_count}", parameters)

    def random_parameters(self) -> dict[str, str]:
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

    def send(self, name: str, parameters: dict[str, str]) -> None:
        deadline_s = self.scheduler.now_s + int(parameters["deadline_ms"]) / 1000
        sent = self.open_requests[name] = SentRequest(name, self.timing, deadline_s)
        bus = self.bus
        self.timing.start(lambda: self.receive_replies(bus, sent, {**parameters, "request": name}), name)
        if self.random.random() < 0.08:
            after_s = self.random.uniform(0.1, 20.0)
            self.timing.start(lambda: self.cancel_or_renew(bus, sent, "cancel", after_s), f"cancel {name}")
        if "every_s" in parameters and self.random.random() < 0.5:
            self.timing.start(lambda: self.cancel_or_renew(bus, sent, "renew", 10.0), f"renew {name}")

    def receive_replies(self, bus: SimulatedBus, sent: SentRequest, parameters: dict[str, str]) -> None:
        try:
            for reply in bus.query(keys.orchestrator_rpc("ground", "request"), parameters):
                if reply.final:
                    sent.final_replies += 1
                    sent.outcome = str(reply.attachment.get("kind"))
        except CdffError as error:
            sent.final_replies += 1
            sent.outcome = type(error).__name__
        self.finish(sent)

    def cancel_or_renew(self, bus: SimulatedBus, sent: SentRequest, verb: str, after_s: float) -> None:
        """Cancel a request, or extend its deadline, if it is open after a time."""
        self.scheduler.sleep(after_s)
        key = keys.orchestrator_rpc("ground", verb)
        if sent.name in self.open_requests and key in bus.handlers:
            extension = {"deadline_ms": "20000"} if verb == "renew" else {}
            try:
                bus.handlers[key](Request(key, {"job": sent.name, "robot": "any", **extension}, b"", "", b""))
                if extension:
                    sent.deadline_s = max(sent.deadline_s, self.scheduler.now_s + 20.0)
            except CdffError:
                pass  # the job is not registered yet, or has ended

    def finish(self, sent: SentRequest) -> None:
        """Check that a request has one final reply before its deadline, and add it to the log."""
        del self.open_requests[sent.name]
        self.ended[sent.name] += 1
        assert self.ended[sent.name] == 1, f"{sent.name} ended twice"
        assert sent.final_replies == 1, f"{sent.name} has {sent.final_replies} final replies"
        late_s = self.scheduler.now_s - sent.deadline_s
        is_late = sent.outcome != NoAnswerError.__name__ and late_s > EPSILON_S
        assert not is_late, f"{sent.name}: final reply {late_s:.3f} s after the deadline: {sent.outcome}"
        self.log.append(f"{self.scheduler.now_s:.6f} {sent.name} {sent.outcome}")

    def random_process(self) -> Process:
        return self.mission.processes[self.random.choice(sorted(self.mission.processes))]

    def crash(self) -> None:
        process = self.random_process()
        if process.alive:
            self.mission.stop(process)
            self.scheduler.sleep(self.random.uniform(1.0, 20.0))
            self.mission.start(process)

    def hang(self) -> None:
        """Hang a process until its watchdog ends it and its supervisor restarts it."""
        process = self.random_process()
        if process.alive:
            process.is_hung = True
            self.scheduler.sleep(10.0)
            self.mission.stop(process)
            self.scheduler.sleep(2.0)
            self.mission.start(process)

    def fail(self) -> None:
        self.mission.fail(self.random_process())

    def interrupt_output(self) -> None:
        self.set_temporarily("produces_nothing")

    def degrade(self) -> None:
        self.set_temporarily("degraded")

    def interrupt_input(self) -> None:
        self.set_temporarily("receives_nothing")

    def set_temporarily(self, fault: str) -> None:
        process = self.random_process()
        assert not getattr(process, fault), f"{fault} of {process.id} is already set"
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

    def interrupt_dpm(self) -> None:
        self.mission.dpm_up = False
        self.scheduler.sleep(self.random.uniform(1.0, 15.0))
        self.mission.dpm_up = True

    def interrupt_icu(self) -> None:
        self.mission.icu_up = False
        for robot in self.mission.profile.robot_ids:
            self.mission.token(keys.alive(robot, "icu"), present=False)
        self.scheduler.sleep(self.random.uniform(1.0, 15.0))
        self.mission.icu_up = True
        for robot in self.mission.profile.robot_ids:
            self.mission.token(keys.alive(robot, "icu"), present=True)

    def kill_orchestrator(self) -> None:
        """Kill the orchestrator: its clients lose the connection, and a new process continues its journal."""
        self.restarts += 1
        killed = self.timing
        self.scheduler.kill(killed)
        self.mission.buses.clear()
        for scope in (*self.mission.profile.robot_ids, keys.GROUND):
            self.mission.token(keys.alive(scope, "orchestrator"), present=False)
        for sent in [s for s in self.open_requests.values() if s.process is killed]:
            sent.final_replies, sent.outcome = sent.final_replies + 1, NoAnswerError.__name__
            self.finish(sent)
        self.scheduler.sleep(self.random.uniform(0.5, 3.0))
        self.start_orchestrator()

    def check(self) -> None:
        where = f"step {self.steps} at {self.scheduler.now_s:.3f} s"
        state, registry = self.orchestrator._state, self.orchestrator._jobs
        observed, leases = state._observed, state._leases
        open_jobs = {j.id for j in registry._jobs.values() if j.state not in FINAL_STATES}
        holders = {h for provider in leases.wanted for h in leases.holders(provider)}
        assert holders <= open_jobs | {ALWAYS}, f"{where}: {holders - open_jobs} have leases and have ended"
        flow = self.orchestrator._flow
        sizes = {
            "open": len(open_jobs),
            "jobs": len(registry._jobs),
            "shared queries": len(flow._shared),
            "failures": len(observed.failures),
            "tasks": len(self.scheduler.tasks),
            "cached": len(flow.finder.dpm._values),
        }
        self.max_sizes |= Counter(sizes)
        if self.scheduler.is_waiting("control", self.timing) and self.scheduler.is_waiting(
            "watcher", self.timing
        ):
            self.check_control(where)

    def check_control(self, where: str) -> None:
        """Check that active and wanted providers agree, except those with an action in progress.

        Call it only while control and watcher wait, because they act on the differences.
        """
        state, busy = self.orchestrator._state, self.orchestrator._reconciler._busy
        observed, leases, now_s = state._observed, state._leases, self.scheduler.now_s
        world = state.world(optimistic=True)
        upstream = upstream_providers(
            world, {p: leases.chosen_sources(p) for p in leases.wanted if leases.chosen_sources(p)}
        )
        uses, wanted = sensors_used(world), leases.wanted

        def is_in_progress(item: object) -> bool:
            return item in busy or item in observed.failures

        modes = leases.wanted_modes()
        for sensor, mode in modes.items():
            is_settled = observed.modes.get(sensor) == mode or sensor in observed.lost
            assert is_settled or is_in_progress(sensor), (
                f"{where}: {sensor} is not switched to mode {mode}, which has a lease"
            )
            for job in (
                j for j in leases._modes._demands.get(sensor, {}) if sensor not in leases.displaced(j)
            ):
                accepted = leases._modes._demands[sensor][job].accepts
                assert mode in accepted, f"{where}: {sensor} is in {mode}, {job} needs {accepted}"
        for provider in (observed.active & observed.owned & observed.alive) - wanted:
            is_source_of_lingering = any(
                provider in upstream[consumer] for consumer in (observed.active & observed.owned) - wanted
            )
            assert is_in_progress(provider) or is_source_of_lingering, (
                f"{where}: {provider} runs without a request"
            )
        pending = {s for s, mode in modes.items() if observed.modes.get(s) != mode and s not in observed.lost}
        for provider in (wanted & observed.alive) - observed.active:
            warming_up = {
                p for p in upstream[provider] if p in wanted and observed.warm_at_s.get(p, now_s) > now_s
            }
            is_waiting = (
                uses[provider] & pending
                or upstream[provider] & (wanted & observed.alive) - observed.active
                or warming_up
            )
            assert is_in_progress(provider) or is_waiting, f"{where}: {provider} is not started"


@pytest.fixture(autouse=True)
def _simulated_registry_without_fsync(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    monkeypatch.setattr(os, "fsync", lambda _: None)


def outcomes(day: Day) -> Counter[str]:
    """Return how many requests have each outcome."""
    return Counter(line.rsplit(" ", 1)[1] for line in day.log)


@pytest.mark.req("CDFF-SUP-074")
@pytest.mark.parametrize(
    ("seed", "hours"),
    [
        pytest.param(1, 0.5, marks=pytest.mark.slow),
        pytest.param(2, 6.0, marks=pytest.mark.soak),
        pytest.param(3, 24.0, marks=[pytest.mark.soak, pytest.mark.timeout(1800)]),
    ],
)
def test_the_service_keeps_its_invariants_over_requests_and_faults(
    seed: int, hours: float, tmp_path: Path
) -> None:
    day = Day(seed, tmp_path)
    day.run(hours * HOUR_S)
    assert not day.open_requests
    assert all(n == 1 for n in day.ended.values())
    assert len(day.ended) == day.request_count > 80 * hours
    counts = outcomes(day)
    assert counts["product"] > day.request_count / 4, counts
    assert {"product", "UnavailableError"} <= set(counts)
    numbers = [int(r["n"]) for r in day.orchestrator._journal.records() if "n" in r]
    assert numbers[-1] - day.mission.history <= 200, (
        "records of the journal are missing in the history of the DPM"
    )
    assert day.max_sizes["open"] <= 2 * CAPACITY, "evicted jobs did not end at once"
    assert day.max_sizes["jobs"] <= CAPACITY + 200
    assert day.max_sizes["shared queries"] <= CAPACITY
    assert day.max_sizes["cached"] <= 16
    assert day.max_sizes["failures"] <= 16


@pytest.mark.slow
def test_a_seed_reproduces_its_day(tmp_path: Path) -> None:
    days = []
    for i in range(2):
        (tmp_path / str(i)).mkdir()
        days.append(Day(7, tmp_path / str(i)))
        days[-1].run(HOUR_S / 6)
    assert days[0].log == days[1].log
    assert days[0].steps == days[1].steps
    assert days[0].log
