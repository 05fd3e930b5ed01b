# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Open requests when the orchestrator or the router ends, and requests for unknown robots; real processes."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Client
from cdff_common.errors import NoAnswerError, ProductNotFoundError
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter
from tests.integration.conftest import wait_until as eventually

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")


@pytest.fixture
def spawn(tmp_path: Path) -> Iterator[tuple[str, Spawn]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, tmp_path) as start:
        start("services.router")
        yield endpoint, start


def raw_request(bus: Bus) -> tuple[threading.Thread, list[zenoh.Reply]]:
    """Send a request as a plain Zenoh query, which waits for a DFPC; the list receives the replies."""
    replies: list[zenoh.Reply] = []
    key = keys.orchestrator_rpc("ground", "request")

    def run() -> None:
        selector = f"{key}?type=pose;robot=mana;deadline_ms=60000"
        replies.extend(bus._session.get(selector, timeout=61.0, consolidation=zenoh.ConsolidationMode.NONE))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread, replies


def open_jobs(bus: Bus) -> int:
    jobs = bus.call(keys.orchestrator_rpc("ground", "jobs"), {"robot": "any"}).body()["jobs"]
    return sum(job["remaining_s"] is not None for job in jobs)


def test_an_orderly_stop_answers_every_open_request_as_retriable(spawn: tuple[str, Spawn]) -> None:
    endpoint, start = spawn
    orchestrator = start("services.orchestrator", "--profile", PROFILE)
    with Bus.open(endpoint, name="client", wait_s=20) as bus:
        eventually(lambda: bus.alive(keys.alive("ground", "orchestrator")), 30, "start-up")
        requests = [raw_request(bus) for _ in range(3)]
        eventually(lambda: open_jobs(bus) == 3, 20, "three open requests")
        orchestrator.send_signal(signal.SIGTERM)
        assert orchestrator.wait(10) == 0
        for thread, replies in requests:
            thread.join(2)
            assert not thread.is_alive()
            assert replies[-1].err is not None
            body = unpack(replies[-1].err.payload.to_bytes())
            assert (body["code"], body["retriable"]) == ("UNAVAILABLE", True)
            assert "stopping" in body["detail"]


def test_an_unknown_robot_is_not_found_at_once(spawn: tuple[str, Spawn]) -> None:
    endpoint, start = spawn
    start("services.orchestrator", "--profile", PROFILE)
    with Client(endpoint) as client:
        eventually(lambda: client._bus.alive(keys.alive("ground", "orchestrator")), 30, "start-up")
        start_s = time.monotonic()
        for call in (
            lambda: client.request("pose", robot="nosuch"),
            lambda: next(client.standing("pose", robot="nosuch")),
            lambda: client.explain("pose", robot="nosuch"),
            lambda: client.catalogue("nosuch"),
            lambda: client.jobs("nosuch"),
            lambda: client._bus.call(keys.orchestrator_rpc("ground", "jobs"), {"robot": "nosuch"}),
            lambda: client._bus.call(keys.orchestrator_rpc("ground", "catalogue"), {"robot": "nosuch"}),
        ):
            with pytest.raises(ProductNotFoundError, match=r"'nosuch'.*mana, minnie"):
                call()
        assert time.monotonic() - start_s < 5.0


def test_a_client_reports_a_lost_router_at_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, tmp_path) as start:
        router = start("services.router")
        with Client(endpoint) as client:
            router.kill()
            router.wait()
            with pytest.raises(NoAnswerError, match="connection to the router is lost"):
                client.request("pose", robot="mana", deadline_s=1.0)
    assert any("connection to the router is lost" in r.message for r in caplog.records)
