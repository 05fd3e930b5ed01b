# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of the format of a file by its content, independent of its name."""

from __future__ import annotations

import codecs
import json

from cdff_common.formats.bundle_problem import looks_like_bal, looks_like_libmv
from cdff_common.formats.file_source import Readable, load
from cdff_common.formats.kitti_bin import looks_like_scan

#: Formats that ``detect`` can return.
FORMATS = (
    "ply",
    "pcd",
    "las",
    "png",
    "jpg",
    "pgm",
    "ppm",
    "tif",
    "npz",
    "npy",
    "json",
    "pose_txt",
    "tum",
    "g2o",
    "bal",
    "libmv",
    "csv",
    "msg",
    "bin",
)

_MAGIC = (
    (b"ply\n", "ply"),
    (b"ply\r", "ply"),
    (b"\x89PNG\r\n\x1a\n", "png"),
    (b"\xff\xd8\xff", "jpg"),
    (b"LASF", "las"),
    (b"II*\x00", "tif"),
    (b"MM\x00*", "tif"),
    (b"II+\x00", "tif"),
    (b"MM\x00+", "tif"),
    (b"PK\x03\x04", "npz"),
    (b"\x93NUMPY", "npy"),
    (b"# .PCD", "pcd"),
    (b"VERSION", "pcd"),
    (b"FIELDS", "pcd"),
)
_NETPBM = {b"P2": "pgm", b"P5": "pgm", b"P3": "ppm", b"P6": "ppm"}
#: Bytes at the start of a file from which the format is determined.
_HEAD_BYTES = 1 << 16


def detect(source: Readable) -> str:
    """Return the format of a file, one of ``FORMATS``; raises CodecError for other files."""
    s = load(source)
    if not s.data:
        raise s.error(f"empty file of 0 bytes, expected one of {', '.join(FORMATS)}")
    for magic, name in _MAGIC:
        if s.data.startswith(magic):
            return name
    if s.data[:2] in _NETPBM and s.data[2:3].isspace():
        return _NETPBM[s.data[:2]]
    text = _text(s.data[:_HEAD_BYTES])
    if text is not None:
        text_format = _text_format(text, s.data)
        if text_format:
            return text_format
    if s.data and (0x80 <= s.data[0] <= 0x8F or s.data[0] in (0xDE, 0xDF)) and _is_log(s.data):
        return "msg"
    if looks_like_libmv(s.data):
        return "libmv"
    if looks_like_scan(s.data):
        return "bin"
    raise s.error(f"format not recognised, expected one of {', '.join(FORMATS)}")


def _text(head: bytes) -> str | None:
    """Return the start of a file as text, or None if it is binary; a truncated last character is ignored."""
    if b"\x00" in head or not head.strip():
        return None
    try:
        return codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return None


def _text_format(text: str, data: bytes) -> str | None:
    """Return the format of a text file by its first lines; None if it is not known."""
    if text.lstrip().startswith(("{", "[")):
        try:
            json.loads(data)
        except ValueError:
            return None
        return "json"
    lines = [line for line in (raw.split("#")[0] for raw in text.splitlines()) if line.strip()]
    if not lines:
        return None
    words = [line.replace(",", " ").split() for line in lines[:5]]
    if words[0][0].startswith(("VERTEX_SE", "EDGE_SE", "PARAMS_SE3OFFSET")) or words[0][0] == "FIX":
        return "g2o"
    if looks_like_bal(words):
        return "bal"
    if all(_are_numbers(w) for w in words):
        numbers = sum(len(line.replace(",", " ").split()) for line in lines)
        if len(words[0]) == 8:
            return "tum"
        if numbers in (12, 16) and len(lines) in (1, 3, 4):
            return "pose_txt"
    return "csv" if "," in lines[0] else None


def _are_numbers(words: list[str]) -> bool:
    """Return whether a line has words, all of them numbers."""
    try:
        [float(w) for w in words]
    except ValueError:
        return False
    return bool(words)


def _is_log(data: bytes) -> bool:
    """Return whether the data are a MessagePack map whose first key is the name of a stream."""
    import msgpack

    unpacker = msgpack.Unpacker(max_buffer_size=len(data))
    unpacker.feed(data[:4096])
    try:
        return unpacker.read_map_header() > 0 and str(unpacker.unpack()).startswith("/")
    except (ValueError, msgpack.UnpackException):
        return False
