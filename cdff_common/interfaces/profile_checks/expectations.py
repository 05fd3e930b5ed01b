# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wrong fields in words: expectation and nearest name, from the error of the model and its JSON Schema."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from pydantic_core import ErrorDetails

from cdff_common.contract.names import FRAME_ID, NAME
from cdff_common.contract.wiring import WIRING
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.profile_checks.faults import ABSENT, Finding, nearest_name, one_of
from cdff_common.interfaces.yaml_file import Location

_PATTERNS = {
    rf"^{NAME}$": "a name of lower-case letters, digits and _ that starts with a letter",
    rf"^{FRAME_ID}$": "a frame such as mana/base, in lower-case letters, digits, _ and /",
    rf"^{WIRING}$": "sensor/SENSOR/STREAM, product/DFPC/PORT or dpm/ROBOT/PRODUCT, or several with |",
}


def finding_of(error: ErrorDetails, location: Location, data: Any) -> Finding:
    """Return the finding of a validation error at a location of the data."""
    kind, name = error["type"], str(location[-1]) if location else ""
    if kind == "missing":
        known = _keys(_schema_at(location[:-1]))
        present = [str(key) for key in _keys_at(data, location[:-1]) if str(key) not in known]
        written = nearest_name(name, present)
        hint = f"; {written!r} is no key" if written else ""
        return Finding(location, f"missing, expected a value{hint}", ABSENT)
    if kind == "extra_forbidden":
        return _unknown_key(location, name)
    value = name if error["loc"] and error["loc"][-1] == "[key]" else error["input"]
    if kind in ("literal_error", "enum"):
        known = _literals(_schema_at(location))
        return Finding(location, f"expected {one_of(known)}", value, nearest_name(value, known))
    if kind == "string_pattern_mismatch":
        pattern = error["ctx"]["pattern"]
        text = str(value).strip().lower().replace("-", "_").replace(" ", "_")
        nearest = text if re.match(pattern, text) and text != value else ""
        return Finding(location, f"expected {_PATTERNS.get(pattern, pattern)}", value, nearest)
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return Finding(location, "expected a mapping of keys and values", _value_of_finding(value))
    return Finding(location, in_words(error["msg"]), _value_of_finding(value))


def _unknown_key(location: Location, name: str) -> Finding:
    known = _keys(_schema_at(location[:-1]))
    nearest = nearest_name(name, known)
    others = [] if nearest else [(k, owner) for owner, keys in _all_keys() for k in keys if _is_same(name, k)]
    hint = f"; {others[0][0]} is a key of {others[0][1]}" if others else ""
    return Finding(location, f"unknown key; expected {one_of(known)}{hint}", ABSENT, nearest)


def in_words(message: str) -> str:
    """Return the message of a model without its usual beginnings."""
    message = message.removeprefix("Value error, ")
    message = re.sub(
        r"^(Input|Value|String|Tuple|List|Dictionary) should (be|have|match) ", "expected ", message
    )
    return message[0].lower() + message[1:] if message[:2] != message[:2].upper() else message


def _value_of_finding(value: Any) -> Any:
    return ABSENT if isinstance(value, dict) else value


def _keys_at(data: Any, location: Location) -> list[Any]:
    for key in location:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return []
    return list(data) if isinstance(data, dict) else []


@cache
def _schema() -> dict[str, Any]:
    return Profile.model_json_schema()


def _is_same(name: str, key: str) -> bool:
    """Return True for a key with the same name, or with the name and a unit."""
    return key == name or key.startswith(f"{name}_")


def _all_keys() -> Iterator[tuple[str, list[str]]]:
    """Yield each model of the schema with its keys."""
    for owner, schema in _schema()["$defs"].items():
        yield owner, _keys(schema)


def _keys(schema: dict[str, Any]) -> list[str]:
    """Return the keys of a mapping, or of all its alternatives."""
    options = [_resolve(option) for option in schema.get("anyOf", (schema,))]
    return [key for option in options for key in option.get("properties", {})]


def _literals(schema: dict[str, Any]) -> list[str]:
    options = [_resolve(option) for option in schema.get("anyOf", (schema,))]
    return [str(value) for option in options for value in option.get("enum", ())]


def _schema_at(location: Location) -> dict[str, Any]:
    """Return the JSON Schema of a location; empty for a free one."""
    schemas = [_schema()]
    for key in location:
        schemas = [inner for schema in schemas for inner in _inner(schema, key)]
    options = [option for schema in schemas for option in schema.get("anyOf", (schema,))]
    return {"anyOf": options} if options else {}


def _inner(schema: dict[str, Any], key: str | int) -> Iterator[dict[str, Any]]:
    """Yield the schemas that a value may have under a key or index."""
    for option in schema.get("anyOf", (schema,)):
        resolved = _resolve(option)
        if isinstance(key, int):
            inner = resolved.get("items")
        else:
            inner = resolved.get("properties", {}).get(key, resolved.get("additionalProperties"))
            patterns = resolved.get("patternProperties", {})
            inner = next(iter(patterns.values()), inner) if not isinstance(inner, dict) else inner
        if isinstance(inner, dict):
            yield _resolve(inner)


def _resolve(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a schema, or the definition that it references."""
    if "$ref" in schema:
        resolved: dict[str, Any] = _schema()["$defs"][schema["$ref"].rsplit("/", 1)[-1]]
        return resolved
    return schema
