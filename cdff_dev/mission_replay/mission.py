# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay of a mission: recorded samples and scripted requests at their times, with the services of a system.

Orchestrator, DPM, instrument control unit and DFPCs are those of a running system; bus and time are
simulated. Time is that of the log and computation takes none, so that two replays give the same result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from cdff_common.bus import Bus, Reply, keys
from cdff_common.clock import NS_PER_S
from cdff_common.codecs import encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.errors import CdffError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.profile import Profile
from cdff_dev.mission_replay.host import ReplayedDfpc
from cdff_dev.mission_replay.local_bus import LocalBus
from cdff_dev.mission_replay.script import ScriptedRequest
from cdff_dev.mission_replay.sensors import ReplayedIcu
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from cdff_dev.play.gate import SensorGate
from dpm_store import Store
from services.dpm.bus.retention import rules_of
from services.dpm.bus.service import serve
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.profile_entry import enter
from services.orchestrator.service import Orchestrator

#: Period of the status of the DFPCs, virtual seconds.
_STATUS_PERIOD_S = 1.0
#: Largest number of open requests.
_CAPACITY = 64


@dataclass(frozen=True, slots=True)
class RecordedSample:
    """A sample of the log with its robot, sensor and stream."""

    robot: str
    sensor: str
    stream: str
    sample: Sample


@dataclass(slots=True)
class ScriptedAnswer:
    """A request of the script and its answer.

    Attributes
    ----------
    request : ScriptedRequest
    after_s : float
        Mission time from the request to the final answer.
    reply : Reply or None
    error : CdffError or None
        Error of the request, if there is no reply.
    progress : list of str
        States, with their reasons, before the final answer.
    """

    request: ScriptedRequest
    after_s: float = 0.0
    reply: Reply | None = None
    error: CdffError | None = None
    progress: list[str] = field(default_factory=list)


class LogClock:
    """The mission clock: the first stamp of the log plus the virtual time."""

    def __init__(self, start_ns: int, scheduler: Scheduler) -> None:
        self._start_ns, self._scheduler = start_ns, scheduler

    def now_ns(self) -> int:
        """Return the mission time, a multiple of 1000 ns."""
        return self._start_ns + round(self._scheduler.now_s * 1e6) * 1000


class MissionReplay:
    """The system of a profile, with samples from a log and requests from a script.

    Parameters
    ----------
    profile : Profile
    start_ns : int
        Stamp of the first sample.
    open_store : callable
        Returns the open store of the DPM, given the mission clock.
    journal : Path
        File of the journal of the orchestrator.
    on_product : callable
        Called with every product of the DFPCs, in order.

    Attributes
    ----------
    dfpcs : dict of (str, str) to ReplayedDfpc
        DFPCs by robot and name.
    delivered, gated : int
        Numbers of samples that were delivered, and that were withheld because of the mode of their sensor.
    """

    def __init__(
        self,
        profile: Profile,
        start_ns: int,
        open_store: Callable[[LogClock], Store],
        journal: Path,
        on_product: Callable[[Product], None],
    ) -> None:
        self._scheduler = Scheduler()
        self._start_ns = start_ns
        clock = LogClock(start_ns, self._scheduler)
        self.bus = LocalBus(clock)
        self._gate, self._on_product = SensorGate(), on_product
        self._undistributed: deque[Product] = deque()
        self.delivered = self.gated = 0
        self.store = open_store(clock)
        enter(self.store, profile)
        self.dpm = Dpm(self.store)
        bus = cast(Bus, self.bus)  # LocalBus has every method that the services call
        serve(bus, self.dpm, profile.robot_ids, rules_of(profile))
        ReplayedIcu(self.bus, profile, self._scheduler, self._gate)
        self.dfpcs = {
            (robot.id, entry.name): ReplayedDfpc(self.bus, robot, entry, self._undistributed.extend)
            for robot in profile.robots
            for entry in robot.dfpcs
        }
        self._timing = VirtualTiming(self._scheduler)
        self._orchestrator = Orchestrator(bus, profile, journal, _CAPACITY, self._timing)

    def run(
        self, samples: Iterable[RecordedSample], script: Sequence[ScriptedRequest]
    ) -> list[ScriptedAnswer]:
        """Play the samples and send the requests; return when every request has its final answer."""
        answers = [ScriptedAnswer(scripted) for scripted in script]
        pending = {"the log", *(a.request.request.id for a in answers)}

        def start(name: str, run: Callable[[], None]) -> None:
            def run_and_record_end() -> None:
                run()
                pending.discard(name)

            self._scheduler.start(run_and_record_end, name)

        self._scheduler.start(self._orchestrator.start, "orchestrator")
        self._scheduler.start(self._publish_status, "status")
        start("the log", lambda: self._play(samples))
        for answer in answers:
            start(answer.request.request.id, lambda a=answer: self._send(a))  # type: ignore[misc]
        while pending:
            self._scheduler.step()
        closing = self._scheduler.start(self._orchestrator.close, "close")
        while not closing.done:
            self._scheduler.step()
        for dfpc in self.dfpcs.values():
            dfpc.finish()
            self._distribute()
        return answers

    def _play(self, samples: Iterable[RecordedSample]) -> None:
        """Deliver the samples in time; those that the mode of their sensor suppresses are counted."""
        for recorded in samples:
            sample = recorded.sample
            self._wait_until(sample.stamp_ns)
            if not self._gate.passes(recorded.robot, recorded.sensor, recorded.stream, sample.stamp_ns):
                self.gated += 1
                continue
            self.delivered += 1
            self._deliver(recorded.robot, f"sensor/{recorded.sensor}/{recorded.stream}", sample)

    def _send(self, answer: ScriptedAnswer) -> None:
        """Send a scripted request at its time and store the reply, or the error."""
        scripted = answer.request
        self._wait_until(scripted.at_ns)
        start_s = self._scheduler.now_s
        try:
            key = keys.orchestrator_rpc(keys.GROUND, "request")
            for reply in self.bus.call_stream(key, {**scripted.parameters, "progress": "true"}):
                if reply.final:
                    answer.reply = reply
                else:
                    body = reply.body()
                    answer.progress.append(
                        f"{body['state']}: {body['reason']}" if body["reason"] else str(body["state"])
                    )
        except CdffError as error:
            answer.error = error
        answer.after_s = self._scheduler.now_s - start_s

    def _publish_status(self) -> None:
        while True:
            for dfpc in self.dfpcs.values():
                dfpc.publish_status()
            self._scheduler.sleep(_STATUS_PERIOD_S)

    def _wait_until(self, stamp_ns: int) -> None:
        wait_s = (stamp_ns - self._start_ns) / NS_PER_S - self._scheduler.now_s
        if wait_s > 0:
            self._scheduler.sleep(wait_s)

    def _deliver(self, robot: str, source: str, sample: Sample) -> None:
        for (owner, _), dfpc in self.dfpcs.items():
            if owner == robot:
                dfpc.take(source, sample)
                self._distribute()

    def _distribute(self) -> None:
        """Store new products and pass them to the DFPCs that are wired to them, in order of production."""
        while self._undistributed:
            product = self._undistributed.popleft()
            self._on_product(product)
            if product.value is None:
                continue
            if product.product:
                self._store(product)
            header = product.header
            sample = Sample(
                port="",
                stamp_ns=header.t1_ns,
                seq=header.seq,
                value=product.value,
                id=header.id,
                frame=header.frame,
                child=header.child or "",
                quality=header.quality,
            )
            for (owner, _), dfpc in self.dfpcs.items():
                if owner == product.robot:
                    dfpc.take(f"product/{product.dfpc}/{product.port}", sample)

    def _store(self, product: Product) -> None:
        """Store a product in the DPM."""
        names = {
            "robot": product.robot,
            "dfpc": product.dfpc,
            "port": product.port,
            "product": product.product,
        }
        encoding = encoding_string(wire_type(product.value), "uper")
        self.dpm.writer.put(names, encode(product.value, "uper"), encoding, product.header.to_attachment())
