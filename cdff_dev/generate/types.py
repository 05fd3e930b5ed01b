# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generates the Python types and the codecs' table from the ASN.1 modules.

Each ``cdff_common/asn1/<family>.asn`` gives ``cdff_common/types/<family>.py``. Behaviour is written by hand in
``cdff_common/types/<family>_ext.py``: a class ``<Type>Ext`` there becomes a base of the generated ``<Type>``.
"""

from __future__ import annotations

import ast
import textwrap
from pathlib import Path

import cdff_common
from cdff_common.asn1 import asn1_files
from cdff_common.codecs.schema import (
    Alias,
    Array,
    Choice,
    Enumeration,
    Field,
    Integer,
    ListOf,
    Node,
    Octets,
    Struct,
    Text,
)
from cdff_dev.generate.asn1_model import ModelReader, TypeModel
from cdff_dev.generate.type_expressions import annotation, check, default, documented_type, member, sentence

#: Fields that are the time of a message.
_STAMPS = ("timestamp", "time_stamp", "ref_time")
_NODES = "Alias, Array, Boolean, Choice, Enumeration, Field, Integer, ListOf, Message, Octets, Real, Struct, Text"
#: The package, and its place in the repository.
_SOURCE = Path(cdff_common.__file__).parent
_PACKAGE = Path("cdff_common")
_LICENCE = "# SPDX-FileCopyrightText: 2026 the CDFF contributors\n# SPDX-License-Identifier: BSD-3-Clause\n"


def _mark(source: str) -> str:
    return f"{_LICENCE}# GENERATED from {source} by cdff generate; do not edit.\n"


def render() -> dict[Path, str]:
    """Return path in the repository and content, not yet formatted, of every file generated from the ASN.1 modules."""
    models = ModelReader(asn1_files()).types
    families = sorted({m.module for m in models.values() if not m.is_sibling})
    out: dict[Path, str] = {}
    for family in families:
        out[_PACKAGE / "types" / f"{family}.py"] = _family_source(family, models)
    out[_PACKAGE / "types" / "__init__.py"] = _package_source(families, models)
    out[_PACKAGE / "codecs" / "schema_table.py"] = _table_source(models)
    return out


def _extensions(family: str) -> set[str]:
    """Names of the ``…Ext`` classes written by hand beside a family."""
    path = _SOURCE / "types" / f"{family}_ext.py"
    if not path.exists():
        return set()
    return {n.name for n in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(n, ast.ClassDef)}


def _docstring(model: TypeModel, fields: tuple[Field, ...]) -> list[str]:
    article = "an" if model.name[0] in "AEIOU" else "a"
    summary = model.comment or f"What {article} ``{model.name}`` of the ASN.1 modules holds."
    text = textwrap.wrap(f'"""{sentence(summary)}', 114)
    lines = [*(f"    {line}" for line in text), "", "    Attributes", "    ----------"]
    for f in fields:
        lines.append(f"    {f.attribute} : {documented_type(f.node)}")
        if f.name in model.field_comments:
            lines.append(f"        {sentence(model.field_comments[f.name])}")
    return [*lines, '    """']


def _class_source(model: TypeModel, extensions: set[str]) -> list[str]:
    node = model.class_node
    if isinstance(node, Enumeration):
        summary = sentence(model.comment or f"``{model.name}``")
        lines = [f"class {node.class_name}(IntEnum):", f'    """{summary}"""', ""]
        return lines + [f"    {member(name)} = {value}" for name, value in node.members]
    if isinstance(node, Choice):
        return _choice_source(model, node)
    if isinstance(node, Alias):
        fields: tuple[Field, ...] = (Field(node.attribute, node.attribute, node.node),)
        model.field_types = {node.attribute: model.name}
    else:
        fields = node.fields
    base = f"{node.class_name}Ext" if f"{node.class_name}Ext" in extensions else "Message"
    lines = ["@dataclass(frozen=True, slots=True, eq=False, repr=False)", f"class {node.class_name}({base}):"]
    lines += [*_docstring(model, fields), "", f'    ASN1_NAME: ClassVar[str] = "{model.name}"']
    for f in fields:
        initial = default(f.node, f.name, model.field_types[f.name], model.version)
        lines.append(f"    {f.attribute}: {annotation(f.node)} = {initial}")
    lines += ["", "    def __post_init__(self) -> None:", "        put = object.__setattr__"]
    for f in fields:
        where = f'"{node.class_name}.{f.attribute}"'
        lines.append(f'        put(self, "{f.attribute}", {check(f.node, f"self.{f.attribute}", where)})')
    if base != "Message":
        return [*lines, "        self._check_together()"]
    stamp = _stamp(fields)
    if stamp:
        lines += ["", "    @property", "    def stamp_ns(self) -> int:", '        """Time, nanoseconds."""']
        lines.append(f"        return self.{stamp}.ns")
    return lines


def _stamp(fields: tuple[Field, ...]) -> str:
    """Path of attributes to the time of a message, in its own fields or those of its metadata; empty where none."""
    for f in fields:
        if f.attribute in _STAMPS and annotation(f.node) == "Time":
            return f.attribute
        if f.attribute == "metadata" and isinstance(f.node, Struct) and (inner := _stamp(f.node.fields)):
            return f"metadata.{inner}"
    return ""


def _choice_source(model: TypeModel, node: Choice) -> list[str]:
    kinds = ", ".join(f'"{f.attribute}"' for f in node.alternatives)
    union = " | ".join(annotation(f.node) for f in node.alternatives)
    first = node.alternatives[0]
    lines = [
        "@dataclass(frozen=True, slots=True, eq=False, repr=False)",
        f"class {node.class_name}(Message):",
        f'    """{sentence(model.comment)}',
        "",
        "    Attributes",
        "    ----------",
        "    kind : str",
        f"        Which alternative: {kinds.replace(chr(34), '``')}.",
        f"    value : {union}",
        '    """',
        "",
        f'    ASN1_NAME: ClassVar[str] = "{model.name}"',
        f'    kind: str = "{first.attribute}"',
        f"    value: {union} = {default(first.node, first.name, '', 0)}",
        "",
        "    def __post_init__(self) -> None:",
        "        put = object.__setattr__",
    ]
    for i, f in enumerate(node.alternatives):
        where = f'"{node.class_name}.{f.attribute}"'
        lines += [
            f'        {"if" if i == 0 else "elif"} self.kind == "{f.attribute}":',
            f'            put(self, "value", {check(f.node, "self.value", where)})',
        ]
    return [
        *lines,
        "        else:",
        f"            raise InputError(f'{node.class_name}.kind={{self.kind!r}}: expected one of "
        f"{kinds.replace(chr(34), '')}')",
    ]


def _references(node: Node | Alias) -> set[str]:
    """Class names that the source of a node mentions."""
    match node:
        case Struct() | Enumeration() | Choice():
            return {node.class_name}
        case ListOf():
            return _references(node.element)
        case Alias():
            return _references(node.node)
        case _:
            return set()


def _family_source(family: str, models: dict[str, TypeModel]) -> str:
    own = [m for m in models.values() if m.module == family and not m.is_sibling]
    home = {m.class_name: m.module for m in models.values() if not m.is_sibling}
    needed: set[str] = set()
    for model in own:
        node = model.node
        parts = node.fields if isinstance(node, Struct) else node.alternatives if isinstance(node, Choice) else ()
        for f in parts:
            needed |= _references(f.node)
        if isinstance(node, Alias):
            needed |= _references(node)
    extensions = _extensions(family)
    body = "\n\n\n".join("\n".join(_class_source(m, extensions)) for m in own)
    imports: dict[str, set[str]] = {}
    for name in needed:
        if home[name] != family:
            imports.setdefault(f"cdff_common.types.{home[name]}", set()).add(name)
    if "check." in body:
        imports["cdff_common.types"] = {"validation as check"}
    if "(Message)" in body:
        imports["cdff_common.types.message"] = {"Message"}
    if "InputError" in body:
        imports["cdff_common.errors"] = {"InputError"}
    used = {n for n in extensions if f"({n})" in body}
    if used:
        imports[f"cdff_common.types.{family}_ext"] = used
    head = [
        _mark(f"cdff_common/asn1/{family}.asn"),
        f'"""Types of ``asn1/{family}.asn``."""',
        "",
        "from __future__ import annotations",
        "",
    ]
    if "@dataclass" in body:
        head.append(f"from dataclasses import dataclass{', field' if 'field(' in body else ''}")
    if "IntEnum" in body:
        head.append("from enum import IntEnum")
    if "ClassVar" in body:
        head.append("from typing import ClassVar")
    if "np." in body:
        head += ["", "import numpy as np"]
    if "NDArray" in body:
        head.append("from numpy.typing import NDArray")
    head += ["", *(f"from {module} import {', '.join(sorted(imports[module]))}" for module in sorted(imports))]
    return "\n".join(head) + f"\n\n\n{body}\n"


def _package_source(families: list[str], models: dict[str, TypeModel]) -> str:
    classes = [m for m in models.values() if not m.is_sibling]
    names = {f: sorted(m.class_name for m in classes if m.module == f) for f in families}
    lines = [
        _mark("cdff_common/asn1/*.asn"),
        '"""All types of the wire: frozen dataclasses over numpy, one per ASN.1 type."""',
        "",
        "from __future__ import annotations",
        "",
    ]
    lines += [f"from cdff_common.types.{f} import {', '.join(names[f])}" for f in families]
    lines += ["from cdff_common.types.message import Box, Message", "", "__all__ = ["]
    every = sorted([n for f in families for n in names[f]] + ["Box", "Message"])
    return "\n".join([*lines, *(f'    "{n}",' for n in every), "]"]) + "\n"


def _table_source(models: dict[str, TypeModel]) -> str:
    """The table of nodes: one variable a type, in order, so that each may name those before it."""
    variable = {_table_key(m.node): f"_{i}" for i, m in enumerate(models.values())}

    def source(node: Node, top: bool = False) -> str:
        if not top and isinstance(node, Struct | Enumeration | Choice):
            return variable[_table_key(node)]
        match node:
            case Struct():
                return f'Struct("{node.name}", "{node.class_name}", ({fields(node.fields)}))'
            case Choice():
                return f'Choice("{node.class_name}", ({fields(node.alternatives)}))'
            case ListOf():
                return f'ListOf({source(node.element)}, {node.low}, {node.high}, "{node.tag}")'
            case Enumeration():
                members = "".join(f'("{n}", {v}), ' for n, v in node.members)
                return f'Enumeration("{node.class_name}", ({members}))'
            case Octets():
                return f'Octets({node.high}, "{node.dtype}", {node.columns})'
            case Array():
                return f"Array({source(node.element)}, {node.dims}, {node.tags})"
            case Integer():
                return f"Integer({node.low}, {node.high})"
            case Text():
                return f"Text({node.high})"
            case _:
                return f"{type(node).__name__}()"

    def fields(items: tuple[Field, ...]) -> str:
        return "".join(f'\n    Field("{f.name}", "{f.attribute}", {source(f.node)}),' for f in items) + "\n"

    lines = [
        _mark("cdff_common/asn1/*.asn"),
        '"""The types as the codecs see them."""',
        "",
        "from __future__ import annotations",
        "",
        f"from cdff_common.codecs.schema import {_NODES}",
        "",
    ]
    messages = []
    for model in models.values():
        node = model.node
        if isinstance(node, Alias):
            messages.append(model)
            text = f'Alias("{node.name}", "{node.class_name}", "{node.attribute}", {source(node.node)})'
        else:
            if isinstance(node, Struct):
                messages.append(model)
            text = source(node, top=True)
        lines.append(f"{variable[_table_key(node)]} = {text}")
    lines += ["", "#: ASN.1 name -> node, of every type that can be a message.", "MESSAGES: dict[str, Message] = {"]
    lines += [f'    "{m.name}": {variable[_table_key(m.node)]},' for m in messages]
    lines += ["}", "", "#: ASN.1 name -> that of the sibling with room for more.", "LARGE: dict[str, str] = {"]
    lines += [f'    "{m.name}": "{m.large.name}",' for m in messages if m.large is not None]
    return "\n".join([*lines, "}"]) + "\n"


def _table_key(node: Node | Alias) -> tuple[str, str]:
    """What tells the nodes of the table apart: siblings share the class, an enumeration has only that."""
    return (node.name, "") if isinstance(node, Struct | Alias) else ("", getattr(node, "class_name", ""))
