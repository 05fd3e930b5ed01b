# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""JSON answers as pages for people: with ``f=html``, or for browsers, which prefer HTML.

The page shows the same data as nested lists with links, without scripts.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Coroutine
from html import escape
from typing import Any
from urllib.parse import urlencode

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.datastructures import MutableHeaders

from services.dpm.http.context import root_path

_JSON = re.compile(r"application/(geo\+|schema\+)?json\b")
_ADDRESS = re.compile(r"https?://[^\s<>\"']+\Z")
#: Longest answer that is shown as a page, bytes; largest number of elements of a list that are shown.
_MOST_BYTES, _MOST_ELEMENTS = 4 << 20, 1000
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title><link rel="stylesheet" href="{root}/static/style.css"></head>
<body><header class="top"><h1>{title}</h1></header>
<main>{links}<p><a href="{json}">This document as JSON</a></p>
{body}</main></body></html>
"""


class NegotiatedRoute(APIRoute):
    """Route whose JSON answers are also pages."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return a handler that converts the JSON answer of the route to a page if a client asks for HTML."""
        handler = super().get_route_handler()

        async def negotiated(request: Request) -> Response:
            response = await handler(request)
            if request.method not in ("GET", "HEAD"):
                return response
            MutableHeaders(raw=response.raw_headers).add_vary_header("Accept")
            content_type = response.headers.get("content-type", "")
            if not wants_html(request) or not _JSON.match(content_type) or response.status_code != 200:
                return response
            data = bytes(response.body)
            if len(data) > _MOST_BYTES:
                return response
            page = Response(html_of(request, json.loads(data)), media_type="text/html; charset=utf-8")
            for name in ("link", "content-crs", "vary"):
                if name in response.headers:
                    page.headers[name] = response.headers[name]
            return page

        return negotiated


def wants_html(request: Request) -> bool:
    """Return whether ``f``, else the header ``Accept``, asks for HTML before JSON."""
    form = request.query_params.get("f")
    if form is not None:
        return form == "html"
    accepted = request.headers.get("accept", "")[:1000].lower()
    html, others = accepted.find("text/html"), accepted.find("json")
    return html >= 0 and (others < 0 or html < others)


def html_of(request: Request, data: Any) -> str:
    """Return the page of a JSON document."""
    title = "CDFF"
    if isinstance(data, dict):
        title = str(data.get("title") or data.get("id") or data.get("type") or title)
    links = data.get("links", []) if isinstance(data, dict) else []
    navigation = "".join(
        f'<a href="{escape(str(link["href"]))}">{escape(str(link.get("title") or link["rel"]))}</a> '
        for link in links
        if isinstance(link, dict) and _ADDRESS.match(str(link.get("href", ""))) and "rel" in link
    )
    query = [(name, value) for name, value in request.query_params.multi_items() if name != "f"]
    return _PAGE.format(
        title=escape(title),
        root=escape(root_path(request)),
        json=escape("?" + urlencode([*query, ("f", "json")])),
        links=f"<p>{navigation}</p>",
        body=_part(data),
    )


def _part(data: Any, depth: int = 0) -> str:
    if isinstance(data, dict) and data and depth < 12:
        rows = "".join(
            f"<dt>{escape(str(name))}</dt><dd>{_part(value, depth + 1)}</dd>" for name, value in data.items()
        )
        return f"<dl>{rows}</dl>"
    if isinstance(data, list) and depth < 12:
        if all(not isinstance(value, dict | list) for value in data) or _is_coordinates(data):
            return escape(json.dumps(data)[:2000])
        return "".join(f"<section>{_part(value, depth + 1)}</section>" for value in data[:_MOST_ELEMENTS])
    if isinstance(data, str) and _ADDRESS.match(data):
        return f'<a href="{escape(data)}">{escape(data)}</a>'
    return escape(data if isinstance(data, str) else json.dumps(data)[:2000])


def _is_coordinates(data: list[Any]) -> bool:
    return bool(data) and isinstance(data[0], list)
