# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``types.md`` and a page for each type: units and frames as its ASN.1 module says, constraints, octets on the wire."""

from __future__ import annotations

import numpy as np

from cdff_common.asn1 import asn1_files
from cdff_common.codecs.schema import Alias, Array, Choice, Enumeration, Integer, ListOf, Node, Octets, Struct, Text
from cdff_common.codecs.sizes import uper_octets
from cdff_dev.generate.asn1_model import ModelReader, TypeModel
from cdff_dev.generate.python_source import render

_SCALARS = {"Real": "float", "Boolean": "bool"}


def pages() -> dict[str, str]:
    """Path under ``docs/reference`` and text: the index, by the file that declares a type, and a page for each."""
    models = [m for m in ModelReader(asn1_files()).types.values() if not m.is_sibling]
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
    """``(ASN.1 type, octets)`` of a type and its sibling."""
    both = [model] if model.large is None else [model, model.large]
    return [(m.name, _size(m)) for m in both if isinstance(m.node, Struct | Alias)]


def _size(model: TypeModel) -> str:
    """Octets of a message in UPER: least and most; nothing for what is no message."""
    if not isinstance(model.node, Struct | Alias):
        return ""
    least, most = uper_octets(model.name)
    return f"{least:,}" if least == most else f"{least:,} to {most:,}"


def _users(model: TypeModel, models: list[TypeModel]) -> list[str]:
    """Names of the classes that have a field of this type."""
    return sorted(m.class_name for m in models if m is not model and model.class_name in _linked(m))


def _linked(model: TypeModel) -> set[str]:
    node = model.node
    parts: list[Node] = [f.node for f in node.fields] if isinstance(node, Struct) else []
    if isinstance(node, Choice):
        parts = [f.node for f in node.alternatives]
    if isinstance(node, Alias):
        parts = [node.node]
    inner = [p.element if isinstance(p, ListOf) else p for p in parts]
    return {p.class_name for p in inner if isinstance(p, Struct | Enumeration | Choice)}


def _rows(model: TypeModel) -> list[tuple[str, str, str, str]]:
    """``(attribute, ASN.1 name, content, comment)`` of each field, alternative or member."""
    node = model.node
    if isinstance(node, Enumeration):
        return [(n.replace("-", "_").upper(), n, str(v), model.field_comments.get(n, "")) for n, v in node.members]
    if isinstance(node, Alias):
        return [(node.attribute, "", _content(node.node), "")]
    fields = node.alternatives if isinstance(node, Choice) else node.fields
    return [(f.attribute, f.name, _content(f.node), model.field_comments.get(f.name, "")) for f in fields]


def _content(node: Node) -> str:
    """What a field holds, in the words of Python; messages are links to their pages."""
    match node:
        case Integer():
            return f"int {node.low}…{node.high}"
        case Text():
            return f"str, at most {node.high} octets"
        case Octets():
            columns = f", {node.columns} columns" if node.columns else ""
            return f"octets as {np.dtype(node.dtype).name}{columns}, at most {node.high:,} octets"
        case Array():
            sizes = " x ".join(str(low) if low == high else f"{low}…{high}" for low, high in node.dims)
            return f"array of {_content(node.element)}, {sizes}"
        case ListOf():
            return f"{node.low}…{node.high} of {_content(node.element)}"
        case Struct() | Enumeration() | Choice():
            return f"[{node.class_name}]({node.class_name}.md)"
        case _:
            return _SCALARS[type(node).__name__]
