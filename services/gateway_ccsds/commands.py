# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reception of commands of the ground segment: PUS service 8 (perform a function) and files over CFDP."""

from __future__ import annotations

import logging
import queue
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

from spacepackets.ecss.tc import PusTc

from cdff_common.errors import CdffError, CodecError, DeniedError
from cdff_common.loops import Loop
from services.gateway_ccsds.authentication import Command, CommandCounter, CommandKey, Function
from services.gateway_ccsds.telemetry import EventSeverity, Failure, Stage, Telemetry

logger = logging.getLogger(__name__)

_SERVICE, _SUBTYPE = 8, 1
#: Commands that wait for their execution in one thread.
_MAX_WAITING = 16

_Waiting = tuple[Command, "PusTc | None"]
_Queue = queue.Queue["_Waiting | None"]
#: Executes a command, calls the second argument with its progress in words, and returns its result in words.
Execute = Callable[[Command, Callable[[str], None]], str]


class CommandReceiver:
    """Checks commands, and executes them one after the other in a thread; cancellations in another one.

    Parameters
    ----------
    robot : str
    apid : int
    key : CommandKey or None
        None to refuse all commands.
    counter : CommandCounter
    telemetry : Telemetry
        Sends verification reports of packets, and events for command files.
    execute : callable
        Executes a command; its exceptions are reported as failures.
    loop, cancel_loop : Loop
        Health of the threads.

    Attributes
    ----------
    counters : Counter
        ``accepted``, ``refused``, ``executed`` and ``failed`` commands.
    """

    def __init__(
        self,
        robot: str,
        apid: int,
        key: CommandKey | None,
        counter: CommandCounter,
        telemetry: Telemetry,
        execute: Execute,
        loop: Loop,
        cancel_loop: Loop,
    ) -> None:
        self._robot, self._apid, self._key, self._counter = robot, apid, key, counter
        self._telemetry, self._execute = telemetry, execute
        self._lock = threading.Lock()
        self.counters: Counter[str] = Counter()
        self._waiting, self._cancellations = _Queue(_MAX_WAITING), _Queue(_MAX_WAITING)
        self._threads = [
            threading.Thread(target=health.run, args=(waiting.get, self._work), name=health.name, daemon=True)
            for health, waiting in ((loop, self._waiting), (cancel_loop, self._cancellations))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop after the current commands; commands that wait are not executed."""
        with self._lock:
            for waiting in (self._waiting, self._cancellations):
                with suppress(queue.Empty):
                    while True:
                        waiting.get_nowait()
                waiting.put(None)
        for thread in self._threads:
            thread.join(5.0)

    def on_packet(self, data: bytes) -> None:
        """Process a telecommand packet; one with a wrong checksum or APID is counted and dropped."""
        try:
            tc = PusTc.unpack(data)
        except Exception as error:  # noqa: BLE001  # the library does not list its errors
            self.counters["malformed"] += 1
            logger.warning("telecommand: %s: %s", type(error).__name__, error)
            return
        if tc.apid != self._apid:
            self.counters["malformed"] += 1
            return
        if (tc.service, tc.message_subtype) != (_SERVICE, _SUBTYPE):
            name = f"service {tc.service} subtype {tc.message_subtype}: expected {_SERVICE} and {_SUBTYPE}"
            self._refuse(tc, "packet", Failure.MALFORMED, name)
            return
        self._accept(bytes(tc.app_data), tc, "packet")

    def on_file(self, name: str, content: bytes) -> None:
        """Process a command file."""
        self._accept(content, None, f"file {name[:60]}")

    def _accept(self, data: bytes, tc: PusTc | None, source: str) -> None:
        with self._lock:
            try:
                if self._key is None:
                    raise DeniedError("commands are refused: the settings name no command_key")
                command = self._key.open(self._robot, data)
                waiting = self._cancellations if command.function is Function.CANCEL else self._waiting
                if waiting.full():
                    self._refuse(tc, source, Failure.OVERLOADED, f"{_MAX_WAITING} commands wait")
                    return
                self._counter.take(command.counter)
            except (CodecError, DeniedError, OSError) as error:
                code = Failure.MALFORMED if isinstance(error, CodecError) else Failure.DENIED
                self._refuse(tc, source, code, str(error))
                return
            self.counters["accepted"] += 1
            if tc is not None:
                self._telemetry.verification(tc, Stage.ACCEPTANCE)
            waiting.put((command, tc))

    def _refuse(self, tc: PusTc | None, source: str, failure: Failure, text: str) -> None:
        self.counters["refused"] += 1
        logger.warning("command of a %s is refused: %s", source, text)
        if tc is None:
            self._telemetry.event(EventSeverity.LOW, "command_refused", source, text)
        else:
            self._telemetry.verification(tc, Stage.ACCEPTANCE, failure, text)

    def _work(self, waiting: _Waiting) -> None:
        command, tc = waiting
        if tc is not None:
            self._telemetry.verification(tc, Stage.START)
        name = command.function.name.lower()

        def report(text: str) -> None:
            self._telemetry.event(EventSeverity.INFORMATIVE, "command_progress", name, text)

        try:
            result = self._execute(command, report)
        except Exception as error:
            self._fail(tc, name, f"{type(error).__name__}: {error}")
            if not isinstance(error, CdffError | OSError):
                raise  # the loop counts and logs it
            return
        self.counters["executed"] += 1
        if tc is not None:
            self._telemetry.verification(tc, Stage.COMPLETION)
        self._telemetry.event(EventSeverity.INFORMATIVE, "command_executed", name, result)

    def _fail(self, tc: PusTc | None, name: str, text: str) -> None:
        self.counters["failed"] += 1
        logger.warning("command %s failed: %s", name, text)
        if tc is not None:
            self._telemetry.verification(tc, Stage.COMPLETION, Failure.EXECUTION, text)
        self._telemetry.event(EventSeverity.LOW, "command_failed", name, text)
