# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scopes that an orchestrator serves and announces."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Request, keys
from cdff_common.interfaces.registry import Registry
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator.service import Orchestrator
from tests.support import orchestrator_mission
from tests.support.simulated_bus import Mission, SimulatedBus


class ScopeBus(SimulatedBus):
    """The simulated bus, which records by scope whether the service of requests is a stand-in."""

    def __init__(self, mission: Mission, timing: VirtualTiming) -> None:
        super().__init__(mission, timing)
        self.stands_in: dict[str, bool] = {}
        self.services: dict[str, str] = {}

    def serve(
        self, key: str, handler: Callable[[Request], Any], *, stands_in: bool = False, **_: Any
    ) -> None:
        super().serve(key, handler)
        for scope in ("ground", "mana", "minnie"):
            if key == keys.orchestrator_rpc(scope, "request"):
                self.stands_in[scope] = stands_in

    def declare_alive(self, scope: str, service: str) -> None:
        self.services[scope] = service


@pytest.mark.parametrize(
    ("scope", "services"),
    [
        ("", {"ground": "orchestrator", "mana": "orchestrator", "minnie": "orchestrator"}),
        ("mana", {"mana": "orchestrator"}),
        (
            "ground",
            {"ground": "orchestrator", "mana": "orchestrator_ground", "minnie": "orchestrator_ground"},
        ),
    ],
)
def test_the_orchestrator_of_the_ground_is_a_stand_in_in_the_scopes_of_robots(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, scope: str, services: dict[str, str]
) -> None:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    scheduler = Scheduler()
    mission = Mission(scheduler, orchestrator_mission.profile(), 1, failure_rate=0.0)
    timing = VirtualTiming(scheduler)
    bus = ScopeBus(mission, timing)
    orchestrator = Orchestrator(
        bus,  # type: ignore[arg-type]
        mission.profile,
        tmp_path / "journal.jsonl",
        timing=timing,  # type: ignore[arg-type]
        scope=scope,
    )
    timing.start(orchestrator.start, "start")
    while bus.services.keys() != services.keys() and scheduler.now_s < 10.0:
        assert scheduler.step()
    assert bus.services == services
    assert bus.stands_in == {name: service != "orchestrator" for name, service in services.items()}
