# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PLY, the Stanford polygon file format 1.0: vertices of ascii and binary files of either byte order.

Elements before the vertices are skipped if they have no lists; elements after them (faces, PCL's camera) are
not read. Turk, G. (1994), "The PLY polygon file format".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.cloud import CloudArrays, check_axes
from cdff_common.formats.file_source import Readable, Source, load

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
#: Names without a number of bits, which old programs know too.
_NAMES = {code: name for name, code in _TYPES.items() if name.isalpha()}
PLY_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Largest size of a header, bytes: other files are refused without reading them to the end.
_HEADER_LIMIT = 1 << 16
_KEYWORDS = ("ply", "format", "comment", "obj_info", "element", "property")
#: Form of the lines of a header.
_EXPECTED = {
    "format": f"format and one of {', '.join(PLY_BYTE_ORDERS)}",
    "element": "element NAME COUNT",
    "property": "property TYPE NAME, or property list TYPE TYPE NAME, with types "
    + ", ".join(_NAMES.values()),
}


@dataclass(slots=True)
class PlyElement:
    """Element of a header.

    Attributes
    ----------
    properties : list of (name, numpy type)
    lists : list of (name, numpy type of the length, numpy type of the values)
    """

    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    lists: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def has_list(self) -> bool:
        """True if the element has a property of variable length."""
        return bool(self.lists)


def read_ply(source: Readable) -> CloudArrays:
    """Read the vertices of a PLY file.

    Raises
    ------
    CodecError
        With the file name, if it is not a PLY, has no vertices, or is truncated.
    """
    s = load(source)
    layout, elements, start = ply_header(s)
    vertex = next((e for e in elements if e.name == "vertex"), None)
    if vertex is None:
        raise s.error(
            f"has the elements {', '.join(e.name for e in elements) or 'none'}, expected vertex among them"
        )
    check_axes([name for name, _ in vertex.properties], s.name)
    if vertex.has_list:
        raise s.error("vertices with list properties, expected scalars")
    before = elements[: elements.index(vertex)]
    if layout == "ascii":
        columns = _ascii_columns(s, start, sum(e.count for e in before), vertex)
    else:
        if any(e.has_list for e in before):
            lists = next(e.name for e in before if e.has_list)
            raise s.error(
                f"byte {start}: the element {lists} with lists precedes the vertices, expected them first: "
                "write the file again as ascii or with the vertices first"
            )
        offset = start + sum(e.count * _dtype(e, layout).itemsize for e in before)
        columns = _binary_columns(s, offset, _dtype(vertex, layout), vertex.count)
    return CloudArrays.from_columns(columns, s.name)


def write_ply(
    cloud: CloudArrays, *, ascii_text: bool = False, comments: Mapping[str, str] | None = None
) -> bytes:
    """Return a PLY file: float32 coordinates, little-endian unless ``ascii_text``; comments as ``name
    value``.
    """
    columns = cloud.columns()
    lines = ["ply", f"format {'ascii' if ascii_text else 'binary_little_endian'} 1.0"]
    lines += [f"comment {name} {' '.join(value.split())}" for name, value in (comments or {}).items()]
    lines.append(f"element vertex {len(cloud.points_m)}")
    lines += [f"property {_NAMES[c.dtype.str[1:]]} {name}" for name, c in columns.items()]
    head = ("\n".join([*lines, "end_header"]) + "\n").encode("ascii", "replace")
    if ascii_text:
        rows = zip(*(c.tolist() for c in columns.values()), strict=True)
        return head + "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in rows).encode()
    table = np.empty(
        len(cloud.points_m), dtype=[(name, c.dtype.newbyteorder("<")) for name, c in columns.items()]
    )
    for name, column in columns.items():
        table[name] = column
    return head + table.tobytes()


def ply_header(s: Source) -> tuple[str, list[PlyElement], int]:
    """Return the layout, the elements and the offset of the data; raises CodecError if it is malformed."""
    if not s.data.startswith((b"ply\n", b"ply\r")):
        raise s.error("does not start with ply")
    end = s.data.find(b"end_header", 0, _HEADER_LIMIT)
    newline = s.data.find(b"\n", end) if end >= 0 else -1
    if newline < 0:
        raise s.error(f"no end_header within {_HEADER_LIMIT} bytes")
    layout, elements = "", []
    at = 0
    for line in s.data[:end].decode("latin-1").split("\n"):
        words = line.split()
        if words and words[0] not in _KEYWORDS:
            raise s.error(f"byte {at}: header line {line.strip()!r}, expected one of {', '.join(_KEYWORDS)}")
        try:
            if words[:1] == ["format"]:
                layout = words[1]
            elif words[:1] == ["element"]:
                elements.append(PlyElement(words[1], int(words[2])))
            elif words[:1] == ["property"] and words[1] == "list":
                elements[-1].lists.append((words[4], _TYPES[words[2]], _TYPES[words[3]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], _TYPES[words[1]]))
        except (IndexError, KeyError, ValueError) as error:
            expected = _EXPECTED.get(words[0], "another line")
            if words[0] == "property" and not elements:
                expected = f"an element line before it, then {expected}"
            raise s.error(f"byte {at}: header line {line.strip()!r}, expected {expected}") from error
        at += len(line) + 1
    if layout not in PLY_BYTE_ORDERS:
        raise s.error(f"format {layout!r}, expected one of {', '.join(PLY_BYTE_ORDERS)}")
    if any(e.count < 0 for e in elements):
        raise s.error("an element has a negative count")
    for e in elements:
        if len({name for name, _ in e.properties}) != len(e.properties):
            raise s.error(f"element {e.name} has a repeated property")
    return layout, elements, newline + 1


def _dtype(element: PlyElement, layout: str) -> np.dtype[np.void]:
    return np.dtype([(name, PLY_BYTE_ORDERS[layout] + kind) for name, kind in element.properties])


def _binary_columns(
    s: Source, offset: int, dtype: np.dtype[np.void], count: int
) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a binary file; missing rows are reported as a truncation."""
    complete = max(len(s.data) - offset, 0) // dtype.itemsize if dtype.itemsize else count
    if complete < count:
        s.report_truncation(complete, count, "vertices")
        count = complete
    table = np.frombuffer(s.data, dtype, count, offset)
    return {name: table[name] for name in dtype.names or ()}


def _ascii_columns(s: Source, start: int, skip: int, vertex: PlyElement) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a text file; an incomplete last line is reported as a truncation."""
    lines = s.data[start:].split(b"\n", skip + vertex.count)[skip : skip + vertex.count]
    count = vertex.count
    if len(lines) < count:
        lines = lines[:-1]  # the last line is not complete
        s.report_truncation(len(lines), count, "vertices")
        count = len(lines)
    try:
        values = np.array(b" ".join(lines).split(), dtype=np.float64)
    except ValueError as error:
        raise s.error(f"a vertex contains something other than numbers: {error}") from error
    width = len(vertex.properties)
    if values.size != count * width:
        raise s.error(f"{values.size} numbers, expected {count} vertices of {width}")
    table = values.reshape(count, width)
    return {name: table[:, i].astype(kind) for i, (name, kind) in enumerate(vertex.properties)}
