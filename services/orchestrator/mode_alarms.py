# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of the instrument control unit: it refuses a mode, does not confirm it, or does not answer."""

from __future__ import annotations

import threading

from cdff_common.errors import CdffError, CodecError, DeadlineError, DeniedError, NoAnswerError
from cdff_core.orchestration.world import SensorId
from services.alarms import Alarms, Severity
from services.orchestrator.timing import REAL, Timing

#: An alarm ends when the mode is confirmed, or after this time without a further demand, seconds.
QUIET_S = 600.0
#: Time after the start of the orchestrator in which a unit that does not run yet is no alarm, seconds.
START_S = 15.0
#: What the operator does, by kind.
REMEDIES = {
    "mode_refused": "check the sensor; other modes and sensors are used meanwhile",
    "mode_unconfirmed": "check the unit: its answers do not confirm the demanded mode",
    "unit_silent": "check that the unit runs and answers",
}


class ModeAlarms:
    """Alarms of the demanded sensor modes; thread-safe. The source of each is ``robot/sensor/mode``."""

    def __init__(self, alarms: Alarms, timing: Timing = REAL) -> None:
        self._alarms, self._timing = alarms, timing
        self._started_s = timing.now_s()
        self._lock = threading.Lock()
        self._failed_s: dict[tuple[str, str], float] = {}

    def is_expected(self, error: CdffError) -> bool:
        """Return True for a unit that does not run yet, in the first ``START_S`` seconds."""
        return isinstance(error, NoAnswerError) and self._timing.now_s() - self._started_s < START_S

    def report(self, sensor: SensorId, mode: str, error: CdffError) -> None:
        """Begin the alarm of a failed demand; a lost sensor or a conflicting demand is no fault of the unit.

        The services of a system start together: a demand to a unit that does not run yet is repeated.
        """
        kind = _kind(error)
        if kind and not self.is_expected(error):
            source = _source(sensor, mode)
            with self._lock:
                self._failed_s[kind, source] = self._timing.now_s()
            self._alarms.set(kind, source, Severity.WARNING, str(error), REMEDIES[kind])

    def confirm(self, sensor: SensorId, mode: str) -> None:
        """End the alarms of a mode that was confirmed."""
        for kind in REMEDIES:
            self._end(kind, _source(sensor, mode))

    def update(self) -> None:
        """End each alarm whose mode has not failed for ``QUIET_S`` seconds; call it regularly."""
        limit_s = self._timing.now_s() - QUIET_S
        with self._lock:
            quiet = [key for key, failed_s in self._failed_s.items() if failed_s < limit_s]
        for kind, source in quiet:
            self._end(kind, source)

    def _end(self, kind: str, source: str) -> None:
        with self._lock:
            self._failed_s.pop((kind, source), None)
        self._alarms.clear(kind, source)


def _source(sensor: SensorId, mode: str) -> str:
    return f"{sensor.robot}/{sensor.sensor}/{mode}"


def _kind(error: CdffError) -> str:
    if isinstance(error, DeniedError):
        return "mode_refused"
    if isinstance(error, CodecError):
        return "mode_unconfirmed"
    is_silent = isinstance(error, DeadlineError | NoAnswerError) or type(error) is CdffError
    return "unit_silent" if is_silent else ""
