# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An input that the DPM holds: read again where a read failed."""

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
from services.dfpc_host.stored import StoredInput


class Dpm:
    """A bus with a DPM that gives one answer after the other, the last for ever."""

    def __init__(self, *answers: Reply | DeadlineError) -> None:
        self.answers = list(answers)
        self.tell: Callable[[Message], None]

    def subscribe(self, _key: str, callback: Callable[[Message], None]) -> SimpleNamespace:
        self.tell = callback
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


def until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.mark.parametrize("bad", [DeadlineError("no answer within 10 s"), Reply(b"", "encoding", {"v": 1})])
def test_an_update_whose_read_failed_is_read_again(bad: Reply | DeadlineError, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dfpc_host.stored._RETRY_S", 0.02)
    dpm, read = Dpm(reply(1)), []
    stored = StoredInput(dpm, "dpm/orbiter/dem", "located.orbital", lambda m: read.append(m.payload))  # type: ignore[arg-type]
    until(lambda: read)
    dpm.answers = [bad, reply(2)]
    dpm.tell(Message("key", pack({"product": "dem", "robot": "orbiter"}), "", b""))
    until(lambda: len(read) == 2)
    stored.close()
    assert read == [b"1", b"2"]
    assert stored.waits == ""


def test_why_an_update_was_not_read_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dfpc_host.stored._RETRY_S", 0.02)
    dpm, read = Dpm(reply(1)), []
    stored = StoredInput(dpm, "dpm/orbiter/dem", "located.orbital", lambda m: read.append(m.payload))  # type: ignore[arg-type]
    until(lambda: read)
    dpm.answers = [DeadlineError("no answer within 10 s")]
    dpm.tell(Message("key", pack({"product": "dem", "robot": "orbiter"}), "", b""))
    until(lambda: "no answer" in stored.waits)
    stored.close()
