# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP application, put together."""

from __future__ import annotations

import functools
import threading
from typing import Any

from fastapi import Depends, FastAPI

from services.dpm.http import problems
from services.dpm.http.conditional import Conditional
from services.dpm.http.context import Context, checked_query
from services.dpm.http.guard import Guard
from services.dpm.http.models import Problem
from services.dpm.http.roles import rules_of
from services.dpm.http.routes import (
    annotations,
    bodies,
    frames,
    layers,
    maps,
    ogc,
    page,
    products,
    requests,
    retention,
    robots,
    stac,
    status,
    tiles,
    transactions,
)
from services.dpm.refusals import Refusals

#: The last is the page: for people, not in the OpenAPI document.
MODULES = (
    products, transactions, annotations, robots, frames, bodies, maps, layers, tiles, requests, retention, status, stac,
    ogc, page,
)  # fmt: skip

_DESCRIBING = threading.Lock()


def create_app(context: Context) -> FastAPI:
    """Return the application over a DPM."""
    app = _routed()
    app.state.context = context
    problems.install(app)
    rules = rules_of(module.router for module in MODULES)
    app.add_middleware(Conditional)
    app.add_middleware(Guard, settings=context.settings, rules=rules, refusals=Refusals(context.dpm))
    return app


def openapi() -> dict[str, Any]:
    """Return the OpenAPI document without a DPM: for the reference page (entry point ``cdff.openapi``)."""
    return _routed().openapi()


def _routed() -> FastAPI:
    app = FastAPI(title="CDFF Data Product Manager", version="1", docs_url=None, redoc_url=None)
    for module in MODULES[:-1]:
        app.include_router(module.router, responses=problems.RESPONSES, dependencies=[Depends(checked_query)])
    app.include_router(page.router)
    app.openapi = functools.partial(_described, app)  # type: ignore[method-assign]  # FastAPI's way to add to it
    return app


def _described(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document, with the problem document that every operation refers to.

    The first requests ask for it in several threads at once, and FastAPI makes it right in one only.
    """
    with _DESCRIBING:
        if app.openapi_schema is None:
            document = FastAPI.openapi(app)
            document.setdefault("components", {}).setdefault("schemas", {})["Problem"] = Problem.model_json_schema()
            app.openapi_schema = document
        return app.openapi_schema
