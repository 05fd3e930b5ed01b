# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``types.md``: every type of the wire with units and frames as its ASN.1 module says."""

from __future__ import annotations

import numpy as np

from cdff_common.asn1 import asn1_files
from cdff_common.codecs.schema import Array, Choice, Enumeration, Integer, ListOf, Node, Octets, Text
from cdff_dev.generate.asn1_model import ModelReader, TypeModel
from cdff_dev.generate.python_source import render

_SCALARS = {"Real": "float", "Boolean": "bool"}


def page() -> str:
    """Page of all types, by the file that declares them."""
    families: dict[str, list[TypeModel]] = {}
    for model in ModelReader(asn1_files()).types.values():
        families.setdefault(model.module, []).append(model)
    ordered = {family: sorted(models, key=lambda m: m.name) for family, models in sorted(families.items())}
    return render("types.md.j2", families=ordered, rows=_rows)


def _rows(model: TypeModel) -> list[tuple[str, str, str]]:
    """``(attribute, content, comment)`` of each field, alternative or member."""
    node = model.node
    if isinstance(node, Enumeration):
        return [(name, str(value), model.field_comments.get(name, "")) for name, value in node.members]
    if isinstance(node, Choice):
        return [(f.attribute, _content(f.node), model.field_comments.get(f.name, "")) for f in node.alternatives]
    fields = getattr(node, "fields", None)
    if fields is None:
        return [(node.attribute, _content(node.node), "")]  # type: ignore[union-attr]  # an Alias has no fields
    return [(f.attribute, _content(f.node), model.field_comments.get(f.name, "")) for f in fields]


def _content(node: Node) -> str:
    """What a field holds, in the words of Python."""
    match node:
        case Integer():
            return f"int {node.low}…{node.high}"
        case Text():
            return f"str, at most {node.high} octets"
        case Octets():
            return f"octets as {np.dtype(node.dtype).name}" + (f", {node.columns} columns" if node.columns else "")
        case Array():
            sizes = " x ".join(str(low) if low == high else f"{low}…{high}" for low, high in node.dims)
            return f"array of {_content(node.element)}, {sizes}"
        case ListOf():
            return f"{node.low}…{node.high} of {_content(node.element)}"
        case _:
            return _SCALARS.get(type(node).__name__) or node.class_name  # type: ignore[union-attr]  # scalars have none
