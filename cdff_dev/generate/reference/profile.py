# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``profile.md``: all fields of a mission profile, from its JSON Schema and a complete example."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml
from pydantic import BaseModel

from cdff_common.interfaces.profile import ROBOT_LIMITS, Profile
from cdff_dev.generate.python_source import render

#: Units by the end of a name; the longest end counts.
_UNITS = {
    "_m": "m", "_s": "s", "_deg": "°", "_hz": "Hz", "_px": "px", "_mb": "MB", "_m_s": "m/s", "_bytes": "B",
    "_cores": "s/s",
}  # fmt: skip
#: Largest number of characters of a default that a table contains.
_LONGEST_DEFAULT = 60


def page() -> str:
    """Return the page of the sections of a profile, in the order in which they occur in a profile."""
    text = render("profile_example.yaml").rstrip()
    examples = dict(_examples(Profile, yaml.load(text, Loader=yaml.BaseLoader)))
    sections = [
        (
            name,
            section.get("description", "").partition("Attributes\n")[0].strip(),
            [(*row, unit(row[0]), examples.get((name, row[0]), "")) for row in rows(section)],
        )
        for name, section in model_sections(Profile)
    ]
    limits = [(name, unit(name), meaning) for name, meaning in ROBOT_LIMITS.items()]
    return render("profile.md.j2", sections=sections, limits=limits, example=text)


def unit(field: str) -> str:
    """Return the unit that the name of a field states, empty if it has none."""
    ends = [end for end in _UNITS if field.endswith(end)]
    return _UNITS[max(ends, key=len)] if ends else ""


def _examples(model: type[BaseModel], data: Any) -> Iterator[tuple[tuple[str, str], str]]:
    """Yield the first value of each field of the models in an example, as YAML on one line."""
    schema = model.model_json_schema()
    previous_fields: set[tuple[str, str]] = set()
    waiting = [(schema | {"title": model.__name__}, data)]
    for section, values in waiting:
        if isinstance(values, list):
            items = section.get("items", {})
            waiting += [(_resolve(items, schema), value) for value in values]
        elif isinstance(values, dict):
            fields = section.get("properties")
            name = section.get("title", "")
            for key, value in values.items():
                field = _element(section) if fields is None else fields[key]
                if (
                    fields is not None
                    and (name, key) not in previous_fields
                    and not _is_section(field, schema)
                ):
                    previous_fields.add((name, key))
                    yield (name, key), _flow(value)
                waiting += [(option, value) for option in _options(field, schema)]


def _options(field: dict[str, Any], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the alternatives of a field that contain fields of their own."""
    options = [_resolve(option, schema) for option in field.get("anyOf", (field,))]
    return [option for option in options if option.get("type") in ("object", "array")]


def _is_section(field: dict[str, Any], schema: dict[str, Any]) -> bool:
    """Return True for a list or mapping of models, which have sections of their own."""
    return any(
        "properties" in _resolve(inner, schema)
        for option in _options(field, schema)
        for inner in (option, option.get("items", {}), _element(option))
    )


def _element(section: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of the values of a mapping; empty if they are free."""
    patterns = list(section.get("patternProperties", {}).values())
    additional = section.get("additionalProperties")
    element: dict[str, Any] = patterns[0] if patterns else additional if isinstance(additional, dict) else {}
    return element


def _resolve(field: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    name = field["$ref"].rsplit("/", 1)[-1] if "$ref" in field else ""
    return schema["$defs"][name] | {"title": name} if name else field


def _flow(value: Any) -> str:
    """Return a value as YAML on one line, without the quotation marks of text that reads as a number."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return str(value)


def model_sections(model: type[BaseModel]) -> list[tuple[str, dict[str, Any]]]:
    """Return the name and JSON Schema of a model and of the models in its fields, in order of occurrence."""
    schema = model.model_json_schema()
    sections = [(model.__name__, schema)]
    listed = {model.__name__}
    for _, section in sections:
        for field in section.get("properties", {}).values():
            for name in _references(field):
                if name not in listed and "properties" in schema["$defs"][name]:
                    listed.add(name)
                    sections.append((name, schema["$defs"][name]))
    return sections


def rows(section: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return name, type, default and description of each field."""
    required = set(section.get("required", ()))
    attributes = _attributes(section.get("description", ""))
    return [
        (
            name,
            _type(field),
            "required" if name in required else _default(field),
            field.get("description", "") or attributes.get(name, ""),
        )
        for name, field in section.get("properties", {}).items()
    ]


def _default(field: dict[str, Any]) -> str:
    """Return a default as YAML; that of a long section is described there."""
    if "default" not in field:
        return ""
    text = _flow(_without_empty_models(field["default"]))
    if text == "":
        return "empty"
    return f"`{text}`" if len(text) <= _LONGEST_DEFAULT else "that of its fields"


def _without_empty_models(value: Any) -> Any:
    """Return a default without fields of models that are empty."""
    if isinstance(value, dict):
        return {key: _without_empty_models(item) for key, item in value.items() if item not in (None, "")}
    return value


def _attributes(docstring: str) -> dict[str, str]:
    """Return the description of each field in the section ``Attributes`` of a docstring (numpydoc)."""
    descriptions: dict[str, str] = {}
    names: list[str] = []
    for line in docstring.partition("Attributes\n")[2].splitlines()[1:]:
        if line.startswith(" "):
            for name in names:
                descriptions[name] = f"{descriptions.get(name, '')} {line.strip()}".strip()
        else:
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
    return descriptions


def _references(field: Any) -> list[str]:
    if isinstance(field, dict):
        direct = [field["$ref"].rsplit("/", 1)[-1]] if "$ref" in field else []
        return direct + [name for value in field.values() for name in _references(value)]
    if isinstance(field, list):
        return [name for value in field for name in _references(value)]
    return []


def _type(field: dict[str, Any]) -> str:
    """Return the type of a field as Markdown, with links to models."""
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "enum" in field:
        return " or ".join(f"`{value}`" for value in field["enum"])
    if "const" in field:
        return f"`{field['const']}`"
    if "anyOf" in field:
        return " or ".join(_type(option) for option in field["anyOf"])
    if "prefixItems" in field:
        return f"{len(field['prefixItems'])} × {_type(field['prefixItems'][0])}"
    if field.get("type") == "array":
        return f"list of {_type(field.get('items', {}))}"
    if field.get("type") == "object" and _element(field):
        return f"map of {_type(_element(field))}"
    return str(field.get("type", "any"))
