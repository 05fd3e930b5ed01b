# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Python source of what a field needs: its annotation, its check, its default, its line of documentation."""

from __future__ import annotations

from cdff_common.codecs.schema import (
    Array,
    Boolean,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    Octets,
    Real,
    Struct,
    Text,
)


def int_dtype(node: Integer) -> str:
    """Name of the smallest dtype that holds low..high."""
    for bits in (8, 16, 32, 64):
        if node.low >= 0 and node.high < 1 << bits:
            return f"uint{bits}"
        if -(1 << (bits - 1)) <= node.low and node.high < 1 << (bits - 1):
            return f"int{bits}"
    raise ValueError(f"INTEGER {node.low}..{node.high} does not fit 64 bits")


def numpy_dtype(node: Array | Octets) -> str:
    """Name of the dtype of an array."""
    if isinstance(node, Octets):
        kinds = {"u": "uint", "i": "int", "f": "float"}
        return f"{kinds[node.dtype[1]]}{8 * int(node.dtype[2:])}"
    if isinstance(node.element, Integer):
        return int_dtype(node.element)
    return "float64" if isinstance(node.element, Real) else "bool_"


def annotation(node: Node) -> str:
    """Annotation of a field."""
    match node:
        case Real():
            return "float"
        case Integer():
            return "int"
        case Boolean():
            return "bool"
        case Text():
            return "str"
        case Array() | Octets():
            return f"NDArray[np.{numpy_dtype(node)}]"
        case ListOf():
            return f"tuple[{annotation(node.element)}, ...]"
        case Struct() | Enumeration() | Choice():
            return node.class_name


def check(node: Node, value: str, where: str) -> str:
    """Expression that checks ``value``; ``where`` is the source text of its place."""
    match node:
        case Real():
            return f"check.real({value}, {where})"
        case Integer():
            return f"check.integer({value}, {where}, {node.low}, {node.high})"
        case Boolean():
            return f"check.boolean({value}, {where})"
        case Text():
            return f"check.text({value}, {where}, {node.high})"
        case Octets(dtype="|u1"):
            return f"check.octets({value}, {where}, {node.high})"
        case Octets():
            return f'check.typed_octets({value}, {where}, {node.high}, "{node.dtype}", {node.columns})'
        case Array(element=Integer()):
            element = node.element
            assert isinstance(element, Integer)
            bounds = f"{node.dims}, {element.low}, {element.high}"
            return f'check.integer_array({value}, {where}, {bounds}, "{numpy_dtype(node)}")'
        case Array():
            kind = "real" if isinstance(node.element, Real) else "boolean"
            return f"check.{kind}_array({value}, {where}, {node.dims})"
        case ListOf():
            inner = check(node.element, "v", "w")
            return f"check.items({value}, {where}, {node.low}, {node.high}, lambda v, w: {inner})"
        case Enumeration():
            return f"check.enumeration({value}, {where}, {node.class_name})"
        case Struct() | Choice():
            return f"check.instance({value}, {where}, {node.class_name})"


def default(node: Node, name: str, type_name: str, version: int) -> str:
    """Source of a field's default: neutral, identity for rotations, NaN for what is unknown until it is said."""
    value = neutral(node)
    if isinstance(node, Integer):
        value = {"usecPerSec": "1000000", "msgVersion": str(version)}.get(name, value)
    if type_name in ("Quaterniond", "Orientation"):
        value = "np.array([0.0, 0.0, 0.0, 1.0])"
    elif isinstance(node, Array) and name.startswith("cov"):
        value = f"np.full({tuple(low for low, _ in node.dims)}, np.nan)"
    if isinstance(node, Struct | Choice):
        return f"field(default_factory={node.class_name})"
    mutable = "(" in value.removeprefix("()")
    return f"field(default_factory=lambda: {value})" if mutable else value


def neutral(node: Node) -> str:
    """Expression of the smallest value of a node: zeros, empty text, as few elements as it may have."""
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
        case Octets():
            return f"np.zeros({(0, node.columns) if node.columns else 0}, np.{numpy_dtype(node)})"
        case Array():
            return f"np.zeros({tuple(low for low, _ in node.dims)}, np.{numpy_dtype(node)})"
        case ListOf(low=0):
            return "()"
        case ListOf():
            return f"({neutral(node.element)},) * {node.low}"


def member(name: str) -> str:
    """Python name of a member of an enumeration."""
    return name.replace("-", "_").upper()


def documented_type(node: Node) -> str:
    """Type of a field as a docstring says it, with shape or range."""
    match node:
        case Array():
            shape = ", ".join(str(a) if a == b else f"{a}..{b}" for a, b in node.dims)
            return f"{annotation(node)}, shape ({shape}{',' if len(node.dims) == 1 else ''})"
        case Octets():
            return f"{annotation(node)}, shape (n,{f' {node.columns}' if node.columns else ''})"
        case Integer():
            return f"int, {node.low}..{node.high}"
        case Text():
            return f"str, at most {node.high} octets"
        case _:
            return annotation(node)


def sentence(text: str) -> str:
    """Text with a full stop."""
    return text if text.endswith((".", "?", "!")) else f"{text}."
