# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Link of the supervisor to the bus, by which its alarms reach the operators."""

from __future__ import annotations

import logging
import threading

from cdff_common.errors import CdffError
from cdff_common.loops import Loops
from services.alarms import Alarms
from services.supervisor.readiness import Readiness

logger = logging.getLogger(__name__)


def start_alarm_link(
    alarms: Alarms, connect: str, scope: str, stop: threading.Event, readiness: Readiness | None = None
) -> None:
    """Publish the alarms of a supervisor in a daemon thread that connects when the router runs.

    ``readiness`` receives the liveliness tokens of the services.
    """
    arguments = (alarms, connect, scope, stop, readiness)
    threading.Thread(target=_run, args=arguments, name="alarm link", daemon=True).start()


def _run(
    alarms: Alarms, connect: str, scope: str, stop: threading.Event, readiness: Readiness | None
) -> None:
    from cdff_common.bus import Bus, keys
    from services.alarm_reporter import AlarmReporter

    try:
        with Bus.open(connect, name="supervisor", wait_s=None, stop=stop) as bus:
            bus.declare_alive(scope, "supervisor")
            if readiness is not None:
                bus.watch_alive(keys.alive("*", "*"), readiness)
            reporter = AlarmReporter(bus, scope, "supervisor", alarms, Loops().add("alarms"))
            stop.wait()
            reporter.close()
    except CdffError as error:
        if not stop.is_set():
            logger.error("alarms are only in this log: %s", error)
