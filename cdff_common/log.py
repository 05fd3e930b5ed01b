# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logging of processes as JSON lines on standard error; libraries only call ``logging.getLogger``."""

from __future__ import annotations

import json
import logging
import sys
import threading
from collections.abc import Callable

from cdff_common.clock import format_stamp, monotonic_s

#: Message templates whose repetitions are counted.
_MAX_TEMPLATES = 1000
_OWN_FIELDS = set(logging.makeLogRecord({}).__dict__) | {"message", "asctime", "taskName"}


class JsonLines(logging.Formatter):
    """Formatter of a record as a JSON object: time, level, service, logger, message and extra fields."""

    def __init__(self, service: str) -> None:
        super().__init__()
        self._service = service

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line of JSON."""
        line: dict[str, object] = {
            "time": format_stamp(int(record.created * 1e6) * 1000),
            "level": record.levelname,
            "service": self._service,
            "logger": record.name,
            "message": record.getMessage(),
        }
        line.update({k: v for k, v in record.__dict__.items() if k not in _OWN_FIELDS})
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class RepetitionFilter(logging.Filter):
    """Filter that passes ``limit`` warnings and errors of one message template per period.

    A flood of malformed messages then does not fill the disk. The next passed record has the number of
    suppressed ones as ``suppressed``.
    """

    def __init__(
        self, limit: int = 20, period_s: float = 60.0, now_s: Callable[[], float] = monotonic_s
    ) -> None:
        super().__init__()
        self._limit, self._period_s, self._now_s = limit, period_s, now_s
        self._lock = threading.Lock()
        #: Start of the period, passed and suppressed records of each logger and template.
        self._counts: dict[tuple[str, str], tuple[float, int, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return True if a record is written."""
        if record.levelno < logging.WARNING:
            return True
        key, now_s = (record.name, str(record.msg)), self._now_s()
        with self._lock:
            since_s, passed, suppressed = self._counts.get(key, (now_s, 0, 0))
            if now_s - since_s >= self._period_s:
                since_s, passed = now_s, 0
            if passed >= self._limit:
                self._counts[key] = (since_s, passed, suppressed + 1)
                return False
            if len(self._counts) >= _MAX_TEMPLATES and key not in self._counts:
                self._counts.clear()
            self._counts[key] = (since_s, passed + 1, 0)
        if suppressed:
            record.suppressed = suppressed
        return True


def configure_logging(service: str, level: str = "INFO") -> None:
    """Write every log record of this process to standard error as JSON lines."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines(service))
    handler.addFilter(RepetitionFilter())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
