# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Python expressions for the fields of types: annotation, default and documented type."""

from __future__ import annotations

from cdff_common.types.schema import (
    Array,
    Boolean,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    OctetString,
    Real,
    Struct,
    Text,
)


def annotation(node: Node) -> str:
    """Return the annotation of a field."""
    match node:
        case Real():
            return "float"
        case Integer():
            return "int"
        case Boolean():
            return "bool"
        case Text():
            return "str"
        case Array() | OctetString():
            return f"NDArray[np.{node.scalar_name}]"
        case ListOf():
            return f"tuple[{annotation(node.element)}, ...]"
        case Struct() | Enumeration() | Choice():
            return node.class_name


def default(node: Node, name: str, type_name: str, version: int) -> str:
    """Return the source of the default: identity for rotations, NaN for covariances, else ``neutral``."""
    value = neutral(node)
    if isinstance(node, Integer):
        value = {"usecPerSec": "1000000", "msgVersion": str(version)}.get(name, value)
    if type_name in ("Quaterniond", "Orientation"):
        value = "np.array([0.0, 0.0, 0.0, 1.0])"
    elif isinstance(node, Array) and name.startswith("cov"):
        value = f"np.full({tuple(low for low, _ in node.dims)}, np.nan)"
    if isinstance(node, Struct | Choice):
        return f"field(default_factory={node.class_name})"
    is_mutable = "(" in value.removeprefix("()")
    return f"field(default_factory=lambda: {value})" if is_mutable else value


def neutral(node: Node) -> str:
    """Return the expression of a neutral value: zeros, empty text, the smallest number of elements."""
    match node:
        case Real():
            return "0.0"
        case Integer():
            return str(min(max(0, node.low), node.high))
        case Boolean():
            return "False"
        case Text():
            return '""'
        case Enumeration():
            return f"{node.class_name}.{member(node.members[0][0])}"
        case Struct() | Choice():
            return f"{node.class_name}()"
        case OctetString():
            return f"np.zeros({(0, node.columns) if node.columns else 0}, np.{node.scalar_name})"
        case Array():
            return f"np.zeros({tuple(low for low, _ in node.dims)}, np.{node.scalar_name})"
        case ListOf(low=0):
            return "()"
        case ListOf():
            return f"({neutral(node.element)},) * {node.low}"


def member(name: str) -> str:
    """Return the Python name of a member of an enumeration."""
    return name.replace("-", "_").upper()


def documented_type(node: Node) -> str:
    """Return the type of a field for a docstring, with shape or range."""
    match node:
        case Array():
            shape = ", ".join(str(a) if a == b else f"{a}..{b}" for a, b in node.dims)
            return f"{annotation(node)}, shape ({shape}{',' if len(node.dims) == 1 else ''})"
        case OctetString():
            return f"{annotation(node)}, shape (n,{f' {node.columns}' if node.columns else ''})"
        case Integer():
            return f"int, {node.low}..{node.high}"
        case Text():
            return f"str, at most {node.high} bytes"
        case _:
            return annotation(node)


def sentence(text: str) -> str:
    """Return the text with a full stop."""
    return text if text.endswith((".", "?", "!")) else f"{text}."
