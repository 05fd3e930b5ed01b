# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An input port that reads products from the DPM repeats a failed read."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from cdff_common.bus import Message, Reply
from cdff_common.bus.message import pack
from cdff_common.errors import DeadlineError
from cdff_common.interfaces.product import Header, product_id
from services.dfpc_host.inputs import StoredInput


class Dpm:
    """A bus whose DPM returns the given answers in order, and then the last one repeatedly."""

    def __init__(self, *answers: Reply | DeadlineError) -> None:
        self.answers = list(answers)
        self.notify: Callable[[Message], None]

    def subscribe(self, _key: str, callback: Callable[[Message], None]) -> SimpleNamespace:
        self.notify = callback
        return SimpleNamespace(close=lambda: None)

    def call(self, *_: Any, **__: Any) -> Reply:
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, DeadlineError):
            raise answer
        return answer


def reply(seq: int) -> Reply:
    header = Header(
        id=product_id("orbiter", "survey", "dem", 0, seq, ""),
        seq=seq,
        t0_ns=0,
        t1_ns=0,
        frame="site",
        producer="survey",
    )
    return Reply(b"%d" % seq, "encoding", header.to_dict())


def wait_until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.mark.parametrize(
    "failure", [DeadlineError("no answer within 10 s"), Reply(b"", "encoding", {"v": 1})]
)
def test_a_failed_read_of_an_update_is_repeated(
    failure: Reply | DeadlineError, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.dfpc_host.inputs._RETRY_S", 0.02)
    dpm, payloads = Dpm(reply(1)), []
    bus: Any = dpm
    stored = StoredInput(bus, "dpm/orbiter/dem", "located.orbital", lambda m: payloads.append(m.payload))
    wait_until(lambda: payloads)
    dpm.answers = [failure, reply(2)]
    dpm.notify(Message("key", pack({"product": "dem", "robot": "orbiter"}), "", b""))
    wait_until(lambda: len(payloads) == 2)
    stored.close()
    assert payloads == [b"1", b"2"]
    assert stored.waiting_reason == ""


def test_the_reason_of_a_failed_read_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dfpc_host.inputs._RETRY_S", 0.02)
    dpm, payloads = Dpm(reply(1)), []
    bus: Any = dpm
    stored = StoredInput(bus, "dpm/orbiter/dem", "located.orbital", lambda m: payloads.append(m.payload))
    wait_until(lambda: payloads)
    dpm.answers = [DeadlineError("no answer within 10 s")]
    dpm.notify(Message("key", pack({"product": "dem", "robot": "orbiter"}), "", b""))
    wait_until(lambda: "no answer" in stored.waiting_reason)
    stored.close()
