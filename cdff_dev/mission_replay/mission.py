# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission on a log: recorded samples and scripted requests at their times, with the orchestrator's own
service.

Orchestrator, DPM, instrument control unit and DFPCs are those of a running system; bus and time are
simulated. Time is the log's and computing takes none, so that two replays give the same result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from cdff_common.bus import Bus, Reply, keys
from cdff_common.clock import NS_PER_S
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.codecs.size_variants import wire_type
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
from services.dpm.__main__ import anchor
from services.dpm.bus.retention import rules_of
from services.dpm.bus.service import serve
from services.dpm.operations.dpm import Dpm
from services.orchestrator.service import Orchestrator

_BEAT_S = 1.0
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
    """A request of the script and its final answer.

    Attributes
    ----------
    request : ScriptedRequest
    after_s : float
        From the request to the answer, mission time.
    reply : Reply or None
    error : CdffError or None
        The error, if there is no reply.
    progress : list of str
        States and reasons before the final answer.
    """

    request: ScriptedRequest
    after_s: float = 0.0
    reply: Reply | None = None
    error: CdffError | None = None
    progress: list[str] = field(default_factory=list)


class LogClock:
    """The mission clock: the log's first stamp plus virtual time."""

    def __init__(self, start_ns: int, scheduler: Scheduler) -> None:
        self._start_ns, self._scheduler = start_ns, scheduler

    def now_ns(self) -> int:
        """Mission time, a multiple of 1000 ns."""
        return self._start_ns + round(self._scheduler.now_s * 1e6) * 1000


class MissionReplay:
    """A mission on a log.

    Parameters
    ----------
    profile : Profile
    start_ns : int
        Stamp of the first sample.
    open_store : callable
        Opens the DPM's store, given the mission clock.
    journal : Path
        File for the orchestrator's journal.
    on_product : callable
        Called with every product of the DFPCs, in order.

    Attributes
    ----------
    dfpcs : dict of (str, str) to ReplayedDfpc
        By robot and name.
    delivered, gated : int
        Samples that sensors delivered, and that their modes held back.
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
        self._waiting: deque[Product] = deque()
        self.delivered = self.gated = 0
        self.store = open_store(clock)
        anchor(self.store, profile)
        self.dpm = Dpm(self.store)
        bus = cast(Bus, self.bus)  # it has every method that they call
        serve(bus, self.dpm, profile.robot_ids, rules_of(profile))
        ReplayedIcu(self.bus, profile, self._scheduler, self._gate)
        self.dfpcs = {
            (robot.id, entry.name): ReplayedDfpc(self.bus, robot, entry, self._waiting.extend)
            for robot in profile.robots
            for entry in robot.dfpcs
        }
        self._timing = VirtualTiming(self._scheduler)
        self._orchestrator = Orchestrator(bus, profile, journal, _CAPACITY, self._timing)

    def run(
        self, samples: Iterable[RecordedSample], script: Sequence[ScriptedRequest]
    ) -> list[ScriptedAnswer]:
        """Play the samples and send the requests; returns once every request has its final answer."""
        answers = [ScriptedAnswer(scripted) for scripted in script]
        pending = {"the log", *(a.request.request.id for a in answers)}

        def task(name: str, run: Callable[[], None]) -> None:
            def run_to_its_end() -> None:
                run()
                pending.discard(name)

            self._scheduler.start(run_to_its_end, name)

        self._scheduler.start(self._orchestrator.start, "orchestrator")
        self._scheduler.start(self._beat, "heartbeat")
        task("the log", lambda: self._play(samples))
        for answered in answers:
            task(answered.request.request.id, lambda a=answered: self._ask(a))  # type: ignore[misc]
        while pending:
            self._scheduler.step()
        closing = self._scheduler.start(self._orchestrator.close, "close")
        while not closing.done:
            self._scheduler.step()
        for dfpc in self.dfpcs.values():
            dfpc.finish()
            self._distribute()
        return answers

    # -- tasks
    # ------------------------------------------------------------------------------------------------------

    def _play(self, samples: Iterable[RecordedSample]) -> None:
        for recorded in samples:
            sample = recorded.sample
            self._wait_until(sample.stamp_ns)
            if not self._gate.passes(recorded.robot, recorded.sensor, recorded.stream, sample.stamp_ns):
                self.gated += 1
                continue
            self.delivered += 1
            self._deliver(recorded.robot, f"sensor/{recorded.sensor}/{recorded.stream}", sample)

    def _ask(self, answered: ScriptedAnswer) -> None:
        scripted = answered.request
        self._wait_until(scripted.at_ns)
        start_s = self._scheduler.now_s
        try:
            key = keys.orchestrator_rpc(keys.GROUND, "request")
            for reply in self.bus.call_stream(key, {**scripted.parameters, "progress": "true"}):
                if reply.final:
                    answered.reply = reply
                else:
                    body = reply.body()
                    answered.progress.append(
                        f"{body['state']}: {body['reason']}" if body["reason"] else str(body["state"])
                    )
        except CdffError as error:
            answered.error = error
        answered.after_s = self._scheduler.now_s - start_s

    def _beat(self) -> None:
        while True:
            for dfpc in self.dfpcs.values():
                dfpc.publish_status()
            self._scheduler.sleep(_BEAT_S)

    def _wait_until(self, stamp_ns: int) -> None:
        wait_s = (stamp_ns - self._start_ns) / NS_PER_S - self._scheduler.now_s
        if wait_s > 0:
            self._scheduler.sleep(wait_s)

    # -- samples and products
    # -----------------------------------------------------------------------------------------

    def _deliver(self, robot: str, source: str, sample: Sample) -> None:
        for (owner, _), dfpc in self.dfpcs.items():
            if owner == robot:
                dfpc.take(source, sample)
                self._distribute()

    def _distribute(self) -> None:
        """Store products and pass them to the DFPCs that are wired to them, in the order of their
        production.
        """
        while self._waiting:
            product = self._waiting.popleft()
            self._on_product(product)
            if product.value is None:
                continue
            if product.product:
                self._store(product)
            h = product.header
            sample = Sample(
                port="",
                stamp_ns=h.t1_ns,
                seq=h.seq,
                value=product.value,
                id=h.id,
                frame=h.frame,
                child=h.child or "",
                quality=h.quality,
            )
            for (owner, _), dfpc in self.dfpcs.items():
                if owner == product.robot:
                    dfpc.take(f"product/{product.dfpc}/{product.port}", sample)

    def _store(self, product: Product) -> None:
        names = {
            "robot": product.robot,
            "dfpc": product.dfpc,
            "port": product.port,
            "product": product.product,
        }
        encoding = encoding_string(wire_type(product.value), "uper")
        self.dpm.writer.put(names, encode(product.value, "uper"), encoding, product.header.to_attachment())
