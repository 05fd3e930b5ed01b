# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Heartbeat of a process to its supervisor: one byte per period in a pipe, as long as the process is healthy.

A liveliness token only states that the session lives: a stopped process keeps it for the lease, one with a
hung thread without end. A process whose checks report a problem ends itself, with or without a supervisor, so
that its tokens disappear.
"""

from __future__ import annotations

import logging
import os
import stat
import threading
import time
from collections.abc import Callable

logger = logging.getLogger(__name__)

#: Environment variable with the descriptor of the pipe.
VARIABLE = "CDFF_HEARTBEAT_FD"
PERIOD_S = 1.0
#: Exit code of a process that ended because of a failed check.
EXIT_UNHEALTHY = 76

_checks: list[Callable[[], str]] = []


def add_check(check: Callable[[], str]) -> None:
    """Add a check of this process, which returns its problem, or an empty text."""
    _checks.append(check)


def start_heartbeat(stop: threading.Event) -> None:
    """Send heartbeats in a daemon thread; after ``stop`` the checks do not end the process any more."""
    threading.Thread(target=_run, args=(stop, _descriptor()), name="heartbeat", daemon=True).start()


def _descriptor() -> int | None:
    """Return the descriptor of the pipe, hidden from child processes; None without a supervisor."""
    text = os.environ.pop(VARIABLE, "")
    if not text:
        return None
    descriptor = int(text)
    try:
        if not stat.S_ISFIFO(os.fstat(descriptor).st_mode):
            return None
        os.set_inheritable(descriptor, False)
        os.set_blocking(descriptor, False)
    except OSError:  # inherited from a process that is not the supervisor
        return None
    return descriptor


def _run(stop: threading.Event, descriptor: int | None) -> None:
    """Write the heartbeat until the process ends; a failed check ends the process."""
    while True:
        problem = "; ".join(p for check in _checks if (p := check()))
        if problem and not stop.is_set():
            logger.critical("%s; the process ends", problem)
            os._exit(EXIT_UNHEALTHY)
        if descriptor is not None:
            try:
                os.write(descriptor, b".")
            except BlockingIOError:  # the supervisor does not read now
                pass
            except OSError:  # the supervisor has ended
                descriptor = None
        time.sleep(PERIOD_S)  # not ``stop.wait``: the heartbeat continues during the orderly end
