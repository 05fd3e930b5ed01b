# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A world as glTF 2.0 (binary): a node for each frame, with the clouds, maps and meshes in it."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.world import World
from cdff_dev.view.drawings import Lines, Points, Surface
from cdff_dev.view.layers import layers_of
from cdff_dev.world.export import pose_in

#: Constants of the specification: component types, targets of buffer views, modes of primitives.
_FLOAT, _UINT32, _UINT8 = 5126, 5125, 5121
#: Constants of glTF 2.0: targets of buffers, then modes of primitives.
_ARRAY, _ELEMENTS = 34962, 34963
_POINTS, _LINE_STRIP, _TRIANGLES = 0, 3, 4
#: Rotation about x that turns z up, as in a frame of the ground, to y up, as in glTF.
_Z_UP_TO_Y_UP = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


def write_glb(world: World, root: str) -> bytes:
    """Return the frames that are connected with ``root``, in its axes, and the drawings of the items in them.

    The names of the nodes are those of the frames, the names of the meshes those of the items.
    """
    buffer = _Buffer()
    nodes: list[dict[str, Any]] = [{"name": root, "rotation": list(_Z_UP_TO_Y_UP), "children": []}]
    node_of = {root: 0}
    frames = {*world.frames, *(item.frame for item in world.items if item.frame)}
    for frame in sorted(frames - {root}):
        if (T := pose_in(world, root, frame)) is not None:
            node_of[frame] = len(nodes)
            nodes[0]["children"].append(len(nodes))
            nodes.append({"name": frame, "matrix": T.matrix.T.ravel().tolist(), "children": []})
    meshes: list[dict[str, Any]] = []
    for item in world.items:
        for layer in layers_of(item.name, item.value) if item.value is not None else ():
            primitives = _primitives(buffer, layer.drawing)
            if primitives and layer.frame in node_of:
                nodes[node_of[layer.frame]]["children"].append(len(nodes))
                nodes.append({"name": layer.path, "mesh": len(meshes)})
                meshes.append({"name": layer.path, "primitives": primitives})
    for node in nodes:
        if not node.get("children", True):
            del node["children"]  # an empty list is invalid
    document = {
        "asset": {"version": "2.0", "generator": "cdff"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        **({"meshes": meshes, **buffer.tables()} if meshes else {}),
    }
    return _glb(document, bytes(buffer.data))


class _Buffer:
    """Binary data with its views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add(
        self, array: NDArray[Any], component: int, kind: str, *, target: int = _ARRAY, **other: Any
    ) -> int:
        """Append an array and return the number of its accessor."""
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes, "target": target}
        self._views.append(view)
        self.data += array.tobytes()
        accessor = {"bufferView": len(self._views) - 1, "componentType": component, "type": kind, **other}
        self._accessors.append(accessor | {"count": len(array)})
        return len(self._accessors) - 1

    def positions(self, points_m: NDArray[Any]) -> int:
        """Append positions (n, 3) with their bounds, which the specification requires."""
        points = np.ascontiguousarray(points_m, dtype="<f4")
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        return self.add(points, _FLOAT, "VEC3", **bounds)

    def colours(self, colours: NDArray[np.uint8]) -> int:
        """Append colours (n, 3); the fourth byte aligns each to four bytes."""
        padded = np.pad(colours, ((0, 0), (0, 1)), constant_values=255)
        return self.add(np.ascontiguousarray(padded), _UINT8, "VEC4", normalized=True)

    def tables(self) -> dict[str, Any]:
        """Return the buffer, views and accessors of the document."""
        return {
            "buffers": [{"byteLength": len(self.data)}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }


def _primitives(buffer: _Buffer, drawing: object) -> list[dict[str, Any]]:
    """Return the primitives of a drawing, empty for a drawing without a counterpart in glTF."""
    match drawing:
        case Points(points_m, colours) if len(points_m):
            attributes = {"POSITION": buffer.positions(points_m), "COLOR_0": buffer.colours(colours)}
            return [{"attributes": attributes, "mode": _POINTS}]
        case Surface(vertices_m, triangles, colours) if len(triangles):
            attributes = {"POSITION": buffer.positions(vertices_m), "COLOR_0": buffer.colours(colours)}
            indices = np.ascontiguousarray(triangles.ravel(), dtype="<u4")
            number = buffer.add(indices, _UINT32, "SCALAR", target=_ELEMENTS)
            return [{"attributes": attributes, "indices": number, "mode": _TRIANGLES}]
        case Lines(lines_m, _):
            lines = [line for line in lines_m if len(line) > 1]
            return [
                {"attributes": {"POSITION": buffer.positions(line)}, "mode": _LINE_STRIP} for line in lines
            ]
    return []


def _glb(document: dict[str, Any], data: bytes) -> bytes:
    """Return the container of a document and its buffer; both are padded to four bytes."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    chunks = [(b"JSON", text + b" " * (-len(text) % 4))]
    if data:
        chunks.append((b"BIN\0", data + b"\0" * (-len(data) % 4)))
    body = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for kind, chunk in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
