# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A bus whose calls are recorded and answered by a function of the test."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.bus import Reply
from cdff_common.bus.message import unpack
from cdff_common.clock import Clock, ManualClock
from cdff_common.errors import CdffError, NoAnswerError


@dataclass(frozen=True)
class Call:
    """A recorded call."""

    key: str
    parameters: dict[str, Any]
    body: Any = None
    is_elsewhere: bool = False

    @property
    def verb(self) -> str:
        return self.key.rsplit("/", 1)[1]


@dataclass
class RecordingBus:
    """The methods of ``cdff_common.bus.Bus`` for calls and tokens.

    ``answer`` returns the body of the answer to a call, or the error; background calls whose answer is None
    stay open until ``end``.
    """

    answer: Callable[[Call], dict[str, Any] | CdffError | None]
    mission_clock: Clock = field(default_factory=lambda: ManualClock(0))
    calls: list[Call] = field(default_factory=list)
    open: list[tuple[Call, Callable[[Reply | CdffError], None]]] = field(default_factory=list)
    on_alive: Callable[[str, bool], None] = lambda key, is_alive: None

    def call(self, key: str, parameters: Mapping[str, Any] | None = None, **options: Any) -> Reply:
        call = self._record(key, parameters, options)
        answer = self.answer(call)
        if isinstance(answer, CdffError):
            raise answer
        return Reply.of(answer or {})

    def call_in_background(
        self,
        key: str,
        parameters: Mapping[str, Any] | None,
        on_end: Callable[[Reply | CdffError], None],
        **options: Any,
    ) -> None:
        call = self._record(key, parameters, options)
        answer = self.answer(call)
        if answer is None:
            self.open.append((call, on_end))
        else:
            on_end(answer if isinstance(answer, CdffError) else Reply.of(answer))

    def _record(self, key: str, parameters: Mapping[str, Any] | None, options: Mapping[str, Any]) -> Call:
        payload = options.get("payload", b"")
        body = unpack(payload) if payload else None
        call = Call(key, dict(parameters or {}), body, bool(options.get("elsewhere")))
        self.calls.append(call)
        return call

    def end(self, result: dict[str, Any] | CdffError) -> None:
        """End the first open background call."""
        _, on_end = self.open.pop(0)
        on_end(result if isinstance(result, CdffError) else Reply.of(result))

    def watch_alive(self, _: str, on_alive: Callable[[str, bool], None]) -> None:
        self.on_alive = on_alive

    def of(self, verb: str) -> list[Call]:
        """Return the calls of a verb."""
        return [call for call in self.calls if call.verb == verb]


def no_answer(_: Call) -> CdffError:
    """Answer of a bus without a peer."""
    return NoAnswerError("no queryable")
