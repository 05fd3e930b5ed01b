# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What routes depend on, as typed parameters."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Annotated, Any, cast

from fastapi import Depends, Request

from cdff_common.bus import Bus
from cdff_common.errors import InputError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_common.json_form import jsonable as jsonable  # for the routes
from dpm_store.extents import ExtentCache
from services.dpm.operations import Dpm
from services.dpm.settings import Settings
from services.dpm.watch import Watch


@dataclass(frozen=True, slots=True)
class Context:
    """The DPM and what surrounds it; ``bus`` and ``watch`` are None where HTTP runs without a router.

    ``closing`` is set when the server stops: streams without end then end.
    """

    dpm: Dpm
    settings: Settings
    bus: Bus | None = None
    watch: Watch | None = None
    profile: Profile | None = None
    extents: ExtentCache = field(default_factory=ExtentCache)
    closing: threading.Event = field(default_factory=threading.Event)

    def connected(self) -> Bus:
        """The bus; raises UnavailableError without one."""
        if self.bus is None:
            raise UnavailableError("this server runs without the bus; requests need the orchestrator")
        return self.bus


def context_of(request: Request) -> Context:
    """The context of the application that a request came to."""
    return cast(Context, request.app.state.context)


def checked_query(request: Request) -> None:
    """Refuse a parameter that is repeated or that the route does not have: as over Zenoh and OGC 17-069r4 §7.9.

    Which of two values counts would be a guess, and one that is misspelt would silently mean something else. None of
    the parameters is a list.

    Raises
    ------
    InputError
    """
    names = [name for name, _ in request.query_params.multi_items()]
    if not names:
        return
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise InputError(f"parameter {repeated[:80]!r} is repeated: expected it once, several values with commas")
    declared = _declared(request)
    if any(p["schema"].get("type") == "object" for p in declared):  # of any names: the route looks at them itself
        return
    known = {p["name"] for p in declared}
    unknown = next((name for name in names if name not in known), None)
    if unknown is not None:
        expected = f"expected one of {', '.join(sorted(known))}" if known else "there are none here"
        raise InputError(f"unknown parameter {unknown[:80]!r}: {expected}")


def _declared(request: Request) -> list[dict[str, Any]]:
    """Query parameters that the OpenAPI document gives the route."""
    operations = request.app.openapi()["paths"][request.scope["route"].path_format]
    operation = operations["get" if request.method == "HEAD" else request.method.lower()]
    return [p for p in operation.get("parameters", ()) if p["in"] == "query"]


Ctx = Annotated[Context, Depends(context_of)]
