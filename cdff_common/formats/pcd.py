# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PCD 0.7, the Point Cloud Library's format: ascii, binary and binary_compressed (LZF).

https://pointclouds.org/documentation/tutorials/pcd_file_format.html
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.file_source import Readable, Source, load

#: Largest size of a header, bytes: other files are refused without reading them to the end.
_HEADER_LIMIT = 1 << 16
#: LZF's largest ratio of compression: three bytes for 264.
_LZF_RATIO = 88
_KINDS = {"F": "f", "I": "i", "U": "u"}


@dataclass(frozen=True, slots=True)
class _Header:
    fields: tuple[tuple[str, str, int], ...]
    points: int
    layout: str
    start: int

    @property
    def dtype(self) -> np.dtype[np.void]:
        columns = [(f"{name}@{i}", f"<{kind}", (count,)) for i, (name, kind, count) in enumerate(self.fields)]
        return np.dtype(columns)


def read_pcd(source: Readable) -> CloudArrays:
    """Read a PCD file; raises CodecError with the file name and the defect."""
    s = load(source)
    header = _header(s)
    read = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed_columns}[header.layout]
    return CloudArrays.from_columns(_with_colors(read(s, header)), s.name)


def write_pcd(cloud: CloudArrays, *, layout: str = "binary") -> bytes:
    """Return a PCD 0.7 file, float32 coordinates; ``layout`` is ``binary`` or ``ascii``."""
    columns = cloud.columns()
    if cloud.colors is not None:
        c = cloud.colors.astype(np.uint32)
        for name in ("red", "green", "blue"):
            del columns[name]
        columns["rgb"] = (c[:, 0] << 16 | c[:, 1] << 8 | c[:, 2]).view(np.float32)
    renamed = {
        {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}.get(k, k): v for k, v in columns.items()
    }
    n = len(cloud.points_m)
    head = (
        "\n".join(
            [
                "# .PCD v0.7 - Point Cloud Data file format",
                "VERSION 0.7",
                f"FIELDS {' '.join(renamed)}",
                f"SIZE {' '.join('4' for _ in renamed)}",
                f"TYPE {' '.join('F' for _ in renamed)}",
                f"COUNT {' '.join('1' for _ in renamed)}",
                f"WIDTH {n}",
                "HEIGHT 1",
                "VIEWPOINT 0 0 0 1 0 0 0",
                f"POINTS {n}",
                f"DATA {layout}",
            ]
        )
        + "\n"
    )
    table = np.stack([np.asarray(v, dtype=np.float32) for v in renamed.values()], axis=1)
    if layout == "ascii":
        return (head + "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table.tolist())).encode()
    return head.encode() + table.astype("<f4").tobytes()


def _header(s: Source) -> _Header:
    """Return the header of a file; raises CodecError if it is incomplete or inconsistent."""
    words: dict[str, list[str]] = {}
    position = 0
    while position < min(len(s.data), _HEADER_LIMIT) and "DATA" not in words:
        end = s.data.find(b"\n", position)
        if end < 0:
            break
        line = s.data[position:end].decode("latin-1").split("#")[0].split()
        if line:
            words[line[0]] = line[1:]
        position = end + 1
    if not {"FIELDS", "SIZE", "TYPE", "DATA"} <= set(words):
        raise s.error("PCD header with FIELDS, SIZE, TYPE and DATA missing")
    names = words["FIELDS"]
    try:
        counts = [int(c) for c in words.get("COUNT", ["1"] * len(names))]
        kinds = [f"{_KINDS[t]}{int(size)}" for t, size in zip(words["TYPE"], words["SIZE"], strict=True)]
        points = (
            int(words["POINTS"][0]) if "POINTS" in words else int(words["WIDTH"][0]) * int(words["HEIGHT"][0])
        )
        fields = tuple(zip(names, kinds, counts, strict=True))
        header = _Header(fields, points, words["DATA"][0], position)
        row_bytes = header.dtype.itemsize
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise s.error(f"malformed PCD header: {error}") from error
    if header.layout not in ("ascii", "binary", "binary_compressed"):
        raise s.error(f"DATA {header.layout}, expected ascii, binary or binary_compressed")
    if points < 0 or any(c < 1 for c in counts) or row_bytes == 0:
        raise s.error(f"POINTS {points}, COUNT {counts}: expected none negative")
    return header


def _binary(s: Source, header: _Header) -> dict[str, NDArray[np.generic]]:
    complete, points = max(len(s.data) - header.start, 0) // header.dtype.itemsize, header.points
    if complete < points:
        s.report_truncation(complete, points, "points")
        points = complete
    table = np.frombuffer(s.data, header.dtype, points, header.start)
    return {name: table[f"{name}@{i}"][:, 0] for i, (name, _, _) in enumerate(header.fields)}


def _compressed_columns(s: Source, header: _Header) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a compressed file."""
    if header.start + 8 > len(s.data):
        raise s.error("ends before the sizes of its compressed block")
    packed, unpacked = struct.unpack_from("<II", s.data, header.start)
    expected = header.points * header.dtype.itemsize
    if unpacked != expected or header.start + 8 + packed > len(s.data):
        raise s.error(
            f"block of {packed} bytes for {unpacked}, expected {expected} for {header.points} points"
        )
    block = _decompress(s, s.data[header.start + 8 : header.start + 8 + packed], unpacked)
    columns: dict[str, NDArray[np.generic]] = {}
    offset = 0
    for name, kind, count in header.fields:  # column by column
        values = np.frombuffer(block, f"<{kind}", header.points * count, offset)
        columns[name] = values.reshape(header.points, count)[:, 0]
        offset += values.nbytes
    return columns


def _decompress(s: Source, packed: bytes, size: int) -> bytes:
    """Return a block decompressed by LZF; raises CodecError if its size differs from ``size``."""
    import lzf

    try:
        block = lzf.decompress(packed, size) if size <= _LZF_RATIO * len(packed) else None
    except ValueError as error:
        raise s.error(f"malformed LZF block: {error}") from error
    if block is None or len(block) != size:
        raise s.error(f"LZF block of {len(packed)} bytes: expected {size} bytes when decompressed")
    return bytes(block)


def _ascii(s: Source, header: _Header) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a text file; an incomplete last line is reported as a truncation."""
    width, points = sum(count for _, _, count in header.fields), header.points
    words = s.data[header.start :].split()
    if len(words) < points * width and not s.data.endswith(b"\n"):  # the last line is not complete
        words = s.data[header.start : s.data.rfind(b"\n") + 1].split()
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise s.error(f"a point contains something other than numbers: {error}") from error
    if values.size < points * width and not values.size % width:
        s.report_truncation(values.size // width, points, "points")
        points = values.size // width
    if values.size != points * width:
        raise s.error(f"{values.size} numbers, expected {points} points of {width}")
    table = values.reshape(points, width)
    columns: dict[str, NDArray[np.generic]] = {}
    position = 0
    for name, kind, count in header.fields:
        columns[name] = table[:, position].astype(kind if name not in ("rgb", "rgba") else "f8")
        position += count
    return columns


def _with_colors(columns: dict[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """Unpack PCL's ``rgb``: 0x00RRGGBB as an integer, or those bits in a float32."""
    packed = columns.get("rgb", columns.get("rgba"))
    if packed is None:
        return columns
    if packed.dtype.itemsize == 8:  # ascii: the decimal integer, or the value of the float
        as_float = np.asarray(packed, dtype=np.float64)
        are_integers = bool(np.all(as_float == np.floor(as_float))) and bool(np.any(as_float >= 1.0))
        bits = as_float.astype(np.uint32) if are_integers else as_float.astype(np.float32).view(np.uint32)
    else:
        bits = np.ascontiguousarray(packed).view(np.uint32)
    channels = {"red": bits >> 16 & 255, "green": bits >> 8 & 255, "blue": bits & 255}
    return {**columns, **{name: c.astype(np.uint8) for name, c in channels.items()}}
