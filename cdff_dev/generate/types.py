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
    Boolean,
    Choice,
    Enumeration,
    Field,
    Integer,
    ListOf,
    Node,
    Octets,
    Real,
    Struct,
    Text,
)
from cdff_dev.generate.asn1_model import ModelReader, TypeModel

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
    families = sorted({m.module for m in models.values()})
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


def _int_dtype(node: Integer) -> str:
    for bits in (8, 16, 32, 64):
        if node.low >= 0 and node.high < 1 << bits:
            return f"uint{bits}"
        if -(1 << (bits - 1)) <= node.low and node.high < 1 << (bits - 1):
            return f"int{bits}"
    raise ValueError(f"INTEGER {node.low}..{node.high} does not fit 64 bits")


def _dtype(node: Array | Octets) -> str:
    if isinstance(node, Octets):
        kinds = {"u": "uint", "i": "int", "f": "float"}
        return f"{kinds[node.dtype[1]]}{8 * int(node.dtype[2:])}"
    if isinstance(node.element, Integer):
        return _int_dtype(node.element)
    return "float64" if isinstance(node.element, Real) else "bool_"


def _annotation(node: Node) -> str:
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
            return f"NDArray[np.{_dtype(node)}]"
        case ListOf():
            return f"tuple[{_annotation(node.element)}, ...]"
        case Struct() | Enumeration() | Choice():
            return node.class_name


def _check(node: Node, value: str, where: str) -> str:
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
            return f'check.integer_array({value}, {where}, {bounds}, "{_dtype(node)}")'
        case Array():
            kind = "real" if isinstance(node.element, Real) else "boolean"
            return f"check.{kind}_array({value}, {where}, {node.dims})"
        case ListOf():
            inner = _check(node.element, "v", "w")
            return f"check.items({value}, {where}, {node.low}, {node.high}, lambda v, w: {inner})"
        case Enumeration():
            return f"check.enumeration({value}, {where}, {node.class_name})"
        case Struct() | Choice():
            return f"check.instance({value}, {where}, {node.class_name})"


def _default(node: Node, name: str, type_name: str, version: int) -> str:
    """Source of a field's default: neutral, identity for rotations, NaN for what is unknown until it is said."""
    value = _neutral(node)
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


def _neutral(node: Node) -> str:
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
            return f"{node.class_name}.{_member(node.members[0][0])}"
        case Struct() | Choice():
            return f"{node.class_name}()"
        case Octets():
            return f"np.zeros({(0, node.columns) if node.columns else 0}, np.{_dtype(node)})"
        case Array():
            return f"np.zeros({tuple(low for low, _ in node.dims)}, np.{_dtype(node)})"
        case ListOf(low=0):
            return "()"
        case ListOf():
            return f"({_neutral(node.element)},) * {node.low}"


def _member(name: str) -> str:
    return name.replace("-", "_").upper()


def _doc_type(node: Node) -> str:
    """Type of a field as a docstring says it, with shape or range."""
    match node:
        case Array():
            shape = ", ".join(str(a) if a == b else f"{a}..{b}" for a, b in node.dims)
            return f"{_annotation(node)}, shape ({shape}{',' if len(node.dims) == 1 else ''})"
        case Octets():
            return f"{_annotation(node)}, shape (n,{f' {node.columns}' if node.columns else ''})"
        case Integer():
            return f"int, {node.low}..{node.high}"
        case Text():
            return f"str, at most {node.high} octets"
        case _:
            return _annotation(node)


def _docstring(model: TypeModel, fields: tuple[Field, ...]) -> list[str]:
    article = "an" if model.name[0] in "AEIOU" else "a"
    summary = model.comment or f"What {article} ``{model.name}`` of the ASN.1 modules holds."
    text = textwrap.wrap(f'"""{_sentence(summary)}', 114)
    lines = [*(f"    {line}" for line in text), "", "    Attributes", "    ----------"]
    for f in fields:
        lines.append(f"    {f.attribute} : {_doc_type(f.node)}")
        if f.name in model.field_comments:
            lines.append(f"        {_sentence(model.field_comments[f.name])}")
    return [*lines, '    """']


def _sentence(text: str) -> str:
    return text if text.endswith((".", "?", "!")) else f"{text}."


def _class_source(model: TypeModel, extensions: set[str]) -> list[str]:
    node = model.node
    if isinstance(node, Enumeration):
        summary = _sentence(model.comment or f"``{model.name}``")
        lines = [f"class {node.class_name}(IntEnum):", f'    """{summary}"""', ""]
        return lines + [f"    {_member(name)} = {value}" for name, value in node.members]
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
        default = _default(f.node, f.name, model.field_types[f.name], model.version)
        lines.append(f"    {f.attribute}: {_annotation(f.node)} = {default}")
    lines += ["", "    def __post_init__(self) -> None:", "        put = object.__setattr__"]
    for f in fields:
        where = f'"{node.class_name}.{f.attribute}"'
        lines.append(f'        put(self, "{f.attribute}", {_check(f.node, f"self.{f.attribute}", where)})')
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
        if f.attribute in _STAMPS and _annotation(f.node) == "Time":
            return f.attribute
        if f.attribute == "metadata" and isinstance(f.node, Struct) and (inner := _stamp(f.node.fields)):
            return f"metadata.{inner}"
    return ""


def _choice_source(model: TypeModel, node: Choice) -> list[str]:
    kinds = ", ".join(f'"{f.attribute}"' for f in node.alternatives)
    union = " | ".join(_annotation(f.node) for f in node.alternatives)
    first = node.alternatives[0]
    lines = [
        "@dataclass(frozen=True, slots=True, eq=False, repr=False)",
        f"class {node.class_name}(Message):",
        f'    """{_sentence(model.comment)}',
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
        f"    value: {union} = {_default(first.node, first.name, '', 0)}",
        "",
        "    def __post_init__(self) -> None:",
        "        put = object.__setattr__",
    ]
    for i, f in enumerate(node.alternatives):
        where = f'"{node.class_name}.{f.attribute}"'
        lines += [
            f'        {"if" if i == 0 else "elif"} self.kind == "{f.attribute}":',
            f'            put(self, "value", {_check(f.node, "self.value", where)})',
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
    own = [m for m in models.values() if m.module == family]
    home = {m.class_name: m.module for m in models.values()}
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
    names = {f: sorted(m.class_name for m in models.values() if m.module == f) for f in families}
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
    variable = {m.class_name: f"_{i}" for i, m in enumerate(models.values())}

    def source(node: Node, top: bool = False) -> str:
        if not top and isinstance(node, Struct | Enumeration | Choice):
            return variable[node.class_name]
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
        lines.append(f"{variable[model.class_name]} = {text}")
    lines += ["", "#: ASN.1 name -> node, of every type that can be a message.", "MESSAGES: dict[str, Message] = {"]
    lines += [f'    "{m.name}": {variable[m.class_name]},' for m in messages]
    return "\n".join([*lines, "}"]) + "\n"
