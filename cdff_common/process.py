# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common parts of long-running processes: logging, signals, exit path, thread caps, supervision."""

from __future__ import annotations

import ctypes
import fcntl
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from cdff_common import tracing
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.heartbeat import start_heartbeat
from cdff_common.log import configure_logging
from cdff_common.memory import limit_retained_memory
from cdff_common.output import make_folder, storage_errors

logger = logging.getLogger(__name__)

#: Default data folder, without an argument and ``CDFF_DATA_DIR``.
DEFAULT_DATA_DIR = "~/.local/share/cdff"

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
#: Option of prctl(2): the signal that a process receives when its parent ends.
_PR_SET_PDEATHSIG = 1


def data_dir_of(argument: str | Path | None = None, environment: Mapping[str, str] = os.environ) -> Path:
    """Return the data folder: the argument, else ``CDFF_DATA_DIR``, else the default; ``~`` is the home
    folder.
    """
    return Path(argument or environment.get("CDFF_DATA_DIR") or DEFAULT_DATA_DIR).expanduser()


def lock_file(path: Path, own: str, refusal: Callable[[str], str]) -> int:
    """Lock a file and return its descriptor; the lock ends when the descriptor is closed or the process ends.

    The library filelock is not used because its error does not name the process that holds the lock.

    Parameters
    ----------
    own : str
        Name of this process, written to the file.
    refusal : callable
        Returns the message for another process, given the name in the file.

    Raises
    ------
    UnavailableError
        If another process holds the lock.
    StorageError
        If the file cannot be written.
    """
    with storage_errors(path):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        holder = os.read(descriptor, 256).decode(errors="replace").strip()
        os.close(descriptor)
        raise UnavailableError(refusal(holder or "a process that has just started")) from error
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, own.encode(), 0)
    return descriptor


def cap_threads(threads: int) -> None:
    """Limit the threads of numeric libraries; call it before they are imported."""
    for variable in _THREAD_VARIABLES:
        os.environ.setdefault(variable, str(threads))
    os.environ.setdefault("NUMBA_THREADING_LAYER", "omp")


def stop_event() -> threading.Event:
    """Return an event that SIGTERM and SIGINT set; a second signal ends the process."""
    stop = threading.Event()

    def on_signal(number: int, _frame: object) -> None:
        if stop.is_set():
            os._exit(128 + number)
        stop.set()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)
    return stop


def follow_supervisor() -> None:
    """Request SIGTERM from the kernel when the supervisor exits (Linux; no effect elsewhere)."""
    supervisor = os.environ.get("CDFF_SUPERVISOR")
    if supervisor is None or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(supervisor):  # it exited before the request
        os._exit(0)


def run_service(name: str, body: Callable[[threading.Event], None]) -> int:
    """Run a service until its stop event is set; return 0, or 1 after a known error.

    ``body`` receives the stop event and returns after it is set and everything is closed.
    """
    limit_retained_memory()
    stop = stop_event()
    follow_supervisor()
    level, log_folder = os.environ.get("CDFF_LOG_LEVEL", "INFO"), os.environ.get("CDFF_LOG_DIR")
    configure_logging(name, level)
    start_heartbeat(stop)
    try:
        if log_folder:
            configure_logging(name, level, make_folder(Path(log_folder)))
        tracing.start(name)
        body(stop)
    except CdffError as error:
        if stop.is_set():  # an interruption by the stop event is not a failure
            logger.info("%s", error)
            return 0
        for line in str(error).splitlines():  # one line for a known error or fault, no traceback
            logger.error("%s", line)
        return 1
    finally:
        tracing.stop()
    sys.stdout.flush()
    return 0
