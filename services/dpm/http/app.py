# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP application, put together."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI

from services.dpm.http import problems
from services.dpm.http.context import Context
from services.dpm.http.guard import Guard
from services.dpm.http.routes import annotations, frames, maps, page, products, requests, robots, status


def create_app(context: Context) -> FastAPI:
    """Return the application over a DPM."""
    app = _routed()
    app.state.context = context
    problems.install(app)
    app.add_middleware(Guard, settings=context.settings)
    return app


def openapi() -> dict[str, Any]:
    """Return the OpenAPI document without a DPM: for the reference page (entry point ``cdff.openapi``)."""
    return _routed().openapi()


def _routed() -> FastAPI:
    app = FastAPI(title="CDFF Data Product Manager", version="1", docs_url=None, redoc_url=None)
    for module in (products, annotations, robots, frames, maps, requests, status):
        app.include_router(module.router, responses=problems.RESPONSES)
    app.include_router(page.router)
    return app
