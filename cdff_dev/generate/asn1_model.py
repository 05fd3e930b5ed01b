# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Model of the ASN.1 modules for the generator of types: nodes with Python names, in order of dependency."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import asn1tools

from cdff_common.asn1 import asn1_files
from cdff_common.types.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Field,
    Integer,
    ListOf,
    Message,
    Node,
    OctetString,
    Real,
    Struct,
    Text,
    fields_of,
)

_TYPED_ARRAY = re.compile(r"(UInt|Int|Float)(\d+)(?:x(\d+))?-Array\Z")
_TYPE_LINE = re.compile(r"([A-Z][\w-]*)\s*::=")
_COMMENT = re.compile(r"--\s*(.*\S)\s*\Z")
_FIELD_LINE = re.compile(r"\s+([a-z][\w-]*)\s+\S")
#: ``PointcloudLarge`` has the fields of ``Pointcloud`` with larger bounds, and the same Python class.
_LARGE_SUFFIX = "Large"


def class_name(asn1_name: str) -> str:
    """Return the class name: ``Frame-metadata-t`` -> ``FrameMetadataT``; ``UNIT-AXIS`` -> ``UnitAxis``."""
    parts = asn1_name.split("-")
    if len(parts) > 1:
        parts = [p.capitalize() if p.isupper() and len(p) > 1 else p[:1].upper() + p[1:] for p in parts]
    return "".join(parts)


def snake_case(asn1_name: str) -> str:
    """Return the attribute name: ``pose-robotFrame-sensorFrame`` -> ``pose_robot_frame_sensor_frame``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", asn1_name.replace("-", "_")).lower()


@dataclass(slots=True)
class TypeModel:
    """An ASN.1 type that has a Python class: its schema node, its file, and the comments of the file."""

    name: str
    class_name: str
    module: str
    node: Message | Enumeration | Choice
    comment: str
    field_comments: dict[str, str]
    #: Names of the ASN.1 types of the fields, for defaults (``Quaterniond``, ``Covariance``).
    field_types: dict[str, str] = field(default_factory=dict)
    #: Value of ``msgVersion`` of the module; 0 if the module declares none.
    version: int = 0
    #: Size variant with larger bounds; the class has the larger bounds.
    large: TypeModel | None = None
    #: True for a size variant with larger bounds, which has no class of its own.
    is_large_variant: bool = False

    @property
    def class_node(self) -> Message | Enumeration | Choice:
        """Node of the class: the node of the large variant if there is one."""
        return self.node if self.large is None else self.large.node


@cache
def type_models() -> dict[str, TypeModel]:
    """Return the models of all types of ``cdff_common/asn1`` by name, each after those to which it refers."""
    return model_reader().types


@cache
def model_reader() -> ModelReader:
    """Return the reader of the files of ``cdff_common/asn1``."""
    return ModelReader(asn1_files())


class ModelReader:
    """Reader of ASN.1 files.

    Attributes
    ----------
    types : dict
        Models by name, each after those to which it refers.
    declarations : dict
        Declaration of each type as asn1tools parses it, stem of its file, and its ASN.1 module.
    """

    def __init__(self, files: list[Path]) -> None:
        self.declarations: dict[str, tuple[dict[str, Any], str, str]] = {}
        self._values: dict[str, int] = {}
        self._versions: dict[str, int] = {}
        self._comments: dict[str, tuple[str, dict[str, str]]] = {}
        self.types: dict[str, TypeModel] = {}
        for path in files:
            text = path.read_text(encoding="utf-8")
            self._read_comments(text)
            for module, content in asn1tools.parse_string(text).items():
                for name, value in content["values"].items():
                    self._values[name] = value["value"]
                    if name.lower().endswith("-version"):
                        self._versions[module] = value["value"]
                for name, declaration in content["types"].items():
                    if name in self.declarations:
                        raise ValueError(f"{path.name}: type {name} is declared twice")
                    self.declarations[name] = (declaration, path.stem, module)
        for name in self.declarations:
            self._model(name)
        for name in self.declarations:
            if base := self._base(name):
                self._link_variants(self.types[base], self.types[name])

    def node(self, name: str) -> Node:
        """Return the node of a named type, also of one without a class."""
        return self._reference(name)

    def _base(self, name: str) -> str:
        """Return the name of the type of which ``name`` is the large variant, or an empty string."""
        base = name.removesuffix(_LARGE_SUFFIX)
        return base if base != name and base in self.declarations else ""

    @staticmethod
    def _link_variants(base: TypeModel, large: TypeModel) -> None:
        """Link a type and its large variant; raises ValueError if their fields differ."""
        names = [[f.name for f in fields_of(m.node)] for m in (base, large)]
        if type(base.node) is not type(large.node) or names[0] != names[1]:
            raise ValueError(f"{large.name}: expected the fields of {base.name}")
        base.large, large.is_large_variant = large, True

    def _read_comments(self, text: str) -> None:
        """Read the comment block above each type and the comment after each field."""
        above: list[str] = []
        current: dict[str, str] = {}
        for line in text.splitlines():
            declaration = _TYPE_LINE.match(line)
            comment = _COMMENT.search(line)
            if declaration:
                current = {}
                self._comments[declaration[1]] = (" ".join(above), current)
            elif comment and (member := _FIELD_LINE.match(line)):
                current[member[1]] = comment[1]
            above = [*above, comment[1]] if comment and line.startswith("--") else []

    def _bounds(self, declaration: dict[str, Any]) -> tuple[int, int]:
        """Return the least and the largest size of a declaration."""
        (size,) = declaration["size"]
        low, high = size if isinstance(size, tuple | list) else (size, size)
        return self._number(low), self._number(high)

    def _number(self, value: int | str) -> int:
        return self._values[value] if isinstance(value, str) else value

    def _model(self, name: str) -> TypeModel | None:
        """Return the model of a named type; None for numbers, text and bytes, which have no class."""
        if name in self.types:
            return self.types[name]
        declaration, module, asn1_module = self.declarations[name]
        kind = declaration["type"]
        comment, comments = self._comments.get(name, ("", {}))
        model = TypeModel(
            name, class_name(self._base(name) or name), module, Enumeration("", ()), comment, comments
        )
        model.version = self._versions.get(asn1_module, 0)
        if kind == "SEQUENCE":
            fields = []
            for member in declaration["members"]:
                model.field_types[member["name"]] = member["type"]
                fields.append(Field(member["name"], snake_case(member["name"]), self._node(member, name)))
            model.node = Struct(name, model.class_name, tuple(fields))
        elif kind == "ENUMERATED":
            model.node = self._enumeration(declaration, name)
        else:
            node = self._node({"type": name}, name)
            if not isinstance(node, Array | ListOf):
                return None
            model.node = Alias(name, model.class_name, "values" if isinstance(node, Array) else "items", node)
        self.types[name] = model
        return model

    def _enumeration(self, declaration: dict[str, Any], name: str) -> Enumeration:
        members = sorted(((n, v) for n, v in declaration["values"]), key=lambda member: member[1])
        return Enumeration(class_name(name), tuple(members))

    def _node(self, declaration: dict[str, Any], owner: str) -> Node:
        """Return the node of a declaration; references to other types are resolved."""
        kind = declaration["type"]
        if kind in self.declarations:
            return self._reference(kind)
        if kind == "REAL":
            return Real()
        if kind == "BOOLEAN":
            return Boolean()
        if kind == "INTEGER":
            ((low, high),) = declaration["restricted-to"]
            return Integer(low, high)
        if kind == "OCTET STRING":
            return OctetString(self._bounds(declaration)[1])
        if kind == "SEQUENCE OF":
            return self._list(declaration, owner)
        if kind == "CHOICE":
            return self._choice(declaration, owner)
        raise ValueError(f"{owner}: {kind} is not supported by the generator")

    def _reference(self, name: str) -> Node:
        """Return the node of a named type; structures and enumerations become types of their own."""
        if name == "T-String":
            return Text(self._bounds(self.declarations[name][0])[1])
        typed = _TYPED_ARRAY.match(name)
        if typed:
            code = {"UInt": "u", "Int": "i", "Float": "f"}[typed[1]]
            return OctetString(
                self._bounds(self.declarations[name][0])[1],
                f"<{code}{int(typed[2]) // 8}",
                int(typed[3] or 0),
            )
        declaration = self.declarations[name][0]
        if declaration["type"] in ("SEQUENCE", "ENUMERATED"):
            model = self._model(name)
            if model is None or isinstance(model.node, Alias):
                raise ValueError(f"{name}: the type has no class")
            return model.node
        return self._node(declaration, name)

    def _list(self, declaration: dict[str, Any], owner: str) -> Array | ListOf:
        """Return the node of a SEQUENCE OF: an array if its elements are numbers, otherwise a list."""
        element = self._node(declaration["element"], owner)
        low, high = self._bounds(declaration)
        named = declaration["element"]["type"] in self.declarations
        tag = declaration["element"]["type"].replace(" ", "_")
        if isinstance(element, Real | Integer | Boolean):
            return Array(element, ((low, high),), (tag,))
        if isinstance(element, Array) and (not named or all(a == b for a, b in element.dims)):
            return Array(element.element, ((low, high), *element.dims), (tag, *element.tags))
        return ListOf(element, low, high, tag)

    def _choice(self, declaration: dict[str, Any], owner: str) -> Choice:
        """Return the node of a CHOICE within a structure, and add it as a type."""
        name = f"{owner}-{declaration['name']}"
        node = Choice(
            class_name(name),
            tuple(
                Field(m["name"], snake_case(m["name"]), self._node(m, owner)) for m in declaration["members"]
            ),
        )
        comment = f"Value of ``{declaration['name']}`` of a ``{class_name(owner)}``: one of several kinds."
        self.types[name] = TypeModel(name, node.class_name, self.declarations[owner][1], node, comment, {})
        return node
