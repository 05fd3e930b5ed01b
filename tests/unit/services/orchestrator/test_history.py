# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Records of the journal reach the history of the DPM once, in order, also after failures."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cdff_common.bus import keys
from cdff_common.bus.message import unpack
from cdff_common.errors import InputError, UnavailableError
from cdff_common.loops import Loops
from services.orchestrator.history import HistoryForwarder, entry_of
from services.orchestrator.journal import Journal
from services.orchestrator.timing import Timing


class Waits(Timing):
    """Timing whose events do not wait, and note for how long they should."""

    def __init__(self, stop_after: int = 1000) -> None:
        self.waits_s: list[float | None] = []
        self._stop_after = stop_after

    def event(self) -> threading.Event:
        event = threading.Event()

        def wait(timeout: float | None = None) -> bool:
            self.waits_s.append(timeout)
            if len(self.waits_s) >= self._stop_after:
                event.set()
            return event.is_set()

        event.wait = wait  # type: ignore[method-assign]
        return event


class History:
    """Bus with the history of a DPM that answers with the last number, and refuses or fails on demand."""

    def __init__(self, last: int = 0, failures: int = 0, refuses: int | None = None) -> None:
        self.calls: list[list[int]] = []
        self.stored: list[dict[str, Any]] = []
        self._last, self._failures, self._refuses = last, failures, refuses

    def call(self, key: str, *, payload: bytes, timeout_s: float) -> Any:
        assert key == keys.dpm_rpc(keys.GROUND, "history")
        assert timeout_s > 0.0
        entries = unpack(payload)["entries"]
        self.calls.append([entry["number"] for entry in entries])
        if self._failures > 0:
            self._failures -= 1
            raise UnavailableError("no answer")
        if self._refuses in self.calls[-1]:
            raise InputError("refused")
        self.stored += entries
        self._last = max([self._last, *self.calls[-1]])
        return SimpleNamespace(body=lambda: {"last": self._last})


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    opened = Journal(tmp_path / "journal.jsonl")
    yield opened
    opened.close()


def forwarder(history: History, journal: Journal, timing: Timing) -> HistoryForwarder:
    return HistoryForwarder(history, journal, "mission", Loops(), timing)  # type: ignore[arg-type]


def test_records_after_the_last_acknowledged_one_are_sent_once_and_in_order(journal: Journal) -> None:
    for number in range(5):
        journal.append("mode", sensor="mana/lidar", ok=number % 2 == 0)
    history = History(last=2)
    sender = forwarder(history, journal, Waits())
    sender._forward(True)
    sender._forward(True)
    assert history.calls == [[], [3, 4, 5]]
    journal.append("start")
    sender._forward(True)
    assert history.calls[2:] == [[6]]


def test_a_batch_has_at_most_two_hundred_records(journal: Journal) -> None:
    for _ in range(401):
        journal.append("start", durable=False)
    history = History()
    forwarder(history, journal, Waits())._forward(True)
    assert [len(call) for call in history.calls] == [0, 200, 200, 1]
    assert [entry["number"] for entry in history.stored] == list(range(1, 402))


def test_a_failed_call_is_repeated_after_twice_the_time_up_to_ten_seconds(journal: Journal) -> None:
    journal.append("start")
    history, timing = History(failures=7), Waits()
    forwarder(history, journal, timing)._forward(True)
    assert timing.waits_s == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    assert [entry["number"] for entry in history.stored] == [1]


def test_a_refused_record_does_not_block_the_others(journal: Journal) -> None:
    for _ in range(3):
        journal.append("start")
    history = History(refuses=2)
    forwarder(history, journal, Waits())._forward(True)
    assert [entry["number"] for entry in history.stored] == [1, 3]


def test_nothing_more_is_sent_once_stopped(journal: Journal) -> None:
    journal.append("start")
    history, timing = History(failures=100), Waits(stop_after=2)
    forwarder(history, journal, timing)._forward(True)
    assert len(history.calls) == 2
    sender = forwarder(history, journal, Waits())
    sender.close()
    sender._forward(True)
    assert len(history.calls) == 2


@pytest.mark.parametrize(
    ("record", "scope"),
    [
        ({"dfpc": "mana/lidar_slam", "state": "active"}, "mana"),
        ({"sensor": "minnie/lidar", "ok": True}, "minnie"),
        ({"robot": "any"}, "ground"),
        ({"robot": "mana"}, "mana"),
        ({}, "ground"),
    ],
)
def test_the_scope_of_an_entry_is_the_robot_of_its_subject(record: dict[str, Any], scope: str) -> None:
    entry = entry_of({"n": 7, "stamp_ns": 11, "kind": "mode", **record})
    assert entry == {"number": 7, "stamp_ns": 11, "scope": scope, "kind": "mode", "body": record}


def test_a_malformed_answer_is_repeated(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    history, answers = History(), iter([{"wrong": 1}, None, {"last": "x"}, {"last": 0}])
    call: Callable[..., Any] = history.call

    def malformed(*args: Any, **kwargs: Any) -> Any:
        call(*args, **kwargs)
        return SimpleNamespace(body=lambda: next(answers))

    monkeypatch.setattr(history, "call", malformed)
    forwarder(history, journal, Waits())._forward(True)
    assert history.calls == [[], [], [], []]
