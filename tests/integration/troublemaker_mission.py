# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a mission whose robot mana has the DFPC ``troublemaker``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cdff_common.bus import Bus, keys
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter, wait_until

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")


def start_services(spawn: Spawn) -> None:
    """Start the router, the DPM, the ICU and the host of the DFPC, but no orchestrator."""
    spawn("services.router")
    spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
    spawn("services.icu", "--profile", PROFILE)
    spawn("services.dfpc_host", "--profile", PROFILE, "--process", "mana_troublemaker")


def wait_for_services(endpoint: str, *others: str) -> None:
    """Wait until the services of mana, its orchestrator and others, by their liveliness tokens, answer."""
    wanted = {keys.alive("mana", s) for s in ("dpm", "orchestrator", "icu", "troublemaker")} | set(others)
    with Bus.open(endpoint, name="test", wait_s=20) as bus:
        wait_until(lambda: wanted <= bus.alive(keys.alive("*", "*")), 40, "start-up")


@contextmanager
def troublemaker_mission(folder: Path) -> Iterator[str]:
    """Run the services with one orchestrator for all robots, and yield the endpoint of the router."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as spawn:
        start_services(spawn)
        spawn("services.orchestrator", "--profile", PROFILE)
        wait_for_services(endpoint)
        yield endpoint
