# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bound of the requests in progress, in total and of one address; each request is charged for its memory."""

from __future__ import annotations

from collections import Counter

from starlette.types import ASGIApp, Receive, Scope, Send

from cdff_common.errors import OverloadedError
from services.dpm.http.middleware.problems import problem_of
from services.dpm.operations.work_budget import WorkBudget

#: Largest numbers of requests in progress, in total and of one address; an event stream counts as one.
MAX_REQUESTS, MAX_REQUESTS_OF_ADDRESS = 320, 240


class Admission:
    """ASGI middleware in front of all others."""

    def __init__(self, app: ASGIApp, budget: WorkBudget) -> None:
        self._app = app
        self._budget = budget
        self._in_progress: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, or refuse it if there are too many."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        address = (scope.get("client") or ("",))[0]
        if self._in_progress.total() >= MAX_REQUESTS or self._in_progress[address] >= MAX_REQUESTS_OF_ADDRESS:
            await problem_of(OverloadedError("too many requests at once"))(scope, receive, send)
            return
        self._in_progress[address] += 1
        try:
            with self._budget.request():
                await self._app(scope, receive, send)
        finally:
            self._in_progress[address] -= 1
            if not self._in_progress[address]:
                del self._in_progress[address]
