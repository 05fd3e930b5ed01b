# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The client for asyncio, over a client that answers when told to."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest

from cdff_common.client import AsyncClient, aio
from cdff_common.errors import UnavailableError


class Slow:
    """Stands for ``Client``: a request for a ``dem`` waits until it is cancelled, others are answered at once."""

    def __init__(self, connect: str | None, *, name: str) -> None:
        self.cancelled: list[tuple[str, str]] = []
        self.asked: list[dict[str, Any]] = []
        self.is_cancelled, self.is_asked, self.is_closed = threading.Event(), threading.Event(), False

    def request(self, product: str, **asked: Any) -> str:
        self.asked.append(asked)
        asked["on_progress"]({"job": "j1", "state": "received"})
        self.is_asked.set()
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
def slow(monkeypatch: pytest.MonkeyPatch) -> list[Slow]:
    made: list[Slow] = []

    def make(connect: str | None, *, name: str) -> Slow:
        made.append(Slow(connect, name=name))
        return made[-1]

    monkeypatch.setattr(aio, "Client", make)
    return made


def test_requests_under_way_at_a_time_do_not_hold_each_other_up(slow: list[Slow]) -> None:
    async def ask() -> None:
        states: list[str] = []
        async with AsyncClient() as c:
            waiting = asyncio.create_task(c.request("dem", robot="mana"))
            pose = await c.request("pose", max_age_s=3.0, on_progress=lambda body: states.append(body["state"]))
            assert pose == "a pose"
            assert await c.jobs("mana", limit=2) == [{"robot": "mana"}] * 2
            assert states == ["received"]
            await c.cancel("j1", "mana")
            with pytest.raises(UnavailableError, match="cancelled"):
                await waiting
        assert slow[0].is_closed
        assert {a.get("max_age_s") for a in slow[0].asked} == {None, 3.0}

    asyncio.run(ask())


@pytest.mark.req("CDFF-SUP-075")
def test_a_cancelled_task_cancels_its_request(slow: list[Slow]) -> None:
    async def ask() -> None:
        async with AsyncClient() as c:
            task = asyncio.create_task(c.request("dem", robot="mana"))
            assert await asyncio.to_thread(slow[0].is_asked.wait, 10)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert await asyncio.to_thread(slow[0].is_cancelled.wait, 10)
        assert slow[0].cancelled == [("j1", "mana")]

    asyncio.run(ask())


def test_a_client_that_is_not_open_says_how_to_open_it() -> None:
    with pytest.raises(UnavailableError, match="async with"):
        asyncio.run(AsyncClient().jobs())
