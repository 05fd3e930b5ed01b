# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Dependencies of routes, as typed parameters."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, cast

from fastapi import Depends, Request

from cdff_common.bus import Bus
from cdff_common.errors import InputError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_common.json_form import jsonable as jsonable  # for the routes
from dpm_store.search.extents import ExtentCache
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.http.geographic_outlines import OutlinesCache, ProductOutlines
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings


@dataclass(frozen=True, slots=True)
class Context:
    """Objects that routes use; ``bus`` and ``watch`` are None if HTTP runs without a router.
    ``closing`` is set when the server stops, and ``wakers`` are called, to end endless streams.
    """

    dpm: Dpm
    settings: Settings
    bus: Bus | None = None
    watch: ServiceMonitor | None = None
    profile: Profile | None = None
    extents: ExtentCache = field(default_factory=ExtentCache)
    outlines: OutlinesCache = field(default_factory=OutlinesCache)
    closing: threading.Event = field(default_factory=threading.Event)
    wakers: set[Callable[[], None]] = field(default_factory=set)

    @property
    def places(self) -> ProductOutlines:
        """Outlines of products in the newest state of the frames."""
        return self.outlines.get(self.dpm.store)

    def end_streams(self) -> None:
        """End the endless streams; callable from any thread."""
        self.closing.set()
        for wake in tuple(self.wakers):
            wake()

    def connected(self) -> Bus:
        """Return the bus; raises UnavailableError if there is none."""
        if self.bus is None:
            raise UnavailableError("this server runs without the bus; requests need the orchestrator")
        return self.bus


def context_of(request: Request) -> Context:
    """Return the context of the application that serves a request."""
    return cast(Context, request.app.state.context)


def root_path(request: Request) -> str:
    """Return the path of the server behind a proxy, as ``/dpm``; empty without one."""
    return str(request.scope.get("root_path", ""))


def checked_query(request: Request) -> None:
    """Refuse a parameter that is repeated or unknown to the route, as over Zenoh and in OGC 17-069r4 §7.9.

    No parameter is a list.

    Raises
    ------
    InputError
    """
    names = [name for name, _ in request.query_params.multi_items()]
    if not names:
        return
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise InputError(
            f"parameter {repeated[:80]!r} is repeated: expected it once, several values with commas"
        )
    declared = _declared(request)
    if any(p["schema"].get("type") == "object" for p in declared):  # arbitrary names: the route checks them
        return
    known = {p["name"] for p in declared}
    unknown = next((name for name in names if name not in known), None)
    if unknown is not None:
        expected = f"expected one of {', '.join(sorted(known))}" if known else "there are none here"
        raise InputError(f"unknown parameter {unknown[:80]!r}: {expected}")


def _declared(request: Request) -> list[dict[str, Any]]:
    """Return the query parameters of the route in the OpenAPI document."""
    operations = request.app.openapi()["paths"][request.scope["route"].path_format]
    operation = operations["get" if request.method == "HEAD" else request.method.lower()]
    return [p for p in operation.get("parameters", ()) if p["in"] == "query"]


Ctx = Annotated[Context, Depends(context_of)]
