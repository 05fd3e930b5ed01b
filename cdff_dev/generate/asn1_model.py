# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From the ASN.1 modules to what the type generator works on: nodes with their Python names, in order of need."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import asn1tools

from cdff_common.codecs.schema import (
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
    Octets,
    Real,
    Struct,
    Text,
)

_TYPED_ARRAY = re.compile(r"(UInt|Int|Float)(\d+)(?:x(\d+))?-Array\Z")
_TYPE_LINE = re.compile(r"([A-Z][\w-]*)\s*::=")
_COMMENT = re.compile(r"--\s*(.*\S)\s*\Z")
_FIELD_LINE = re.compile(r"\s+([a-z][\w-]*)\s+\S")
#: ``PointcloudLarge`` has the fields of ``Pointcloud`` with room for more, and its Python class.
_SIBLING = "Large"


def class_name(asn1_name: str) -> str:
    """``Frame-metadata-t`` -> ``FrameMetadataT``; ``UNIT-AXIS`` -> ``UnitAxis``."""
    parts = asn1_name.split("-")
    if len(parts) > 1:
        parts = [p.capitalize() if p.isupper() and len(p) > 1 else p[:1].upper() + p[1:] for p in parts]
    return "".join(parts)


def snake_case(asn1_name: str) -> str:
    """``pose-robotFrame-sensorFrame`` -> ``pose_robot_frame_sensor_frame``; ``usecPerSec`` -> ``usec_per_sec``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", asn1_name.replace("-", "_")).lower()


@dataclass(slots=True)
class TypeModel:
    """A type that gets a class: its node, the file it stands in, and the comments there."""

    name: str
    class_name: str
    module: str
    node: Message | Enumeration | Choice
    comment: str
    field_comments: dict[str, str]
    #: Names of the ASN.1 types of the fields, for defaults (``Quaterniond``, ``Covariance``).
    field_types: dict[str, str] = field(default_factory=dict)
    #: ``msgVersion`` of this family, 0 where it declares none.
    version: int = 0
    #: The sibling with room for more, whose bounds the class has.
    large: TypeModel | None = None
    #: Whether this is such a sibling, which has no class of its own.
    is_sibling: bool = False

    @property
    def class_node(self) -> Message | Enumeration | Choice:
        """Node that the class is made from: that of the sibling where there is one."""
        return self.node if self.large is None else self.large.node


class ModelReader:
    """Reads all modules; ``types`` holds a model per class, each after what it refers to."""

    def __init__(self, files: list[Path]) -> None:
        self._types: dict[str, tuple[dict[str, Any], str, str]] = {}
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
                    if name in self._types:
                        raise ValueError(f"{path.name}: type {name} is declared twice")
                    self._types[name] = (declaration, path.stem, module)
        for name in self._types:
            self._model(name)
        for name in self._types:
            if base := self._base(name):
                self._pair(self.types[base], self.types[name])

    def _base(self, name: str) -> str:
        """Name of the type that ``name`` is the large sibling of; empty where it is none."""
        base = name.removesuffix(_SIBLING)
        return base if base != name and base in self._types else ""

    @staticmethod
    def _pair(base: TypeModel, large: TypeModel) -> None:
        """Join siblings; raises ValueError where they differ in more than size."""
        names = [[f.name for f in m.node.fields] if isinstance(m.node, Struct) else [] for m in (base, large)]
        if type(base.node) is not type(large.node) or names[0] != names[1]:
            raise ValueError(f"{large.name}: expected the fields of {base.name}")
        base.large, large.is_sibling = large, True

    def _read_comments(self, text: str) -> None:
        """Take the comment block above each type and the comment after each field."""
        above: list[str] = []
        current: dict[str, str] = {}
        for line in text.splitlines():
            found = _TYPE_LINE.match(line)
            comment = _COMMENT.search(line)
            if found:
                current = {}
                self._comments[found[1]] = (" ".join(above), current)
            elif comment and (member := _FIELD_LINE.match(line)):
                current[member[1]] = comment[1]
            above = [*above, comment[1]] if comment and line.startswith("--") else []

    def _bounds(self, declaration: dict[str, Any]) -> tuple[int, int]:
        (size,) = declaration["size"]
        low, high = size if isinstance(size, tuple | list) else (size, size)
        return self._number(low), self._number(high)

    def _number(self, value: int | str) -> int:
        return self._values[value] if isinstance(value, str) else value

    def _model(self, name: str) -> TypeModel | None:
        """Model of a named type, made once; None for numbers, text and octets, which get no class."""
        if name in self.types:
            return self.types[name]
        declaration, module, asn1_module = self._types[name]
        kind = declaration["type"]
        comment, comments = self._comments.get(name, ("", {}))
        model = TypeModel(name, class_name(self._base(name) or name), module, Enumeration("", ()), comment, comments)
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
        """Node of a declaration; a reference to a list or number is resolved to its content."""
        kind = declaration["type"]
        if kind in self._types:
            return self._reference(kind)
        if kind == "REAL":
            return Real()
        if kind == "BOOLEAN":
            return Boolean()
        if kind == "INTEGER":
            ((low, high),) = declaration["restricted-to"]
            return Integer(low, high)
        if kind == "OCTET STRING":
            return Octets(self._bounds(declaration)[1])
        if kind == "SEQUENCE OF":
            return self._list(declaration, owner)
        if kind == "CHOICE":
            return self._choice(declaration, owner)
        raise ValueError(f"{owner}: {kind} is not supported by the generator")

    def _reference(self, name: str) -> Node:
        if name == "T-String":
            return Text(self._bounds(self._types[name][0])[1])
        typed = _TYPED_ARRAY.match(name)
        if typed:
            code = {"UInt": "u", "Int": "i", "Float": "f"}[typed[1]]
            return Octets(self._bounds(self._types[name][0])[1], f"<{code}{int(typed[2]) // 8}", int(typed[3] or 0))
        declaration = self._types[name][0]
        if declaration["type"] in ("SEQUENCE", "ENUMERATED"):
            model = self._model(name)
            if model is None or isinstance(model.node, Alias):
                raise ValueError(f"{name}: no class was made")
            return model.node
        return self._node(declaration, name)

    def _list(self, declaration: dict[str, Any], owner: str) -> Array | ListOf:
        element = self._node(declaration["element"], owner)
        low, high = self._bounds(declaration)
        named = declaration["element"]["type"] in self._types
        tag = declaration["element"]["type"].replace(" ", "_")
        if isinstance(element, Real | Integer | Boolean):
            return Array(element, ((low, high),), (tag,))
        if isinstance(element, Array) and (not named or all(a == b for a, b in element.dims)):
            return Array(element.element, ((low, high), *element.dims), (tag, *element.tags))
        return ListOf(element, low, high, tag)

    def _choice(self, declaration: dict[str, Any], owner: str) -> Choice:
        name = f"{owner}-{declaration['name']}"
        node = Choice(
            class_name(name),
            tuple(Field(m["name"], snake_case(m["name"]), self._node(m, owner)) for m in declaration["members"]),
        )
        comment = f"The {declaration['name']} of a {class_name(owner)}: one of several kinds."
        self.types[name] = TypeModel(name, node.class_name, self._types[owner][1], node, comment, {})
        return node
