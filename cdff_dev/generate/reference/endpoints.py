# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``endpoints.md``: the HTTP interface of the DPM, from its OpenAPI document."""

from __future__ import annotations

from typing import Any

from cdff_dev.generate.python_source import render
from services.dpm.http.app import openapi

_METHODS = ("get", "head", "post", "put", "patch", "delete")


def page() -> str:
    """Return the page of all HTTP endpoints."""
    services = {"dpm": [row for path in openapi()["paths"].items() for row in _rows(*path)]}
    return render("endpoints.md.j2", services=services)


def _rows(path: str, item: dict[str, Any]) -> list[dict[str, Any]]:
    """Return one row per HTTP method of a path of the OpenAPI document."""
    return [
        {
            "method": method.upper(),
            "path": path,
            "summary": operation.get("summary", ""),
            "doc": " ".join(operation.get("description", "").split()),
            "parameters": [
                (
                    p["name"],
                    p["in"],
                    p.get("required", False),
                    _schema(p.get("schema", {})),
                    p.get("description", ""),
                )
                for p in operation.get("parameters", ())
            ],
            "answers": sorted(operation.get("responses", {})),
        }
        for method, operation in item.items()
        if method in _METHODS
    ]


def _schema(schema: dict[str, Any]) -> str:
    """Return the type of a JSON schema as words."""
    options = [o for o in schema.get("anyOf", [schema]) if o.get("type") != "null"]
    words = [
        " or ".join(map(str, o["enum"]))
        if "enum" in o
        else o.get("$ref", "").rsplit("/", 1)[-1] or o.get("type", "any")
        for o in options
    ]
    return " or ".join(words)
