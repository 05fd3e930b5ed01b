# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ASN.1 types as OMG IDL, with the bounds of their lists.

Types have the suffix ``_t``, since IDL compares names without case and refuses a field ``time`` of the type
``Time``. Enumerators have the name of their type before them, since they share its scope.
"""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.types.schema import (
    Alias,
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
    fields_of,
)
from cdff_dev.taste.types_used import UsedType, used_types

#: Module of the types.
MODULE = "cdff"

_INTEGERS = {
    "uint8": "octet",
    "int8": "short",
    "int16": "short",
    "uint16": "unsigned short",
    "int32": "long",
    "uint32": "unsigned long",
    "int64": "long long",
    "uint64": "unsigned long long",
}
_KEYWORDS = """
    abstract any attribute boolean case char component const consumes context custom default double emits
    enum eventtype exception factory false finder fixed float getraises home import in inout interface local
    long module multiple native object octet oneway out primarykey private provides public publishes raises
    readonly sequence setraises short string struct supports switch true truncatable typedef typeid
    typeprefix union unsigned uses valuebase valuetype void wchar wstring
"""


def idl_text(type_names: Iterable[str], source: str) -> str:
    """Return the text of an IDL file with types and all types that these use.

    Parameters
    ----------
    type_names : iterable of str
        Names of ASN.1 types.
    source : str
        Origin, for the comment.
    """
    guard = f"{MODULE}_{source}_idl".replace("-", "_")
    writer = _Writer()
    for used in used_types(type_names):
        writer.declare(used)
    lines = [
        f"// GENERATED from {source} by cdff generate genom3; do not edit.",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        f"module {MODULE} {{",
        *(f"  {line}" for line in writer.lines),
        "};",
        "",
        "#endif",
    ]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def identifier(name: str) -> str:
    """Return a name as an identifier of IDL; keywords get a leading ``_``."""
    name = name.replace("-", "_")
    return f"_{name}" if name.lower() in _KEYWORDS.split() else name


class _Writer:
    """Declarations of IDL; types of fields without a name of their own become types of ``OWNER_FIELD_t``."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._names: dict[Node | Alias, str] = {}

    def declare(self, used: UsedType) -> None:
        """Declare a named type."""
        name = f"{used.aadl_name}_t"
        node = used.node
        match node:
            case Struct():
                self._structure(used.aadl_name, node)
            case Enumeration():
                members = [f"{used.aadl_name}_{member.replace('-', '_')}" for member, _ in node.members]
                self.lines += [f"enum {name} {{ {', '.join(members)} }};"]
            case Alias():
                self._definition(name, node.node, used.aadl_name)
            case _:
                self._definition(name, node, used.aadl_name)
        self._names.setdefault(node, name)

    def _structure(self, owner: str, node: Struct) -> None:
        fields = []
        for member in fields_of(node):
            type_name = self._type(member.node, f"{owner}_{member.key}")
            fields.append(f"  {type_name} {identifier(member.name)};")
        self.lines += [f"struct {owner}_t {{", *fields, "};"]

    def _type(self, node: Node, owner: str) -> str:
        """Return the type of a field; declare it if it has no name."""
        if (basic := _basic(node)) is not None:
            return basic
        if node in self._names:
            return self._names[node]
        name = f"{owner}_t"
        if isinstance(node, Choice):
            self._union(name, node, owner)
        else:
            self._definition(name, node, owner)
        return name

    def _union(self, name: str, node: Choice, owner: str) -> None:
        kinds = [f"{owner}_is_{a.key}" for a in node.alternatives]
        cases = []
        for kind, alternative in zip(kinds, node.alternatives, strict=True):
            type_name = self._type(alternative.node, f"{owner}_{alternative.key}")
            cases.append(f"  case {kind}: {type_name} {identifier(alternative.name)};")
        self.lines += [f"enum {owner}_kind_t {{ {', '.join(kinds)} }};"]
        self.lines += [f"union {name} switch ({owner}_kind_t) {{", *cases, "};"]

    def _definition(self, name: str, node: Node, owner: str) -> None:
        """Declare another name for a type: a number, an array or a list."""
        match node:
            case Array():
                text = _basic(node.element)
                for depth, (low, high) in enumerate(reversed(node.dims)):
                    is_last = depth == len(node.dims) - 1
                    inner = name if is_last else f"{owner}_row{depth}_t"
                    if low == high:
                        self.lines += [f"typedef {text} {inner}[{high}];"]
                    else:
                        self.lines += [f"typedef sequence<{text}, {high}> {inner};"]
                    text = inner
            case ListOf():
                text = self._type(node.element, f"{owner}_element")
                is_fixed = node.low == node.high
                bounded = (
                    f"{text} {name}[{node.high}]" if is_fixed else f"sequence<{text}, {node.high}> {name}"
                )
                self.lines += [f"typedef {bounded};"]
            case _:
                self.lines += [f"typedef {_basic(node)} {name};"]


def _basic(node: Node) -> str | None:
    """Return the type of a number, a text or bytes; None for others."""
    match node:
        case Real():
            return "double"
        case Integer():
            return _INTEGERS[node.scalar_name]
        case Boolean():
            return "boolean"
        case Text():
            return f"string<{node.high}>"
        case OctetString():
            return f"sequence<octet, {node.high}>"
    return None
