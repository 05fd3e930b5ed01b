# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``profile.md``: all fields of a mission profile, from the JSON Schema of its model."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from cdff_common.interfaces.profile import Profile
from cdff_dev.generate.python_source import render


def page() -> str:
    """Return the page of the sections of a profile, in the order in which they occur in a profile."""
    sections = [
        (name, section.get("description", "").partition("Attributes\n")[0].strip(), rows(section))
        for name, section in model_sections(Profile)
    ]
    return render("profile.md.j2", sections=sections)


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
            "required" if name in required else f"`{field.get('default')}`" if "default" in field else "",
            field.get("description", "") or attributes.get(name, ""),
        )
        for name, field in section.get("properties", {}).items()
    ]


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
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "enum" in field:
        return " or ".join(f"`{value}`" for value in field["enum"])
    if "const" in field:
        return f"`{field['const']}`"
    if "anyOf" in field:
        return " or ".join(_type(option) for option in field["anyOf"])
    if field.get("type") == "array":
        return f"list of {_type(field.get('items', {}))}"
    if field.get("type") == "object" and isinstance(field.get("additionalProperties"), dict):
        return f"map of {_type(field['additionalProperties'])}"
    return str(field.get("type", "any"))
