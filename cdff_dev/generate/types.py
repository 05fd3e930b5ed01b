# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generation of the Python types and of their schema table from the ASN.1 modules.

``cdff_common/types/<family>.py`` is generated from ``cdff_common/asn1/<family>.asn``. Hand-written methods
are in ``cdff_common/types/<family>_ext.py``: a class ``<Type>Ext`` there is the base of the generated
``<Type>``. Bounds and sizes are only in ``cdff_common/types/schema_table.py``.
"""

from __future__ import annotations

import ast
import json
import re
import textwrap
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import cdff_common
from cdff_common.types.schema import (
    Alias,
    Choice,
    Enumeration,
    Field,
    Node,
    Struct,
    fields_of,
)
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.asn1_model import TypeModel, type_models
from cdff_dev.generate.python_source import formatted
from cdff_dev.generate.type_expressions import annotation, default, documented_type, member, sentence
from cdff_dev.tree import Tree

#: Base classes of messages by fields that the metadata must have; the first that fits.
_METADATA_BASES = {
    "CapturedMessage": {"frame_id", "start_time", "end_time"},
    "FramedMessage": {"frame_id"},
    "PoseMessage": {"parent_frame_id", "child_frame_id"},
}
#: Names of the fields that are the time of a message.
_STAMPS = ("timestamp", "time_stamp", "ref_time", "end_time")
_NODES = (
    "Alias, Array, Boolean, Choice, Enumeration, Field, Integer, ListOf, Message, OctetString, Real, Struct, "
    "Text"
)
#: Imports of the module of a family; the formatter removes unused ones.
_IMPORTS = (
    "from __future__ import annotations",
    "from dataclasses import dataclass, field",
    "from enum import IntEnum",
    "from typing import ClassVar",
    "import numpy as np",
    "from numpy.typing import NDArray",
    f"from cdff_common.types.message import ChoiceMessage, Message, {', '.join(_METADATA_BASES)}",
)
#: Folder of the installed package, and its path in the repository.
_SOURCE = Path(cdff_common.__file__).parent
_PACKAGE = Path("cdff_common")
_LICENCE = "# SPDX-FileCopyrightText: 2026 the CDFF contributors\n# SPDX-License-Identifier: BSD-3-Clause\n"


def _mark(source: str) -> str:
    return f"{_LICENCE}# GENERATED from {source} by cdff generate; do not edit.\n"


def modules(tree: Tree) -> list[Artefact]:
    """Return every file generated from the ASN.1 modules."""
    return [Artefact(tree.root / path, formatted(text, path)) for path, text in render().items()]


def render() -> dict[Path, str]:
    """Return the unformatted content of every file generated from the ASN.1 modules, by path."""
    models = type_models()
    families = sorted({m.module for m in models.values() if not m.is_large_variant})
    sources: dict[Path, str] = {}
    for family in families:
        sources[_PACKAGE / "types" / f"{family}.py"] = _family_source(family, models)
    sources[_PACKAGE / "types" / "__init__.py"] = _package_source(families, models)
    sources[_PACKAGE / "types" / "schema_table.py"] = _table_source(models)
    return sources


def _extensions(family: str) -> dict[str, set[str]]:
    """Return the names of the methods of each hand-written class ``…Ext`` of a family."""
    path = _SOURCE / "types" / f"{family}_ext.py"
    body = ast.parse(path.read_text(encoding="utf-8")).body if path.exists() else []
    return {
        c.name: {f.name for f in c.body if isinstance(f, ast.FunctionDef)}
        for c in body
        if isinstance(c, ast.ClassDef)
    }


@dataclass(frozen=True, slots=True)
class _Attribute:
    """Source of an attribute: name, annotation, default, and its type and comment in the docstring."""

    name: str
    annotation: str
    default: str
    documented_type: str
    comment: str = ""


def _attributes(model: TypeModel) -> list[_Attribute]:
    """Return the attributes of the class of a type."""
    node = model.class_node
    if isinstance(node, Choice):
        kinds = ", ".join(f"``{f.attribute}``" for f in node.alternatives)
        union = " | ".join(annotation(f.node) for f in node.alternatives)
        default_field = node.alternatives[0]
        return [
            _Attribute(
                "kind", "str", f'"{default_field.attribute}"', "str", f"Name of the alternative: {kinds}"
            ),
            _Attribute("value", union, default(default_field.node, default_field.name, "", 0), union),
        ]
    return [
        _Attribute(
            f.attribute,
            annotation(f.node),
            default(f.node, f.name, model.field_types.get(f.name, model.name), model.version),
            documented_type(f.node),
            model.field_comments.get(f.name, ""),
        )
        for f in fields_of(node)
    ]


def _class_source(model: TypeModel, extensions: dict[str, set[str]]) -> list[str]:
    """Return the lines of the class of a type."""
    node = model.class_node
    if isinstance(node, Enumeration):
        summary = sentence(model.comment or f"``{model.name}``")
        lines = [f"class {node.class_name}(IntEnum):", f'    """{summary}"""', ""]
        return lines + [f"    {member(name)} = {value}" for name, value in node.members]
    extension = f"{node.class_name}Ext"
    metadata_base = _metadata_base(fields_of(node))
    bases = [extension] if extension in extensions else []
    bases += [metadata_base] if metadata_base else []
    if not bases:
        bases = ["ChoiceMessage" if isinstance(node, Choice) else "Message"]
    attributes = _attributes(model)
    summary = model.comment or f"Type ``{model.name}`` of the ASN.1 modules."
    text = textwrap.wrap(f'"""{sentence(summary)}', 102)
    lines = [
        "@dataclass(frozen=True, slots=True, eq=False, repr=False)",
        f"class {node.class_name}({', '.join(bases)}):",
    ]
    lines += [*(f"    {line}" for line in text), "", "    Attributes", "    ----------"]
    for attribute in attributes:
        lines.append(f"    {attribute.name} : {attribute.documented_type}")
        lines += [f"        {sentence(attribute.comment)}"] if attribute.comment else []
    lines += ['    """', "", f'    ASN1_NAME: ClassVar[str] = "{model.name}"']
    lines += [f"    {a.name}: {a.annotation} = {a.default}" for a in attributes]
    stamp = "" if metadata_base == "CapturedMessage" else _stamp(fields_of(node))
    if stamp and "stamp_ns" not in extensions.get(extension, ()):
        lines += ["", "    @property", "    def stamp_ns(self) -> int:", '        """Time, nanoseconds."""']
        lines.append(f"        return self.{stamp}.ns")
    return lines


def _metadata_base(fields: tuple[Field, ...]) -> str:
    """Return the base class of a message with the properties of its metadata; empty if none fits."""
    metadata = fields[0]
    if metadata.attribute != "metadata" or not isinstance(metadata.node, Struct):
        return ""
    names = {f.attribute for f in metadata.node.fields}
    return next((base for base, required in _METADATA_BASES.items() if required <= names), "")


def _stamp(fields: tuple[Field, ...]) -> str:
    """Return the attribute path of the time of a message, which may be in its metadata; empty if none."""
    for field in fields:
        if field.attribute in _STAMPS and annotation(field.node) == "Time":
            return field.attribute
        if (
            field.attribute == "metadata"
            and isinstance(field.node, Struct)
            and (inner := _stamp(field.node.fields))
        ):
            return f"metadata.{inner}"
    return ""


def _family_source(family: str, models: dict[str, TypeModel]) -> str:
    """Return the source of a family; ``formatted`` removes the imports that it does not need."""
    classes = [m for m in models.values() if not m.is_large_variant]
    extensions = _extensions(family)
    bodies = ["\n".join(_class_source(m, extensions)) for m in classes if m.module == family]
    module_of = {m.class_name: m.module for m in classes if m.module != family}
    module_of |= dict.fromkeys(extensions, f"{family}_ext")
    words = sorted(set(re.findall(r"\w+", " ".join(bodies))))
    imports = [
        f"from cdff_common.types.{module_of[word]} import {word}" for word in words if word in module_of
    ]
    head = [_mark(f"cdff_common/asn1/{family}.asn"), f'"""Types of ``asn1/{family}.asn``."""', "", *_IMPORTS]
    return "\n\n\n".join(["\n".join(head + imports), *bodies]) + "\n"


def _package_source(families: list[str], models: dict[str, TypeModel]) -> str:
    """Return the source of the package that exports all message types."""
    classes = [m for m in models.values() if not m.is_large_variant]
    names = {f: sorted(m.class_name for m in classes if m.module == f) for f in families}
    lines = [
        _mark("cdff_common/asn1/*.asn"),
        '"""All message types: frozen dataclasses over numpy, one per ASN.1 type."""',
        "",
        "from __future__ import annotations",
        "",
    ]
    lines += [f"from cdff_common.types.{f} import {', '.join(names[f])}" for f in families]
    lines += ["from cdff_common.types.message import Box, Message"]
    lines += ["", "__all__ = ["]
    public_names = sorted([n for f in families for n in names[f]] + ["Box", "Message"])
    return "\n".join([*lines, *(f'    "{n}",' for n in public_names), "]"]) + "\n"


def _table_source(models: dict[str, TypeModel]) -> str:
    """Return the source of the schema table: a variable for each type, after those to which it refers."""
    variable = {_table_key(m.node): f"_{i}" for i, m in enumerate(models.values())}

    def source(value: Any) -> str:
        """Return the source of a node or of a part of it; a named type is replaced by its variable."""
        if isinstance(value, Struct | Enumeration | Choice | Alias):
            return variable[_table_key(value)]
        return constructor(value) if is_dataclass(value) else parts(value)

    def parts(value: Any) -> str:
        if not isinstance(value, tuple):
            return json.dumps(value)
        # With a trailing comma the formatter puts each field on its own line; one element needs the comma.
        comma = "," if len(value) == 1 or (value and isinstance(value[0], Field)) else ""
        return f"({', '.join(map(source, value))}{comma})"

    def constructor(node: Any) -> str:
        return f"{type(node).__name__}({', '.join(source(getattr(node, f.name)) for f in fields(node))})"

    lines = [
        _mark("cdff_common/asn1/*.asn"),
        '"""Schema of all types: fields, sizes and bounds, for validation and the codecs."""',
        "",
        "from __future__ import annotations",
        "",
        f"from cdff_common.types.schema import {_NODES}",
        "",
    ]
    lines += [f"{variable[_table_key(m.node)]} = {constructor(m.node)}" for m in models.values()]
    messages = [m for m in models.values() if isinstance(m.node, Struct | Alias)]
    choices = [m for m in models.values() if isinstance(m.node, Choice)]
    large = {m.name: f'"{m.large.name}"' for m in messages if m.large is not None}
    for comment, declaration, entries in (
        (
            "ASN.1 name -> node of every type that can be a message.",
            "MESSAGES: dict[str, Message]",
            {m.name: source(m.node) for m in messages},
        ),
        (
            "Name -> node of every CHOICE.",
            "CHOICES: dict[str, Choice]",
            {m.name: source(m.node) for m in choices},
        ),
        ("ASN.1 name -> name of its size variant with larger bounds.", "LARGE: dict[str, str]", large),
    ):
        lines += ["", f"#: {comment}", f"{declaration} = {{"]
        lines += [*(f'    "{name}": {value},' for name, value in entries.items()), "}"]
    return "\n".join(lines) + "\n"


def _table_key(node: Node | Alias) -> tuple[str, str]:
    """Return the key of a node: the ASN.1 name; for enumerations and choices, the class name."""
    return (node.name, "") if isinstance(node, Struct | Alias) else ("", getattr(node, "class_name", ""))
