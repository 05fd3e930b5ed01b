# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Paused calls continue once: after their signal, or after their time."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from cdff_common.bus import Pause, Reply, Signal, without_pauses
from cdff_common.bus.pause import PausedCalls
from cdff_common.clock import monotonic_s
from cdff_common.loops import Loops

LONG_S = 60.0


class Continued:
    """Counts its calls."""

    def __init__(self) -> None:
        self.count, self.event = 0, threading.Event()

    def __call__(self) -> None:
        self.count += 1
        self.event.set()


@pytest.fixture
def calls() -> Iterator[PausedCalls]:
    paused = PausedCalls(Loops())
    yield paused
    paused.close()


def test_a_call_continues_when_its_signal_is_set(calls: PausedCalls) -> None:
    signal, continued = Signal(), Continued()
    calls.add(Pause(signal, LONG_S), continued)
    assert continued.count == 0
    for _ in range(3):
        signal.set()
    assert continued.count == 1


def test_a_call_whose_signal_is_set_does_not_pause(calls: PausedCalls) -> None:
    signal, continued = Signal(), Continued()
    signal.set()
    calls.add(Pause(signal, LONG_S), continued)
    assert continued.count == 1
    signal.clear()
    calls.add(Pause(signal, LONG_S), continued)
    assert continued.count == 1


def test_calls_continue_in_the_order_of_their_times(calls: PausedCalls) -> None:
    order: list[str] = []
    last = Continued()
    start_s = monotonic_s()
    calls.add(Pause(Signal(), LONG_S), lambda: order.append("never"))
    calls.add(Pause(Signal(), 0.2), lambda: (order.append("second"), last()))
    calls.add(Pause(Signal(), 0.1), lambda: order.append("first"))
    assert last.event.wait(10.0)
    assert order == ["first", "second"]
    assert monotonic_s() - start_s >= 0.2


@pytest.mark.parametrize("timeout_s", [0.0, -1.0])
def test_a_pause_without_time_continues_at_once(calls: PausedCalls, timeout_s: float) -> None:
    continued = Continued()
    calls.add(Pause(Signal(), timeout_s), continued)
    assert continued.count == 1


def test_a_signal_after_the_time_continues_nothing_again(calls: PausedCalls) -> None:
    signal, continued = Signal(), Continued()
    calls.add(Pause(signal, 0.01), continued)
    assert continued.event.wait(10.0)
    signal.set()
    assert continued.count == 1


def test_signals_and_times_at_once_continue_every_call_once(calls: PausedCalls) -> None:
    signals, continued = [Signal() for _ in range(500)], [Continued() for _ in range(500)]
    for signal, call in zip(signals, continued, strict=True):
        calls.add(Pause(signal, 0.02), call)
    for signal in signals:
        signal.set()
    assert all(call.event.wait(10.0) for call in continued)
    assert [call.count for call in continued] == [1] * 500


def test_a_closed_list_continues_calls_only_by_their_signals(calls: PausedCalls) -> None:
    signal, continued = Signal(), Continued()
    calls.add(Pause(signal, LONG_S), continued)
    calls.close()
    calls.add(Pause(Signal(), 0.01), Continued())
    signal.set()
    assert continued.count == 1


def test_a_call_that_cannot_be_continued_does_not_end_the_thread() -> None:
    loops, continued = Loops(), Continued()
    calls = PausedCalls(loops)

    def fail() -> None:
        raise OSError("no thread")

    calls.add(Pause(Signal(), 0.01), fail)
    calls.add(Pause(Signal(), 0.05), continued)
    assert continued.event.wait(10.0)
    assert loops.describe()["paused calls"]["errors"] == 1
    calls.close()


def test_replies_without_pauses_wait_in_the_calling_thread() -> None:
    signal = Signal()

    def handler() -> Iterator[Reply | Pause]:
        yield Reply.of(1)
        yield Pause(signal, 0.05)
        yield Reply.of(2)

    start_s = monotonic_s()
    assert [reply.body() for reply in without_pauses(handler())] == [1, 2]
    assert monotonic_s() - start_s >= 0.05
