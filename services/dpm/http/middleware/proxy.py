# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Addresses behind a proxy that serves the DPM below a path, with ``X-Forwarded-Prefix`` and ``-Host``.

The headers are read only if the operator states that a proxy is in front, since otherwise any caller could
choose the addresses in links.
"""

from __future__ import annotations

import re

from starlette.types import ASGIApp, Receive, Scope, Send

from services.dpm.http.middleware.problems import problem

_PREFIX = re.compile(r"(/[A-Za-z0-9_~-][A-Za-z0-9._~-]*){1,16}\Z")


class Proxy:
    """ASGI middleware in front of all others.

    Parameters
    ----------
    app : ASGIApp
    root_path : str
        Path below which the proxy serves the DPM; a prefix in a request precedes it.
    is_trusted : bool
        Whether the headers of requests are read.
    """

    def __init__(self, app: ASGIApp, root_path: str = "", *, is_trusted: bool = False) -> None:
        self._app = app
        self._root_path = root_path.rstrip("/")
        self._is_trusted = is_trusted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request with its root path; the proxy may have removed it from the path or not."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        prefix, headers = self._root_path, scope["headers"]
        if self._is_trusted:
            value_by_header = dict(headers)
            prefix = value_by_header.get(b"x-forwarded-prefix", b"").decode("latin-1").rstrip("/") or prefix
            host = value_by_header.get(b"x-forwarded-host", b"").partition(b",")[0].strip()
            if host:
                headers = [*((k, v) for k, v in headers if k != b"host"), (b"host", host)]
        if prefix and (len(prefix) > 200 or not _PREFIX.match(prefix)):
            detail = f"X-Forwarded-Prefix {prefix[:80]!r}: expected a path as /dpm"
            await problem(400, detail, code="INVALID_ARGUMENT")(scope, receive, send)
            return
        path = scope["path"]
        if prefix and (path == prefix or path.startswith(f"{prefix}/")):
            path = path[len(prefix) :] or "/"
        await self._app({**scope, "headers": headers, "path": path, "root_path": prefix}, receive, send)
