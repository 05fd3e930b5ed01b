# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VRML 2.0 (VRML97, ISO/IEC 14772-1) and VRML 1.0: indexed face sets with the transforms around them.

Other geometry (Box, Cylinder, Extrusion, …), prototypes and inlined files are refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.formats.file_source import Source
from cdff_common.formats.meshes.arrays import MeshArrays, fan
from cdff_common.geometry import se3

_TOKEN = re.compile(r'#[^\n]*|"(?:\\.|[^"\\])*"|[{}\[\]]|[^\s,{}\[\]#"]+')
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\Z|0[xX][0-9a-fA-F]+\Z")
_GROUPS = {"Group", "Transform", "Separator", "Anchor", "Collision", "Billboard", "Switch", "LOD", "Shape"}
_REFUSED = {"Box", "Cube", "Sphere", "Cone", "Cylinder", "Extrusion", "ElevationGrid", "PROTO", "Inline"}
#: Largest depth of nested nodes, below the recursion limit of Python.
_MAX_DEPTH = 200


@dataclass(slots=True)
class _Node:
    """Node with its fields: numbers, words, a node, or a list of nodes; ``children`` keeps the order."""

    kind: str
    fields: dict[str, Any] = field(default_factory=dict)
    children: list[_Node] = field(default_factory=list)


def read_vrml(s: Source) -> MeshArrays:
    """Read a VRML file in its unit.

    Raises
    ------
    CodecError
        If it is malformed, has geometry other than face sets, or no face.
    """
    text = s.data.decode("utf-8", "replace")
    tokens = [t for t in _TOKEN.findall(text) if not t.startswith("#")]
    parser = _Parser(s, tokens)
    nodes = []
    while not parser.is_at_end():
        node = parser.statement(0)
        if node is not None:
            nodes.append(node)
    faces = _Faces(s)
    for node in nodes:
        faces.add(node, np.eye(4))
    if not faces.triangles:
        raise s.error("VRML without IndexedFaceSet, expected faces")
    return MeshArrays.checked(np.concatenate(faces.vertices), np.concatenate(faces.triangles), s.name)


class _Parser:
    """Recursive descent parser of statements and nodes."""

    def __init__(self, s: Source, tokens: list[str]) -> None:
        self._s, self._tokens, self._at = s, tokens, 0
        self._named: dict[str, _Node] = {}

    def is_at_end(self) -> bool:
        """Return whether all tokens were read."""
        return self._at >= len(self._tokens)

    def statement(self, depth: int) -> _Node | None:
        """Return the node of a statement; None for a ROUTE."""
        word = self._next()
        if word == "ROUTE":
            self._at += 3
            return None
        if word == "DEF":
            name = self._next()
            node = self._node(self._next(), depth)
            self._named[name] = node
            return node
        if word == "USE":
            name = self._next()
            if name not in self._named:
                raise self._s.error(f"USE {name} without DEF")
            return self._named[name]
        return self._node(word, depth)

    def _node(self, kind: str, depth: int) -> _Node:
        """Return a node with its fields and children; raises CodecError for geometry other than faces."""
        if depth > _MAX_DEPTH:
            raise self._s.error(f"nodes deeper than {_MAX_DEPTH}")
        if kind in _REFUSED:
            raise self._s.error(f"the geometry {kind}, expected IndexedFaceSet only: convert it to faces")
        if self._next() != "{":
            raise self._s.error(f"the word {kind!r} is not followed by {{")
        node = _Node(kind)
        while (word := self._next()) != "}":
            is_node = word in ("DEF", "USE") or self._peek() == "{"
            if is_node:
                self._at -= 1
                child = self.statement(depth + 1)
                if child is not None:
                    node.children.append(child)
            elif word != "ROUTE":
                node.fields[word] = self._value(node, depth)
            else:
                self._at += 3
        return node

    def _value(self, owner: _Node, depth: int) -> Any:
        """Return the value of a field: an array of numbers, a word, a node or a list of nodes."""
        token = self._peek()
        if token == "[":
            self._at += 1
            end = self._at
            if self._peek() is not None and _NUMBER.match(self._peek() or ""):
                while end < len(self._tokens) and self._tokens[end] != "]":
                    end += 1
                numbers = _numbers(self._s, self._tokens[self._at : end])
                self._at = end + 1
                return numbers
            values = []
            while self._peek() != "]":
                if (self._peek() or "").startswith('"'):
                    self._at += 1
                    continue
                node = self.statement(depth + 1)
                if node is not None:
                    values.append(node)
            self._at += 1
            owner.children += values
            return values
        if token is not None and _NUMBER.match(token):
            start = self._at
            while (word := self._peek()) is not None and _NUMBER.match(word):
                self._at += 1
            return _numbers(self._s, self._tokens[start : self._at])
        if token is not None and (token in ("DEF", "USE") or self._peek(1) == "{"):
            node = self.statement(depth + 1)
            if node is not None:
                owner.children.append(node)
            return node
        return self._next()

    def _next(self) -> str:
        if self.is_at_end():
            raise self._s.error("ends within a node")
        self._at += 1
        return self._tokens[self._at - 1]

    def _peek(self, ahead: int = 0) -> str | None:
        at = self._at + ahead
        return self._tokens[at] if at < len(self._tokens) else None


class _Faces:
    """Collector of the triangles of the face sets below the nodes."""

    def __init__(self, s: Source) -> None:
        self._s = s
        self.vertices: list[FloatArray] = []
        self.triangles: list[IntArray] = []
        self._count = 0

    def add(self, node: _Node, matrix: FloatArray) -> None:
        """Add the face sets of a node; ``matrix`` (4, 4) maps its coordinates into the file's."""
        if node.kind in _GROUPS:
            # In VRML 1.0, Transform, Coordinate3 and the like affect the following siblings.
            inner, points = matrix @ _local(node) if node.kind == "Transform" else matrix, None
            for child in node.children:
                if child.kind in ("Transform", "MatrixTransform", "Translation", "Rotation", "Scale"):
                    if child.children or (child.kind == "Transform" and "children" in child.fields):
                        self.add(child, inner)
                    else:
                        inner = inner @ _local(child)
                elif child.kind == "Coordinate3":
                    points = child.fields.get("point")
                elif child.kind == "IndexedFaceSet":
                    self._add_faces(child, inner, points)
                else:
                    self.add(child, inner)

    def _add_faces(self, node: _Node, matrix: FloatArray, points: Any) -> None:
        """Add the faces of an IndexedFaceSet, transformed by ``matrix`` (4, 4)."""
        for child in node.children:
            if child.kind == "Coordinate":
                points = child.fields.get("point")
        indices = node.fields.get("coordIndex")
        if points is None or indices is None or not len(indices):
            return
        vertices = np.asarray(points, np.float64).reshape(-1, 3)
        polygons = [p.tolist() for p in np.split(indices, np.flatnonzero(indices < 0))]
        polygons = [[int(i) for i in p if i >= 0] for p in polygons]
        self.vertices.append(vertices @ matrix[:3, :3].T + matrix[:3, 3])
        self.triangles.append(fan(polygons) + self._count)
        self._count += len(vertices)


def _local(node: _Node) -> FloatArray:
    """Return the transform (4, 4) of a node in its parent: T C R S C^-1, scaleOrientation is refused."""
    if "matrix" in node.fields:
        return np.asarray(node.fields["matrix"], np.float64).reshape(4, 4).T

    def vector(name: str, default: list[float]) -> FloatArray:
        return np.asarray(node.fields.get(name, default), np.float64)

    axis_angle = vector("rotation", [0.0, 0.0, 1.0, 0.0])
    length = float(np.linalg.norm(axis_angle[:3]))
    R = se3.exp_so3(axis_angle[:3] / length * axis_angle[3]) if length > 0.0 else np.eye(3)
    scale = vector("scale", vector("scaleFactor", [1.0, 1.0, 1.0]).tolist())
    centre = vector("center", [0.0, 0.0, 0.0])
    matrix = np.eye(4)
    matrix[:3, :3] = R * scale
    matrix[:3, 3] = vector("translation", [0.0, 0.0, 0.0]) + centre - matrix[:3, :3] @ centre
    return matrix


def _numbers(s: Source, words: list[str]) -> FloatArray:
    try:
        return np.array([float(word) if "x" not in word.lower() else int(word, 16) for word in words])
    except ValueError as error:
        raise s.error(f"a number is malformed: {error}") from error
