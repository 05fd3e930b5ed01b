# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of a configuration model as rows, for ``cdff dfn show`` and the reference pages."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import StrictModel

_BOUNDS = {"minimum": "≥ {}", "exclusiveMinimum": "> {}", "maximum": "≤ {}", "exclusiveMaximum": "< {}"}


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """Parameter: name, JSON type, default as JSON, bounds as text, description."""

    name: str
    type: str
    default: str
    bounds: str
    doc: str


def parameter_rows(config: type[StrictModel]) -> list[ParameterRow]:
    """Return one row per field of the model, in order; fields of a nested model have its name and a dot."""
    schema = config.model_json_schema()
    return list(_rows(schema, schema, {}, ""))


def _rows(
    model: dict[str, Any], schema: dict[str, Any], preset: dict[str, Any], prefix: str
) -> Iterator[ParameterRow]:
    """Yield the rows of a model; ``preset`` are the values that the containing field sets instead of
    the defaults.
    """
    required = set(model.get("required", ())) - set(preset)
    for name, field in model.get("properties", {}).items():
        default = preset.get(name, field.get("default"))
        inner = _resolve(field, schema)
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


def _resolve(field: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """Return the field, or the definition that it references."""
    return schema["$defs"][field["$ref"].rsplit("/", 1)[1]] if "$ref" in field else field


def _type(field: dict[str, Any], schema: dict[str, Any]) -> str:
    """Return the type of a field of a JSON schema as a text."""
    if "$ref" in field:
        return _type(_resolve(field, schema), schema)
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
