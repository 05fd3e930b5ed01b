# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What every long-running process does: logging, signals, one exit path, thread caps, following its supervisor."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from cdff_common.errors import CdffError
from cdff_common.log import configure_logging

logger = logging.getLogger(__name__)

#: Where data lie without an argument and without ``CDFF_DATA_DIR``.
DEFAULT_DATA_DIR = "~/.local/share/cdff"

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_PR_SET_PDEATHSIG = 1


def data_dir_of(argument: str | Path | None = None, environment: Mapping[str, str] = os.environ) -> Path:
    """The data folder: the argument, else ``CDFF_DATA_DIR``, else the default; ``~`` is the user's home."""
    return Path(argument or environment.get("CDFF_DATA_DIR") or DEFAULT_DATA_DIR).expanduser()


def cap_threads(threads: int) -> None:
    """Cap the threads of numeric libraries; only before they are imported."""
    for variable in _THREAD_VARIABLES:
        os.environ.setdefault(variable, str(threads))
    os.environ.setdefault("NUMBA_THREADING_LAYER", "omp")


def stop_event() -> threading.Event:
    """An event that SIGTERM and SIGINT set; a second signal ends the process at once."""
    stop = threading.Event()

    def on_signal(number: int, _frame: object) -> None:
        if stop.is_set():
            os._exit(128 + number)
        stop.set()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)
    return stop


def follow_supervisor() -> None:
    """Have the kernel send SIGTERM when the supervisor dies, however it dies (Linux; elsewhere nothing happens)."""
    supervisor = os.environ.get("CDFF_SUPERVISOR")
    if supervisor is None or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(supervisor):  # it died before we asked
        os._exit(0)


def run_service(name: str, body: Callable[[threading.Event], None]) -> int:
    """Run a service until it is told to stop; the exit code is 0, or 1 after a known error.

    ``body`` gets the stop event and returns once it is set and everything is closed.
    """
    stop = stop_event()
    follow_supervisor()
    configure_logging(name, os.environ.get("CDFF_LOG_LEVEL", "INFO"))
    try:
        body(stop)
    except CdffError as error:
        if stop.is_set():  # what breaks off because it was told to end is no failure
            logger.info("%s", error)
            return 0
        logger.error("%s", error)  # a known error is one line, not a traceback
        return 1
    sys.stdout.flush()
    return 0
