# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/``: the operators' page, and ``/docs``: the interface; static files of this package."""

from __future__ import annotations

from importlib.resources import files

from fastapi import APIRouter, HTTPException
from fastapi.responses import Response

router = APIRouter(include_in_schema=False)

_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
_FILES = frozenset(
    {
        "index.html",
        "docs.html",
        "style.css",
        "app.js",
        "map.js",
        "goals.js",
        "overlay.js",
        "request_form.js",
        "tracks.js",
        "docs.js",
        "icon.svg",
    }
)


@router.get("/")
def index() -> Response:
    """Return the operators' page."""
    return _file("index.html")


@router.get("/docs")
def docs() -> Response:
    """Return the description of the interface as a page."""
    return _file("docs.html")


@router.get("/static/{name}")
def static(name: str) -> Response:
    """Return a file of the page."""
    return _file(name)


def _file(name: str) -> Response:
    if name not in _FILES:
        raise HTTPException(404, f"no file {name[:64]!r}")
    data = (files("services.dpm.http") / "static" / name).read_bytes()
    media_type = _TYPES[name.rsplit(".", 1)[1]]
    return Response(data, media_type=f"{media_type}; charset=utf-8", headers={"Cache-Control": "no-cache"})
