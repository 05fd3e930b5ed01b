# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logging of a process: text on a terminal, otherwise JSON lines; log files are rotated.

Libraries only call ``logging.getLogger``.
"""

from __future__ import annotations

import json
import logging
import sys
import threading
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path

from cdff_common.clock import format_stamp, monotonic_s
from cdff_common.terminal import styled

#: Size at which a log file is rotated, and number of rotated files that are kept.
LOG_BYTES, LOGS_KEPT = 16_000_000, 3
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


class TextLines(logging.Formatter):
    """Formatter of a record as a line for people: time, level, service, message; coloured by level."""

    _COLOURS = {"WARNING": "yellow", "ERROR": "red", "CRITICAL": "red"}

    def __init__(self, service: str) -> None:
        super().__init__()
        self._service = service

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line, followed by its traceback."""
        time = format_stamp(int(record.created * 1e6) * 1000)[11:19]
        style = self._COLOURS.get(record.levelname, "faint")
        level = styled(f"{record.levelname:8}", style, sys.stderr)
        line = f"{time} {level} {self._service}: {record.getMessage()}"
        return line + (f"\n{self.formatException(record.exc_info)}" if record.exc_info else "")


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


def configure_logging(service: str, level: str = "INFO", folder: Path | None = None) -> None:
    """Write every log record of this process as JSON lines, or as text if standard error is a terminal.

    Parameters
    ----------
    service : str
        Name of the process in the records.
    level : str
        Lowest level that is written.
    folder : Path, optional
        Existing folder of the file ``{service}.log``, which is rotated; by default standard error is used,
        whose reader must limit its size.
    """
    handler: logging.Handler = logging.StreamHandler(sys.stderr)
    if folder is not None:
        path = folder / f"{service}.log"
        handler = RotatingFileHandler(path, maxBytes=LOG_BYTES, backupCount=LOGS_KEPT, encoding="utf-8")
    is_for_people = folder is None and sys.stderr.isatty()
    handler.setFormatter(TextLines(service) if is_for_people else JsonLines(service))
    handler.addFilter(RepetitionFilter())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
