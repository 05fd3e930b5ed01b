# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Binary glTF 2.0 (GLB): triangles of all meshes of the scene, with the transforms of their nodes.

Khronos glTF 2.0 specification, section 4.4. Compressed meshes (Draco, meshopt) and external buffers are
refused.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.formats.file_source import Source
from cdff_common.formats.meshes.arrays import MeshArrays
from cdff_common.geometry import se3

#: Types of chunks: "JSON" and "BIN\0" as little-endian integers.
_JSON, _BIN = 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
#: Values of ``mode`` of a primitive.
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
#: Depth of nested nodes above which nodes are assumed to contain each other.
_MAX_DEPTH = 64


def read_glb(s: Source) -> MeshArrays:
    """Read a GLB file in its unit, which is the metre by the specification.

    Raises
    ------
    CodecError
        If it is malformed, compressed, or has no triangle.
    """
    try:
        document, binary = _chunks(s)
        scene = _Scene(s, document, binary)
        roots = document.get("scenes", [{}])[document.get("scene", 0)].get("nodes")
        for node in range(len(document.get("nodes", []))) if roots is None else roots:
            scene.add(node, np.eye(4), 0)
    except (KeyError, IndexError, TypeError, ValueError, struct.error) as error:
        raise s.error(f"malformed glTF: {type(error).__name__} {error}") from error
    if not scene.triangles:
        raise s.error("glTF without triangles")
    return MeshArrays.checked(np.concatenate(scene.vertices), np.concatenate(scene.triangles), s.name)


def _chunks(s: Source) -> tuple[dict[str, Any], bytes]:
    """Return the JSON document and the binary chunk of a file."""
    version = struct.unpack_from("<I", s.data, 4)[0]
    if version != 2:
        raise s.error(f"glTF version {version}, expected 2")
    document: dict[str, Any] = {}
    binary, offset = b"", 12
    while offset + 8 <= len(s.data):
        size, kind = struct.unpack_from("<II", s.data, offset)
        content = s.data[offset + 8 : offset + 8 + size]
        if len(content) < size:
            raise s.error(f"ends after {len(s.data)} bytes, expected {offset + 8 + size}")
        if kind == _JSON:
            document = json.loads(content)
        elif kind == _BIN:
            binary = content
        offset += 8 + size
    return document, binary


class _Scene:
    """Collector of the triangles of the nodes of a scene."""

    def __init__(self, s: Source, document: dict[str, Any], binary: bytes) -> None:
        self._s, self._document, self._binary = s, document, binary
        self.vertices: list[FloatArray] = []
        self.triangles: list[IntArray] = []
        self._count = 0

    def add(self, index: int, parent: FloatArray, depth: int) -> None:
        """Add the meshes of a node and its children; ``parent`` (4, 4) is the transform of its parent."""
        if depth > _MAX_DEPTH:
            raise self._s.error("nodes that contain each other")
        node = self._document["nodes"][index]
        matrix = parent @ _local(node)
        if "mesh" in node:
            for primitive in self._document["meshes"][node["mesh"]]["primitives"]:
                self._add_primitive(primitive, matrix)
        for child in node.get("children", []):
            self.add(child, matrix, depth + 1)

    def _add_primitive(self, primitive: dict[str, Any], matrix: FloatArray) -> None:
        """Add the triangles of a primitive, transformed by ``matrix`` (4, 4);
        lines and points are ignored.
        """
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            return
        if "extensions" in primitive and "KHR_draco_mesh_compression" in primitive["extensions"]:
            raise self._s.error("a mesh compressed by Draco, expected one without compression")
        points = self._accessor(primitive["attributes"]["POSITION"]).reshape(-1, 3).astype(np.float64)
        rows = np.arange(len(points))
        if "indices" in primitive:
            rows = self._accessor(primitive["indices"]).reshape(-1).astype(np.int64)
        if mode == _TRIANGLES:
            triangles = rows[: len(rows) // 3 * 3].reshape(-1, 3)
        elif mode == _STRIP:
            triangles = np.stack([rows[:-2], rows[1:-1], rows[2:]], axis=1)
            triangles[1::2] = triangles[1::2, [1, 0, 2]]
        else:
            triangles = np.stack([np.full(len(rows) - 2, rows[0]), rows[1:-1], rows[2:]], axis=1)
        self.vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        self.triangles.append(triangles + self._count)
        self._count += len(points)

    def _accessor(self, index: int) -> Any:
        """Return the array of an accessor; raises CodecError for sparse and external data."""
        accessor = self._document["accessors"][index]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self._s.error("a sparse accessor, which is not supported")
        view = self._document["bufferViews"][accessor["bufferView"]]
        if self._document["buffers"][view["buffer"]].get("uri"):
            raise self._s.error("an external buffer, expected all data in the file")
        dtype, width = np.dtype(_COMPONENTS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        offset = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", dtype.itemsize * width)
        count = accessor["count"]
        if count < 1 or offset + (count - 1) * stride + dtype.itemsize * width > len(self._binary):
            raise self._s.error(f"an accessor of {count} values exceeds the data of the file")
        return np.ndarray((count, width), dtype, self._binary, offset, (stride, dtype.itemsize))


def _local(node: dict[str, Any]) -> FloatArray:
    """Return the transform (4, 4) of a node in its parent: a matrix by columns, or TRS."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    rotation = np.array(node.get("rotation", [0.0, 0.0, 0.0, 1.0]), np.float64)
    matrix[:3, :3] = se3.matrix_from_quaternion_xyzw(rotation) * np.array(node.get("scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix
