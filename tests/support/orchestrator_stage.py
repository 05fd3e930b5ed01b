# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator in virtual time on the simulated mission, with clients in separate tasks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cdff_common.bus import Reply, Request, keys
from cdff_common.errors import CdffError
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.world import ProviderId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator.service import Orchestrator
from tests.support import orchestrator_mission
from tests.support.simulated_bus import Mission, Process

DEM = {"type": "dem", "robot": "mana", "max_age_s": "4", "deadline_ms": "40000"}


class Stage:
    """A mission without faults, an orchestrator, and clients."""

    def __init__(
        self, folder: Path, profile: Profile | None = None, refuses: Mapping[str, Sequence[str]] = {}
    ) -> None:
        self.folder = folder
        self.scheduler = Scheduler()
        self.mission = Mission(self.scheduler, profile or orchestrator_mission.profile(), 1, failure_rate=0.0)
        for sensor, modes in refuses.items():
            self.refuse(sensor, modes)
        self.start_orchestrator()
        self.run_until(lambda: all(p.alive for p in self.mission.processes.values()), 10.0)
        self.run(3.0)

    def start_orchestrator(self) -> None:
        self.timing = VirtualTiming(self.scheduler)
        self.bus = self.mission.connect(self.timing)
        self.orchestrator = Orchestrator(
            self.bus,
            self.mission.profile,
            self.folder / "journal.jsonl",
            8,
            self.timing,  # type: ignore[arg-type]
        )
        self.timing.start(self.orchestrator.start, "start")

    def refuse(self, sensor: str, modes: Sequence[str], robot: str = "mana") -> None:
        """Let a sensor refuse some modes from now on."""
        machine = self.mission.icu._machines[robot, sensor]
        machine.sensor = machine.sensor.model_copy(update={"refuses": tuple(modes)})

    def process(self, name: str, robot: str = "mana") -> Process:
        return self.mission.processes[ProviderId(robot, name)]

    def send(self, **parameters: str) -> list[Any]:
        """Send a request in a separate task.

        The returned list receives the replies, the error if there is one, and at last the time of the end.
        """
        received: list[Any] = []

        def client() -> None:
            try:
                received.extend(self.bus.query(keys.orchestrator_rpc("ground", "request"), parameters))
            except CdffError as error:
                received.append(error)
            received.append(self.scheduler.now_s)

        self.timing.start(client, "client")
        return received

    def call(self, verb: str, **parameters: str) -> Any:
        key = keys.orchestrator_rpc("ground", verb)
        return self.bus.handlers[key](Request(key, parameters, b"", "", b"")).body()

    def run(self, seconds: float) -> None:
        self.run_until(lambda: False, seconds)

    def run_until(self, is_done: Callable[[], bool], limit_s: float) -> bool:
        until_s = self.scheduler.now_s + limit_s
        while self.scheduler.now_s < until_s and not is_done():
            assert self.scheduler.step()
        return is_done()

    def final_answer(self, received: list[Any], limit_s: float = 60.0) -> Any:
        """Run until a request has ended; return its final reply or error."""
        has_ended = self.run_until(lambda: bool(received) and isinstance(received[-1], float), limit_s)
        assert has_ended, "no final reply"
        return received[-2]

    def journal_text(self) -> str:
        return " ".join(str(r) for r in self.orchestrator._journal.records())


def provider_of(reply: Any) -> str:
    """Return the DFPC whose product a reply delivers."""
    assert isinstance(reply, Reply), reply
    return str(reply.attachment["delivered"]["source"]).split("/")[0]
