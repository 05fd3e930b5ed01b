# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Commands of the ground segment: PUS service 8 (perform a function) and command files over CFDP."""

from __future__ import annotations

import logging
import queue
import threading
from collections import Counter
from collections.abc import Callable

from spacepackets.ecss.tc import PusTc

from cdff_common.errors import CdffError, CodecError, DeniedError
from cdff_common.loops import Loop
from services.gateway_ccsds.authentication import Command, CommandCounter, CommandKey
from services.gateway_ccsds.telemetry import EventSeverity, Failure, Stage, Telemetry

logger = logging.getLogger(__name__)

_SERVICE, _SUBTYPE = 8, 1
#: Commands that wait for their execution.
_MAX_WAITING = 16

_Waiting = tuple[Command, "PusTc | None", str]


class CommandReceiver:
    """Checks commands, and executes them one after the other in a thread.

    Parameters
    ----------
    robot : str
    apid : int
    key : CommandKey or None
        None to refuse all commands.
    counter : CommandCounter
    telemetry : Telemetry
        For verification reports; a command file is reported by events.
    execute : callable
        Executes a command and returns its result in words; raises CdffError.
    loop : Loop
        Health of the thread.

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
        execute: Callable[[Command], str],
        loop: Loop,
    ) -> None:
        self._robot, self._apid, self._key, self._counter = robot, apid, key, counter
        self._telemetry, self._execute = telemetry, execute
        self._waiting: queue.Queue[_Waiting | None] = queue.Queue(_MAX_WAITING)
        self._lock = threading.Lock()
        self._thread = threading.Thread(
            target=loop.run, args=(self._waiting.get, self._work), name="commands"
        )
        self._thread.daemon = True
        self._thread.start()
        self.counters: Counter[str] = Counter()

    def close(self) -> None:
        """End after the present command."""
        self._waiting.put(None)
        self._thread.join(5.0)

    def on_packet(self, data: bytes) -> None:
        """Take a telecommand packet; without a valid checksum and APID it is dropped and counted."""
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
        """Take a command file."""
        self._accept(content, None, f"file {name[:60]}")

    def _accept(self, data: bytes, tc: PusTc | None, source: str) -> None:
        with self._lock:
            try:
                if self._key is None:
                    raise DeniedError("commands are refused: the settings name no command_key")
                command = self._key.open(self._robot, data)
                if self._waiting.full():
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
            self._waiting.put((command, tc, source))

    def _refuse(self, tc: PusTc | None, source: str, failure: Failure, text: str) -> None:
        self.counters["refused"] += 1
        logger.warning("command of a %s is refused: %s", source, text)
        if tc is None:
            self._telemetry.event(EventSeverity.LOW, "command_refused", source, text)
        else:
            self._telemetry.verification(tc, Stage.ACCEPTANCE, failure, text)

    def _work(self, waiting: _Waiting) -> None:
        command, tc, _ = waiting
        if tc is not None:
            self._telemetry.verification(tc, Stage.START)
        name = command.function.name.lower()
        try:
            result = self._execute(command)
        except CdffError as error:
            self.counters["failed"] += 1
            text = f"{type(error).__name__}: {error}"
            if tc is not None:
                self._telemetry.verification(tc, Stage.COMPLETION, Failure.EXECUTION, text)
            self._telemetry.event(EventSeverity.LOW, "command_failed", name, text)
            return
        self.counters["executed"] += 1
        if tc is not None:
            self._telemetry.verification(tc, Stage.COMPLETION)
        self._telemetry.event(EventSeverity.INFORMATIVE, "command_executed", name, result)
