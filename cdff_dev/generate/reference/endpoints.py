# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``endpoints.md``: the HTTP surface, from its own OpenAPI document.

The toolkit never imports a service; a service hands its document out under the entry points ``cdff.openapi``, each a
function without arguments that returns it.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from cdff_dev.generate.python_source import render

GROUP = "cdff.openapi"
_METHODS = ("get", "head", "post", "put", "patch", "delete")


def page() -> str:
    """Page of all endpoints of all services that serve HTTP."""
    documents = {entry.name: entry.load()() for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name)}
    services = {
        name: [row for path in document["paths"].items() for row in _rows(*path)]
        for name, document in documents.items()
    }
    return render("endpoints.md.j2", services=services)


def _rows(path: str, item: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "method": method.upper(),
            "path": path,
            "summary": operation.get("summary", ""),
            "doc": " ".join(operation.get("description", "").split()),
            "parameters": [
                (p["name"], p["in"], p.get("required", False), _schema(p.get("schema", {})), p.get("description", ""))
                for p in operation.get("parameters", ())
            ],
            "answers": sorted(operation.get("responses", {})),
        }
        for method, operation in item.items()
        if method in _METHODS
    ]


def _schema(schema: dict[str, Any]) -> str:
    options = [o for o in schema.get("anyOf", [schema]) if o.get("type") != "null"]
    words = [
        " or ".join(map(str, o["enum"]))
        if "enum" in o
        else o.get("$ref", "").rsplit("/", 1)[-1] or o.get("type", "any")
        for o in options
    ]
    return " or ".join(words)
