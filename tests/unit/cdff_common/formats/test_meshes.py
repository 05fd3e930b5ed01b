# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Meshes of one tetrahedron in each format, and files that are not meshes or are broken."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from cdff_common.errors import CodecError
from cdff_common.formats.meshes import MESH_FORMATS, detect_mesh, read_mesh

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def obj() -> bytes:
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in VERTICES]
    lines += [f"f {a + 1}/1/1 {b + 1}//2 {c + 1}" for a, b, c in FACES]
    return ("# exported\nmtllib a.mtl\no body\n" + "\n".join(lines) + "\n").encode()


def ply(layout: str) -> bytes:
    head = (
        f"ply\nformat {layout} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if layout == "ascii":
        rows = [" ".join(f"{x:g}" for x in v) for v in VERTICES] + [f"3 {a} {b} {c}" for a, b, c in FACES]
        return head + ("\n".join(rows) + "\n").encode()
    order = "<" if layout == "binary_little_endian" else ">"
    faces = b"".join(struct.pack(f"{order}B3i", 3, *face) for face in FACES.tolist())
    return head + VERTICES.astype(f"{order}f4").tobytes() + faces


def stl(*, binary: bool) -> bytes:
    if binary:
        facets = [struct.pack("<12fH", 0, 0, 0, *VERTICES[face].ravel(), 0) for face in FACES]
        return b"solid in a binary file".ljust(80) + struct.pack("<I", 4) + b"".join(facets)
    text = "solid a\n"
    for face in FACES:
        corners = "".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in VERTICES[face])
        text += f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n"
    return (text + "endsolid a\n").encode()


def glb(**node: object) -> bytes:
    points, indices = VERTICES.astype("<f4").tobytes(), FACES.astype("<u2").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **node}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        "buffers": [{"byteLength": len(points) + len(indices)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = points + indices
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def vrml(transform: str = "", version: int = 2) -> bytes:
    points = ", ".join(f"{x:g} {y:g} {z:g}" for x, y, z in VERTICES)
    faces = " ".join(f"{a} {b} {c} -1" for a, b, c in FACES)
    if version == 1:
        shape = f"Coordinate3 {{ point [ {points} ] }} IndexedFaceSet {{ coordIndex [ {faces} ] }}"
        return f"#VRML V1.0 ascii\nSeparator {{ {transform} {shape} }}\n".encode()
    shape = f"""Shape {{ appearance Appearance {{ material Material {{ diffuseColor 1 1 1 }} }}
      geometry IndexedFaceSet {{ solid FALSE coord Coordinate {{ point [ {points} ] }}
      coordIndex [ {faces} ] }} }}"""
    return f"#VRML V2.0 utf8\n# a comment\nTransform {{ {transform} children [ {shape} ] }}\n".encode()


FILES = {
    "obj": obj(),
    "ply ascii": ply("ascii"),
    "ply little": ply("binary_little_endian"),
    "ply big": ply("binary_big_endian"),
    "stl binary": stl(binary=True),
    "stl ascii": stl(binary=False),
    "glb": glb(),
    "wrl": vrml(),
    "wrl 1": vrml(version=1),
}


def corners(data: bytes) -> np.ndarray:
    """Return the sorted corners (m, 9) of the triangles of a file."""
    mesh = read_mesh(data)
    rows = [np.roll(t, -np.lexsort(t.T[::-1])[0], axis=0).ravel() for t in mesh.vertices[mesh.triangles]]
    return np.array(sorted(map(tuple, rows)))


@pytest.mark.parametrize("name", FILES)
def test_every_format_yields_the_same_triangles_in_the_same_orientation(name: str) -> None:
    assert detect_mesh(FILES[name]) == name.split()[0]
    np.testing.assert_allclose(corners(FILES[name]), corners(FILES["obj"]), atol=1e-6)


def test_all_formats_are_tested() -> None:
    assert {name.split()[0] for name in FILES} == set(MESH_FORMATS)


def test_obj_polygons_become_fans_and_negative_indices_count_from_the_end() -> None:
    mesh = read_mesh(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\n")
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    "data",
    [
        glb(translation=[1.0, 2.0, 3.0], rotation=[0.0, 0.0, 0.70710678, 0.70710678], scale=[2.0, 2.0, 2.0]),
        vrml("translation 1 2 3 rotation 0 0 1 1.57079633 scale 2 2 2"),
        vrml("Transform { translation 1 2 3 rotation 0 0 1 1.57079633 scaleFactor 2 2 2 }", version=1),
    ],
)
def test_transforms_of_nodes_scale_then_rotate_then_translate(data: bytes) -> None:
    R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    expected = 2.0 * VERTICES @ R.T + [1, 2, 3]
    vertices = np.round(read_mesh(data).vertices, 5)
    np.testing.assert_allclose(vertices[np.lexsort(vertices.T)], expected[np.lexsort(expected.T)], atol=1e-6)


def test_vrml_nodes_are_used_again_by_name() -> None:
    text = vrml().decode().replace("Shape {", "DEF part Shape {", 1)
    text += "Transform { translation 5 0 0 children [ USE part ] }\n"
    mesh = read_mesh(text.encode())
    assert len(mesh.triangles) == 8
    assert mesh.vertices[:, 0].max() == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no face"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "vertex 8, expected 0 to 2"),
        (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN"),
        (b"v 0 0\nv 1 0 0\nf 1 1 1\n", "not three numbers"),
        (stl(binary=True)[:-10], "not recognised as a mesh"),
        (ply("binary_little_endian")[:-5], "ends within the faces"),
        (FILES["glb"][:-4], "ends after"),
        (b"#VRML V2.0 utf8\nShape { geometry Box { size 1 1 1 } }\n", "Box"),
        (b"#VRML V2.0 utf8\nShape { geometry IndexedFaceSet {", "ends within a node"),
        (b"nothing", "not recognised as a mesh"),
        (b"", "not recognised as a mesh"),
    ],
)
def test_broken_files_are_refused_with_the_reason(data: bytes, message: str) -> None:
    with pytest.raises(CodecError, match=message):
        read_mesh(data)


def test_a_point_cloud_is_not_a_mesh() -> None:
    head = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    with pytest.raises(CodecError, match="point cloud"):
        read_mesh(head + b"end_header\n0 0 0\n")
