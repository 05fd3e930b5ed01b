# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The asyncio client, tested with a substitute of the synchronous client."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest

from cdff_common.client import AsyncClient, async_client
from cdff_common.errors import UnavailableError


class SlowClient:
    """A substitute for ``Client``: a ``dem`` request waits until it is cancelled, others return at once."""

    def __init__(self, connect: str | None, *, name: str) -> None:
        self.cancelled: list[tuple[str, str]] = []
        self.requests: list[dict[str, Any]] = []
        self.is_cancelled, self.is_requested, self.is_closed = threading.Event(), threading.Event(), False

    def request(self, product: str, **parameters: Any) -> str:
        self.requests.append(parameters)
        parameters["on_progress"]({"job": "j1", "state": "received"})
        self.is_requested.set()
        if product == "dem":
            assert self.is_cancelled.wait(10)
            raise UnavailableError("job j1 was cancelled")
        return f"a {product}"

    def cancel(self, job: str, robot: str) -> None:
        self.cancelled.append((job, robot))
        self.is_cancelled.set()

    def jobs(self, robot: str, *, limit: int) -> list[dict[str, Any]]:
        return [{"robot": robot}] * limit

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def slow_clients(monkeypatch: pytest.MonkeyPatch) -> list[SlowClient]:
    results: list[SlowClient] = []

    def make(connect: str | None, *, name: str) -> SlowClient:
        results.append(SlowClient(connect, name=name))
        return results[-1]

    monkeypatch.setattr(async_client, "Client", make)
    return results


def test_concurrent_requests_do_not_block_each_other(slow_clients: list[SlowClient]) -> None:
    async def run() -> None:
        states: list[str] = []
        async with AsyncClient() as c:
            pending = asyncio.create_task(c.request("dem", robot="mana"))
            pose = await c.request(
                "pose", max_age_s=3.0, on_progress=lambda body: states.append(body["state"])
            )
            assert pose == "a pose"
            assert await c.jobs("mana", limit=2) == [{"robot": "mana"}] * 2
            assert states == ["received"]
            await c.cancel("j1", "mana")
            with pytest.raises(UnavailableError, match="cancelled"):
                await pending
        assert slow_clients[0].is_closed
        assert {a.get("max_age_s") for a in slow_clients[0].requests} == {None, 3.0}

    asyncio.run(run())


@pytest.mark.req("CDFF-SUP-075")
def test_a_cancelled_task_cancels_its_request(slow_clients: list[SlowClient]) -> None:
    async def run() -> None:
        async with AsyncClient() as c:
            task = asyncio.create_task(c.request("dem", robot="mana"))
            assert await asyncio.to_thread(slow_clients[0].is_requested.wait, 10)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert await asyncio.to_thread(slow_clients[0].is_cancelled.wait, 10)
        assert slow_clients[0].cancelled == [("j1", "mana")]

    asyncio.run(run())


def test_a_client_that_is_not_open_states_how_to_open_it() -> None:
    with pytest.raises(UnavailableError, match="async with"):
        asyncio.run(AsyncClient().jobs())
