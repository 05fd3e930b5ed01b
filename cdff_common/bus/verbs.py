# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Verbs under one ``…/@rpc/`` prefix: one queryable for all, so that unknown verbs get an answer too."""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from cdff_common.bus.rpc import CallResources, CallServer, direct
from cdff_common.errors import CdffError, InputError, UnavailableError

RPC = "/@rpc/"


class VerbTable:
    """Dispatcher of the calls below one prefix by their verb; every call is answered.

    Parameters
    ----------
    session : zenoh.Session
    resources : CallResources
    prefix : str
        Key up to, but excluding, ``/@rpc/``.
    is_ready : callable
        Returns whether the service has announced itself. Until then an unknown verb is answered with
        UNAVAILABLE, since it may be added later; afterwards with INVALID_ARGUMENT.
    complete : bool
        False for a process that answers only while no complete table of another process has the prefix.
    """

    def __init__(
        self,
        session: zenoh.Session,
        resources: CallResources,
        prefix: str,
        is_ready: Callable[[], bool],
        *,
        complete: bool = True,
    ) -> None:
        self._resources = resources
        self._prefix = prefix
        self._is_ready = is_ready
        self._verbs: dict[str, CallServer] = {}
        self._queryable = session.declare_queryable(f"{prefix}{RPC}**", direct(self._take), complete=complete)

    def add(self, verb: str, server: CallServer) -> None:
        """Add a verb; ``call/*`` matches every one-chunk name below ``call``."""
        self._verbs[verb] = server

    def close(self) -> None:
        """Stop answering."""
        self._queryable.undeclare()

    def _take(self, query: zenoh.Query) -> None:
        """Pass a query to the server of its verb, or refuse it."""
        verb = str(query.key_expr).partition(RPC)[2]
        server = self._verbs.get(verb) or self._verbs.get(f"{verb.rpartition('/')[0]}/*")
        if server is not None:
            server.enqueue(query)
            return
        error: CdffError
        if self._is_ready():
            error = InputError(
                f"{self._prefix} has no verb {verb!r}; it has {', '.join(sorted(self._verbs))}"
            )
        else:
            error = UnavailableError(f"{self._prefix} is starting; {verb!r} is not served yet")
        self._resources.refuse(query, error)
