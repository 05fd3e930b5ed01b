# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``types.md`` and a page for each type: fields with units and constraints, and encoded sizes."""

from __future__ import annotations

from cdff_common.codecs.sizes import uper_bytes
from cdff_common.types.schema import (
    Alias,
    Array,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    OctetString,
    Struct,
    Text,
    fields_of,
)
from cdff_dev.generate.asn1_model import TypeModel, type_models
from cdff_dev.generate.python_source import render

_SCALARS = {"Real": "float", "Boolean": "bool"}


def pages() -> dict[str, str]:
    """Return the text of the index and of the page of each type, by path below ``docs/reference``."""
    models = [m for m in type_models().values() if not m.is_large_variant]
    families: dict[str, list[TypeModel]] = {}
    for model in models:
        families.setdefault(model.module, []).append(model)
    ordered = {family: sorted(members, key=lambda m: m.name) for family, members in sorted(families.items())}
    texts = {"types.md": render("types.md.j2", families=ordered, size=_size)}
    for model in models:
        texts[f"types/{model.class_name}.md"] = render(
            "type.md.j2", model=model, rows=_rows(model), sizes=_sizes(model), used_by=_users(model, models)
        )
    return texts


def _sizes(model: TypeModel) -> list[tuple[str, str]]:
    """Return ``(ASN.1 type, bytes)`` of a type and its size variant."""
    both = [model] if model.large is None else [model, model.large]
    return [(m.name, _size(m)) for m in both if isinstance(m.node, Struct | Alias)]


def _size(model: TypeModel) -> str:
    """Return the smallest and largest size in UPER, in bytes; empty for a type that is not a message."""
    if not isinstance(model.node, Struct | Alias):
        return ""
    smallest, largest = uper_bytes(model.name)
    return f"{smallest:,}" if smallest == largest else f"{smallest:,} to {largest:,}"


def _users(model: TypeModel, models: list[TypeModel]) -> list[str]:
    """Return the names of the classes that have a field of this type."""
    return sorted(m.class_name for m in models if m is not model and model.class_name in _field_classes(m))


def _field_classes(model: TypeModel) -> set[str]:
    """Return the names of the classes of the fields of a type."""
    nodes = [f.node.element if isinstance(f.node, ListOf) else f.node for f in fields_of(model.node)]
    return {node.class_name for node in nodes if isinstance(node, Struct | Enumeration | Choice)}


def _rows(model: TypeModel) -> list[tuple[str, str, str, str]]:
    """Return ``(attribute, ASN.1 name, content, comment)`` of each field, alternative or member."""
    node = model.node
    if isinstance(node, Enumeration):
        return [
            (n.replace("-", "_").upper(), n, str(v), model.field_comments.get(n, "")) for n, v in node.members
        ]
    return [
        (
            f.attribute,
            "" if isinstance(node, Alias) else f.name,
            _content(f.node),
            model.field_comments.get(f.name, ""),
        )
        for f in fields_of(node)
    ]


def _content(node: Node) -> str:
    """Return the content of a field in Python terms; message types are links to their pages."""
    match node:
        case Integer():
            return f"int {node.low}…{node.high}"
        case Text():
            return f"str, at most {node.high} bytes"
        case OctetString():
            columns = f", {node.columns} columns" if node.columns else ""
            return f"{node.scalar_name} array{columns}, at most {node.high:,} bytes"
        case Array():
            sizes = " x ".join(str(low) if low == high else f"{low}…{high}" for low, high in node.dims)
            return f"array of {_content(node.element)}, {sizes}"
        case ListOf():
            return f"{node.low}…{node.high} of {_content(node.element)}"
        case Struct() | Enumeration() | Choice():
            return f"[{node.class_name}]({node.class_name}.md)"
        case _:
            return _SCALARS[type(node).__name__]
