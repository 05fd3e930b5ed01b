# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What routes depend on, as typed parameters."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Annotated, cast

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


def once(request: Request) -> None:
    """Refuse a parameter that is repeated, as over Zenoh: which one counts would be a guess.

    STAC and OGC have rules of their own. None of the native parameters is a list.

    Raises
    ------
    InputError
    """
    if not request.url.path.startswith("/api/"):
        return
    names = [name for name, _ in request.query_params.multi_items()]
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise InputError(f"parameter {repeated[:80]!r} is repeated: expected it once, several values with commas")


Ctx = Annotated[Context, Depends(context_of)]
