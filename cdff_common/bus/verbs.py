# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The verbs under one ``…/@rpc/``: one queryable for all of them, so that a verb that nobody has is answered too."""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from cdff_common.bus.rpc import Served, refuse
from cdff_common.errors import CdffError, InputError, UnavailableError

RPC = "/@rpc/"


class VerbTable:
    """Dispatches the calls below one prefix by their verb; silence is never an answer.

    Parameters
    ----------
    session : zenoh.Session
    prefix : str
        Key up to and without ``/@rpc/``.
    is_ready : callable
        Tells whether the service has announced itself. Before that an unknown verb may be one that is served in a
        moment, and the answer is UNAVAILABLE; afterwards it is INVALID_ARGUMENT.
    """

    def __init__(self, session: zenoh.Session, prefix: str, is_ready: Callable[[], bool]) -> None:
        self._prefix = prefix
        self._is_ready = is_ready
        self._verbs: dict[str, Served] = {}
        handler = zenoh.handlers.Callback(self._take, indirect=True)
        self._queryable = session.declare_queryable(f"{prefix}{RPC}**", handler, complete=True)

    def add(self, verb: str, served: Served) -> None:
        """Serve a verb; ``call/*`` stands for every one-chunk name below ``call``."""
        self._verbs[verb] = served

    def close(self) -> None:
        """Stop answering."""
        self._queryable.undeclare()

    def _take(self, query: zenoh.Query) -> None:
        verb = str(query.key_expr).partition(RPC)[2]
        served = self._verbs.get(verb) or self._verbs.get(f"{verb.rpartition('/')[0]}/*")
        if served is not None:
            served.take(query)
            return
        error: CdffError
        if self._is_ready():
            error = InputError(f"{self._prefix} has no verb {verb!r}; it has {', '.join(sorted(self._verbs))}")
        else:
            error = UnavailableError(f"{self._prefix} is starting; {verb!r} is not served yet")
        with query:
            refuse(query, error)
