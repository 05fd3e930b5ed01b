# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM's history has each decision of the orchestrator exactly once, also after either was killed."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.cli import main
from cdff_common.client import Client
from cdff_common.errors import CdffError
from cdff_dev.ports import free_port
from tests.integration.conftest import process_starter
from tests.integration.conftest import wait_until as eventually

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")


def history(bus: Bus) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = []
    with suppress(CdffError):  # the DPM may be unavailable
        items = bus.call(keys.dpm_rpc("ground", "history"), {}, timeout_s=5).body()["items"]
    return [i for i in items if i.get("origin") == "orchestrator/mana"]


def send_refused_request(client: Client) -> str:
    """Send a request without a provider; return the id of its job."""
    with pytest.raises(CdffError):
        client.request("trajectory", robot="minnie", deadline_s=1.0)
    return str(client.jobs(limit=1)[0]["job"])


@pytest.mark.slow
def test_the_history_is_complete_after_a_dpm_and_an_orchestrator_were_killed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, tmp_path) as spawn:
        spawn("services.router")
        store = ("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        dpm, orchestrator = spawn(*store), spawn("services.orchestrator", "--profile", PROFILE)
        with Bus.open(endpoint, name="reader", wait_s=20) as bus, Client(endpoint) as client:

            def alive(service: str) -> bool:
                return keys.alive("mana", service) in bus.alive(keys.alive("mana", "*"))

            def states(job: str) -> list[str]:
                return [i["state"] for i in history(bus) if i["kind"] == "job" and i["job"] == job]

            eventually(lambda: alive("dpm") and alive("orchestrator"), 40, "start-up")
            first = send_refused_request(client)
            eventually(lambda: states(first)[-1:] == ["failed"], 20, "the first job in the history")

            dpm.kill()
            dpm.wait()
            second = send_refused_request(client)
            orchestrator.kill()  # records not yet forwarded are only in its journal
            orchestrator.wait()
            eventually(lambda: not alive("orchestrator"), 20, "the end of the orchestrator")
            spawn(*store)
            spawn("services.orchestrator", "--profile", PROFILE)
            eventually(lambda: states(second)[-1:] == ["failed"], 40, "the second job in the history")

            items = history(bus)
            numbers = [i["number"] for i in items]
            assert numbers == list(range(1, len(numbers) + 1))
            assert [i["kind"] for i in items].count("start") == 2
            received = next(
                i for i in items if i["kind"] == "job" and i["job"] == second and i["state"] == "failed"
            )
            assert received["scope"] == "minnie"
            assert received["reason"]
            command = [
                "orchestrator",
                "history",
                "--connect",
                endpoint,
                "--job",
                second,
                "--robot",
                "minnie",
                "--json",
            ]
            assert main(command) == 0
            items_of_command = json.loads(capsys.readouterr().out)["items"]
            assert [i["state"] for i in items_of_command] == states(second)
