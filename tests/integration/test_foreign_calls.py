# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls of other systems over a real router: no failed call occupies a place, and refusals are limited."""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from cdff_common.bus import Bus
from cdff_common.bus import foreign as foreign_module
from cdff_common.bus.foreign import ForeignCall
from cdff_common.errors import UnavailableError
from tests.integration.conftest import Eventually

pytestmark = pytest.mark.integration

KEY = "0/ask/type/hash"


@pytest.fixture
def pair(router: subprocess.Popen[bytes], endpoint: str) -> Iterator[tuple[Bus, Bus]]:
    with (
        Bus.open(endpoint, name="server", wait_s=10) as server,
        Bus.open(endpoint, name="client", wait_s=10) as client,
    ):
        yield server, client


def _ask(client: Bus, payload: bytes = b"") -> str:
    """Return the answer, or the reason of the refusal."""
    try:
        answer = client.foreign.call(KEY, payload, encoding="e", attachment=b"", timeout_s=5.0)
    except UnavailableError as error:
        return str(error)
    return answer.payload.decode()


def test_a_call_whose_answer_cannot_be_sent_occupies_no_place(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair

    def handle(call: ForeignCall) -> None:
        faults: dict[bytes, Any] = {b"encoding": "e" * 300, b"payload": "e"}
        payload: Any = object() if call.payload == b"payload" else b"yes"
        call.reply(payload, encoding=faults.get(call.payload, "e"), attachment=b"")

    server.foreign.serve(KEY, handle, limit=1)
    eventually(lambda: _ask(client) == "yes")
    for fault, reason in ((b"encoding", "at most 255"), (b"payload", "no service answers")) * 20:
        assert reason in _ask(client, fault)
        assert _ask(client) == "yes"


def test_refused_calls_that_wait_are_limited(
    pair: tuple[Bus, Bus], eventually: Eventually, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_module, "_MAX_REFUSALS", 4)
    server, client = pair
    foreign_server = server.foreign.serve(KEY, lambda call: call.reply(b"yes", encoding="e", attachment=b""))
    eventually(lambda: _ask(client) == "yes")
    is_blocked = threading.Event()
    foreign_server._refusals.submit(is_blocked.wait, 20.0)
    foreign_server._max_bytes = 10
    session: zenoh.Session = client.foreign._session
    start_s = time.monotonic()
    calls = [session.get(KEY, payload=b"x" * 20, timeout=15.0) for _ in range(20)]
    ended = [list(replies) for replies in calls[4:]]
    assert time.monotonic() - start_s < 10.0, "further calls end at once"
    assert not any(ended)
    is_blocked.set()
    for replies in calls[:4]:
        (reply,) = replies
        assert reply.err is not None
        assert b"20 bytes, expected at most 10" in reply.err.payload.to_bytes()
    assert "expected at most 10" in _ask(client, b"x" * 20), "later calls are refused again"


def test_calls_beyond_the_limit_are_refused_until_one_is_answered(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair
    kept: list[ForeignCall] = []

    def handle(call: ForeignCall) -> None:
        if call.payload == b"probe":
            call.reply(b"yes", encoding="e", attachment=b"")
        else:
            kept.append(call)

    server.foreign.serve(KEY, handle, limit=2)
    eventually(lambda: _ask(client, b"probe") == "yes")
    session: zenoh.Session = client.foreign._session
    open_calls = [session.get(KEY, payload=b"", timeout=15.0)]
    eventually(lambda: len(kept) == 1)
    open_calls.append(session.get(KEY, payload=b"", timeout=15.0))
    eventually(lambda: len(kept) == 2)
    assert "too many calls at once" in _ask(client)
    assert len(kept) == 2
    kept[0].reply(b"yes", encoding="e", attachment=b"")
    open_calls.append(session.get(KEY, payload=b"", timeout=15.0))
    eventually(lambda: len(kept) == 3)
    assert "too many calls at once" in _ask(client)
    assert len(kept) == 3


def test_a_call_that_waits_for_a_thread_counts_as_open(
    pair: tuple[Bus, Bus], eventually: Eventually, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, client = pair
    foreign_server = server.foreign.serve(
        KEY, lambda call: call.reply(b"yes", encoding="e", attachment=b""), limit=1
    )
    eventually(lambda: _ask(client) == "yes")
    pool = foreign_server._pool
    submit, waiting = pool.submit, []

    def without_threads(*work: Any) -> None:
        waiting.append(work)  # as the pool of the library keeps it
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(pool, "submit", without_threads)
    session: zenoh.Session = client.foreign._session
    first = session.get(KEY, payload=b"", timeout=15.0)
    eventually(lambda: waiting)
    assert "too many calls at once" in _ask(client)
    assert len(waiting) == 1
    monkeypatch.setattr(pool, "submit", submit)
    submit(*waiting[0])
    (reply,) = first
    assert reply.ok is not None
    assert _ask(client) == "yes"
