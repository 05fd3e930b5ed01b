# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Connection of the supervisor to the bus, for its alarms and the profiles of its robots."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack

from cdff_common.errors import CdffError
from cdff_common.loops import Loops
from services.alarms import Alarms
from services.supervisor.profile_link import SupervisorLink, serve_profile
from services.supervisor.readiness import Readiness

logger = logging.getLogger(__name__)


def start_alarm_link(
    alarms: Alarms, link: SupervisorLink, stop: threading.Event, readiness: Readiness | None = None
) -> None:
    """Publish the alarms of a supervisor in a daemon thread that connects when the router runs.

    ``readiness`` receives the liveliness tokens of the services.
    """
    arguments = (alarms, link, stop, readiness)
    threading.Thread(target=_run, args=arguments, name="alarm link", daemon=True).start()


def _run(alarms: Alarms, link: SupervisorLink, stop: threading.Event, readiness: Readiness | None) -> None:
    from cdff_common.bus import Bus, keys
    from services.alarm_reporter import AlarmReporter

    def connected(scope: str) -> Bus:
        identity = link.identity_of(scope)
        return Bus.open(link.connect, name="supervisor", wait_s=None, stop=stop, identity=identity)

    try:
        with ExitStack() as sessions:
            bus = sessions.enter_context(connected(link.scope))
            if readiness is not None:
                bus.watch_alive(keys.alive("*", "*"), readiness)
            reporter = AlarmReporter(bus, link.scope, "supervisor", alarms, Loops().add("alarms"))
            for scope, profile in link.profiles.items():
                # On a secured bus an identity may publish below its own scope only.
                is_same = scope == link.scope or link.secrets is None
                serve_profile(bus if is_same else sessions.enter_context(connected(scope)), scope, profile)
            stop.wait()
            reporter.close()
    except CdffError as error:
        if not stop.is_set():
            logger.error("alarms are only in this log: %s", error)
