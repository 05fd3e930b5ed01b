# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Monitor of the conditions that restrict the DPM: disk, database and mission clock."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence

from cdff_common.errors import CdffError
from services.alarms import Severity
from services.dpm.operations.dpm import Dpm

logger = logging.getLogger(__name__)

PERIOD_S = 5.0
_SOURCE = "dpm"
#: Longest duration of one check, seconds; the database can be locked for long.
_BUSY_LIMIT_S = 300.0


def check_conditions(dpm: Dpm) -> None:
    """Begin and end the alarms of the DPM."""
    check_disk(dpm)
    dpm.writer.clock_guard.update()
    check_payloads(dpm)
    dpm.identity_alarm.update()
    if dpm.store.changes.loss:
        remedy = "stop the DPM and run `cdff dpm rebuild`"
        dpm.alarms.set("database_damaged", _SOURCE, Severity.CRITICAL, dpm.store.changes.loss, remedy)


def check_payloads(dpm: Dpm) -> None:
    """Begin or end the alarm of corrupt payloads."""
    reasons = list(dpm.store.damaged_payloads.values())
    if not reasons:
        dpm.alarms.clear("corrupt_payload", _SOURCE)
        return
    problem = f"{len(reasons)} payloads are corrupt and not served, such as {reasons[-1]}"
    remedy = "insert the same content again, or restore a backup; check the disk and run `cdff dpm verify`"
    dpm.alarms.set("corrupt_payload", _SOURCE, Severity.CRITICAL, problem, remedy)


def check_disk(dpm: Dpm) -> bool:
    """Begin or end the alarm of the disk; return whether products can be stored."""
    disk = dpm.store.disk_space
    if disk.holds(0):
        dpm.alarms.clear("disk_full", _SOURCE)
        return True
    problem = f"{disk.free_bytes()} bytes are free: products are served and deleted, but not stored"
    remedy = "free space on the disk, delete products, or run `cdff dpm retention --apply`"
    dpm.alarms.set("disk_full", _SOURCE, Severity.CRITICAL, problem, remedy)
    return False


class ConditionMonitor:
    """Thread that checks the conditions, and returns freed memory, until it is closed.

    ``tasks`` are further functions to be called in each period.
    """

    def __init__(self, dpm: Dpm, tasks: Sequence[Callable[[], object]] = ()) -> None:
        self._dpm, self._tasks = dpm, tasks
        self._closed = threading.Event()
        loop = dpm.loops.add("conditions", _BUSY_LIMIT_S)
        self._thread = threading.Thread(
            target=loop.run, args=(self._wait, self._work), name="conditions", daemon=True
        )
        self._work(True)  # the first alarms before the service is reported ready
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._thread.join(PERIOD_S)

    def _wait(self) -> bool | None:
        return None if self._closed.wait(PERIOD_S) else True

    def _work(self, _: bool) -> None:
        try:
            check_conditions(self._dpm)
            self._dpm.alarm_board.drop_old_acknowledgements()
            for task in self._tasks:
                task()
            self._dpm.budget.return_freed_memory(is_freed=self._dpm.store.maps.drop_idle_blocks())
        except (CdffError, OSError) as error:
            logger.warning("conditions not checked: %s", error)
