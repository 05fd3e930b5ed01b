# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of a configuration model as rows: for ``cdff dfn show`` and the reference pages."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import StrictModel

_BOUNDS = {"minimum": "≥ {}", "exclusiveMinimum": "> {}", "maximum": "≤ {}", "exclusiveMaximum": "< {}"}


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One parameter: its name, its type in JSON's words, default as JSON, bounds as text, what it decides."""

    name: str
    type: str
    default: str
    bounds: str
    doc: str


def parameter_rows(config: type[StrictModel]) -> list[ParameterRow]:
    """One row per field of the model, in its order; fields of a model within it follow with its name and a dot."""
    schema = config.model_json_schema()
    return list(_rows(schema, schema, {}, ""))


def _rows(model: dict[str, Any], schema: dict[str, Any], given: dict[str, Any], prefix: str) -> Iterator[ParameterRow]:
    """Rows of a model; ``given`` are the values that the field which holds it sets, before the model's own defaults."""
    required = set(model.get("required", ())) - set(given)
    for name, field in model.get("properties", {}).items():
        default = given.get(name, field.get("default"))
        inner = _resolved(field, schema)
        if inner.get("properties"):
            yield from _rows(inner, schema, default or {}, f"{prefix}{name}.")
            continue
        yield ParameterRow(
            name=prefix + name,
            type=_type(field, schema),
            default="required" if name in required else json.dumps(default, ensure_ascii=False),
            bounds=", ".join(_bounds(field)),
            doc=" ".join(field.get("description", "").split()),
        )


def _resolved(field: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """The field, or the definition it refers to."""
    return schema["$defs"][field["$ref"].rsplit("/", 1)[1]] if "$ref" in field else field


def _type(field: dict[str, Any], schema: dict[str, Any]) -> str:
    if "$ref" in field:
        return _type(_resolved(field, schema), schema)
    if "enum" in field:
        return " or ".join(json.dumps(value) for value in field["enum"])
    if "const" in field:
        return json.dumps(field["const"])
    if "anyOf" in field:
        return " or ".join(_type(option, schema) for option in field["anyOf"])
    if "prefixItems" in field:
        return f"{len(field['prefixItems'])} x {_type(field['prefixItems'][0], schema)}"
    if "items" in field:
        return f"list of {_type(field['items'], schema)}"
    return str(field.get("type", "any"))


def _bounds(field: dict[str, Any]) -> Iterator[str]:
    for option in [field, *field.get("anyOf", ())]:
        for key, text in _BOUNDS.items():
            if key in option:
                yield text.format(f"{option[key]:g}")
