# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Announcement that every service of a plan is ready, by their liveliness tokens."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence

from cdff_common.bus import keys
from services.supervisor.plan import ProcessSpec


class Readiness:
    """Callback of ``Bus.watch_alive`` that calls ``announce`` once, when all expected tokens exist.

    Parameters
    ----------
    expected : collection of str
        Liveliness tokens.
    announce : callable
    """

    def __init__(self, expected: Collection[str], announce: Callable[[], None]) -> None:
        self._missing, self._announce = set(expected), announce
        self._lock = threading.Lock()

    def __call__(self, key: str, is_alive: bool) -> None:
        """Register a token that appeared; one that disappears before all are ready is ignored."""
        with self._lock:
            was_waiting = bool(self._missing)
            if is_alive:
                self._missing.discard(key)
            is_ready = was_waiting and not self._missing
        if is_ready:
            self._announce()


def expected_tokens(specs: Sequence[ProcessSpec]) -> set[str]:
    """Return the liveliness tokens of the services of a plan."""
    return {keys.alive(scope, service) for spec in specs for scope, service in spec.tokens}


def ready_line(specs: Sequence[ProcessSpec], connect: str, http: str, *, is_secure: bool) -> str:
    """Return the line for the user: the number of services, the URL and the endpoint of the router."""
    services = len(expected_tokens(specs))
    has_http = any(spec.name == "dpm" for spec in specs)
    address = http.replace("0.0.0.0:", "127.0.0.1:")
    url = f"{'https' if is_secure else 'http'}://{address}/, " if has_http else ""
    return f"ready: {services} services, {url}router {connect}; Ctrl-C ends them"
