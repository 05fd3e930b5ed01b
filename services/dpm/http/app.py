# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP application: routes, middleware and OpenAPI document."""

from __future__ import annotations

import functools
import threading
from typing import Any

from fastapi import Depends, FastAPI, Request
from fastapi.middleware.cors import CORSMiddleware
from fastapi.responses import JSONResponse

from services.dpm.http.context import Context, checked_query
from services.dpm.http.middleware import problems
from services.dpm.http.middleware.admission import Admission
from services.dpm.http.middleware.conditional import Conditional
from services.dpm.http.middleware.guard import Guard
from services.dpm.http.middleware.proxy import Proxy
from services.dpm.http.middleware.roles import rules_of
from services.dpm.http.middleware.uploads import Uploads
from services.dpm.http.models import OPENAPI, Problem
from services.dpm.http.routes import annotations as annotation_routes
from services.dpm.http.routes import (
    bodies,
    contact,
    frames,
    layers,
    maps,
    meshes,
    ogc,
    ogc_maps,
    page,
    product_types,
    products,
    requests,
    retention,
    robots,
    stac,
    status,
    tiles,
    tracks,
    transactions,
    wmts,
)
from services.dpm.operations.refusals import RefusalLog

#: Modules with routes; the last one is the operators' page, which is not in the OpenAPI document.
MODULES = (
    products,
    meshes,
    product_types,
    tracks,
    transactions,
    annotation_routes,
    robots,
    frames,
    bodies,
    maps,
    layers,
    wmts,
    tiles,
    requests,
    contact,
    retention,
    status,
    stac,
    ogc,
    ogc_maps,
    page,
)

#: Headers that pages of other origins may send, and those of answers that they may read.
_CORS_HEADERS = ("Authorization", "Content-Type", "If-None-Match", "If-Range", "Range")
_EXPOSED_HEADERS = ("Accept-Ranges", "Content-Crs", "Content-Range", "ETag", "Link", "Retry-After")
_OPENAPI_LOCK = threading.Lock()


def create_app(context: Context) -> FastAPI:
    """Return the application over a DPM."""
    app = _app_with_routes()
    app.state.context = context
    problems.install(app)
    rules = rules_of(module.router for module in MODULES)
    settings, dpm = context.settings, context.dpm
    app.add_middleware(Conditional)
    app.add_middleware(Uploads, store=dpm.store, budget=dpm.budget, max_body_bytes=settings.max_body_bytes)
    app.add_middleware(Guard, settings=settings, rules=rules, refusals=RefusalLog(dpm))
    app.add_middleware(Admission, budget=dpm.budget)
    if settings.cors_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=settings.cors_origins,
            allow_methods=("GET", "HEAD", "POST"),
            allow_headers=_CORS_HEADERS,
            expose_headers=_EXPOSED_HEADERS,
        )
    app.add_middleware(Proxy, root_path=settings.root_path, is_trusted=settings.behind_proxy)
    return app


def openapi() -> dict[str, Any]:
    """Return the OpenAPI document, which is the same for every application of a process.

    The lock is necessary because FastAPI cannot build the document in several threads at once.
    """
    with _OPENAPI_LOCK:
        return _openapi_document()


@functools.cache
def _openapi_document() -> dict[str, Any]:
    """Build the document with the model of problem documents, which every operation references."""
    document = FastAPI.openapi(_app_with_routes())
    document.setdefault("components", {}).setdefault("schemas", {})["Problem"] = Problem.model_json_schema()
    return document


def _interface(request: Request) -> JSONResponse:
    """Return the OpenAPI document; behind a proxy it names the path of the server."""
    root_path = request.scope.get("root_path", "")
    servers = {"servers": [{"url": root_path}]} if root_path else {}
    return JSONResponse(openapi() | servers, media_type=OPENAPI)


def _app_with_routes() -> FastAPI:
    app = FastAPI(
        title="CDFF Data Product Manager", version="1", docs_url=None, redoc_url=None, openapi_url=None
    )
    app.add_route("/openapi.json", _interface)
    for module in MODULES[:-1]:
        app.include_router(module.router, responses=problems.RESPONSES, dependencies=[Depends(checked_query)])
    app.include_router(page.router)
    app.openapi = openapi  # type: ignore[method-assign]
    return app
