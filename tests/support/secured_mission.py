# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A secured router as a process, and the buses of the identities of a mission."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Reply, keys
from cdff_common.bus.message import on_map
from cdff_dev.ports import free_port
from services.keys.mission_keys import MissionKeys
from tests.integration.conftest import process_starter, wait_until
from tests.support.identities import make_identities, open_as


@dataclass
class Mission:
    """A secured router and the buses of its identities; ``refused`` are its events."""

    keys: MissionKeys
    endpoint: str
    buses: dict[str, Bus] = field(default_factory=dict)
    refused: list[dict[str, Any]] = field(default_factory=list)
    alarms: list[dict[str, Any]] = field(default_factory=list)
    served: set[str] = field(default_factory=set)

    def bus(self, name: str) -> Bus:
        """Return the open bus of an identity."""
        if name not in self.buses:
            self.buses[name] = open_as(self.keys.folder / name, self.endpoint, wait_s=20)
        return self.buses[name]

    def serve_once(self, name: str, key: str) -> None:
        """Answer calls of a key with ``done``."""
        if key not in self.served:
            self.served.add(key)
            self.bus(name).serve(key, lambda _: Reply(b"done"))

    def expect_refusal(self, identity: str, operation: str, key: str = "") -> None:
        """Wait for the event of a refusal; the identity is a prefix of the common name."""

        def is_reported() -> bool:
            return any(
                r["identity"].startswith(identity) and r["operation"] == operation and key in r["key"]
                for r in self.refused
            )

        wait_until(is_reported, 5, f"the event of {operation} {key} by {identity or 'a stranger'}")


@contextmanager
def secured_mission(folder: Path) -> Iterator[Mission]:
    """Run a secured router until the context ends."""
    running = Mission(make_identities(folder / "secrets"), f"tls/127.0.0.1:{free_port()}")
    identity = str(folder / "secrets" / "ground")
    with process_starter(running.endpoint, folder, CDFF_IDENTITY=identity) as start:
        start("services.router")
        ground = running.bus("ground")
        ground.subscribe(
            keys.event("ground", "refused"), on_map(lambda _, body: running.refused.append(body))
        )
        ground.subscribe(keys.event("ground", "alarm"), on_map(lambda _, body: running.alarms.append(body)))
        yield running
        for bus in running.buses.values():
            bus.close()
