# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Description of files and folders that are no recordings, in one line: content, command that reads it."""

from __future__ import annotations

import gzip
import json
import zlib
from collections import defaultdict
from pathlib import Path

from cdff_common.errors import CdffError
from cdff_dev.logs.formats import LogLocation

#: Number of bytes at the start of a file by which its content is recognised.
_HEAD_BYTES = 1 << 16
#: Description of a text without a known structure.
TEXT = "text"
EMPTY = "empty file of 0 bytes: its recording or copy did not start"
_GRAPH = "pose graph", "cdff run pose_graph_optimization graph=FILE"
_BUNDLE = "bundle adjustment problem", "cdff run bundle_adjustment problem=FILE"
_MODEL = "model of an object", "cdff run model_detection model=FILE"
_CALIBRATION = "calibration of a camera", "its folder of images, or --calibration FILE"
#: Content by suffix, for formats whose suffix is unambiguous.
_BY_SUFFIX = {
    ".g2o": _GRAPH,
    ".obj": _MODEL,
    ".stl": _MODEL,
    ".wrl": _MODEL,
    ".glb": _MODEL,
    ".cao": ("model of an object in ViSP's format", ""),
    ".mtl": ("material of a model", ""),
    ".lbl": ("label of a raster (PDS)", ""),
    ".img": ("raster (PDS)", ""),
    ".md": (TEXT, ""),
}
_VIDEO = "not supported: extract images with ffmpeg -i FILE frame_%06d.png"
_ARCHIVE = "not supported: unpack it"
#: Offset and bytes of files that are recognised but have no reader, with the remedy.
_NOT_SUPPORTED = (
    (4, b"ftyp", f"MP4 or MOV video, {_VIDEO}"),
    (8, b"AVI ", f"AVI video, {_VIDEO}"),
    (0, b"\x1a\x45\xdf\xa3", f"Matroska or WebM video, {_VIDEO}"),
    (0, b"ULog\x01\x12\x35", "PX4 log, not supported: convert it to CSV files with ulog2csv"),
    (0, b"\x89HDF\r\n\x1a\n", "HDF5 file, not supported: write its arrays to .npy, .png or .csv files"),
    (0, b"PAR1", "Parquet table, not supported: write it as .csv"),
    (0, b"RRF2", "recording of Rerun, not supported: open it with rerun FILE"),
    (0, b"PK\x03\x04", f"zip archive, {_ARCHIVE}"),
    (0, b"7z\xbc\xaf\x27\x1c", f"7z archive, {_ARCHIVE}"),
    (0, b"\xfd7zXZ\x00", f"xz archive, {_ARCHIVE}"),
    (257, b"ustar", f"tar archive, {_ARCHIVE}"),
)
_CALIBRATION_SUFFIXES = (".yaml", ".yml", ".json", ".xml", ".txt")


def describe(location: LogLocation) -> str | None:
    """Return the content of a location without streams in one line; None if any of its files is unknown."""
    files = list(location.files)
    if location.folder is not None:
        files = sorted(path for path in location.folder.rglob("*") if path.is_file())
    groups: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for file in files:
        if (kind := _kind(file)) is None:
            return None
        groups[kind].append(file)
    if not groups:
        return None
    if len(files) == 1:
        (what, use), _ = next(iter(groups.items()))
        return what + (f" (for {use})" if use else "")
    kinds = sorted(groups.items(), key=lambda item: -len(item[1]))
    return "; ".join(
        f"{len(files_of_kind)} x {what}" + (f" (for {use})" if use else "")
        for (what, use), files_of_kind in kinds
    )


def _kind(path: Path) -> tuple[str, str] | None:
    """Return what a file is and what reads it; None if it is unknown."""
    suffix = path.suffix.lower()
    if path.stat().st_size == 0:
        return EMPTY, ""
    if path.name.lower().startswith(("readme", "license")):
        return TEXT, ""
    if suffix in _BY_SUFFIX:
        return _BY_SUFFIX[suffix]
    if suffix in _CALIBRATION_SUFFIXES and _is_calibration(path):
        return _CALIBRATION
    return _by_content(path, suffix)


def _is_calibration(path: Path) -> bool:
    """Return whether a file is a camera calibration."""
    from cdff_common.camera import read_cameras

    try:
        cameras, _ = read_cameras(path)
    except CdffError:
        return False
    return bool(cameras)


def _by_content(path: Path, suffix: str) -> tuple[str, str] | None:
    """Return content and remedy of a file from its first bytes; None if they are not known."""
    from cdff_common.formats.format_detection import detect

    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if description := next(
        (description for at, magic, description in _NOT_SUPPORTED if head[at:].startswith(magic)), None
    ):
        return description, ""
    if suffix == ".gz":
        try:
            with gzip.open(path) as compressed:
                head = compressed.read(_HEAD_BYTES)
        except (OSError, EOFError, zlib.error):
            return None
        text = _text(head)
        return None if text is None else (f"compressed {_table_of(text)}", "")
    try:
        format_name = detect(path)
    except CdffError:
        format_name = ""
    if format_name in ("bal", "libmv"):
        return _BUNDLE
    if format_name == "pose_txt":
        return "pose as a matrix", "cdff run NAME guess=FILE"
    text = _text(head)
    if text is None:
        return None
    if suffix == ".csv":
        return _table_of(text), ""
    if format_name == "json":
        return f"JSON with {_names(path)}", ""
    if suffix in (".yaml", ".yml", ".xml"):
        return f"{suffix[1:].upper()} settings", ""
    return TEXT, ""


def _text(head: bytes) -> str | None:
    if b"\x00" in head:
        return None
    try:
        return head.decode("utf-8")
    except UnicodeDecodeError as error:
        return head[: error.start].decode("utf-8") if error.start >= len(head) - 4 else None


def _table_of(text: str) -> str:
    first = text.splitlines()[0] if text.strip() else ""
    names = [word.strip() for word in first.lstrip("#").split(",")]
    first_names = ", ".join(names[:6]) + (", …" if len(names) > 6 else "")
    return f"table with {first_names}" if len(names) > 1 else TEXT


def _names(path: Path) -> str:
    """Return a description of the names in a JSON file."""
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return "damaged content"
    if isinstance(content, dict):
        names = list(content)
        return f"the names {', '.join(names[:4])}" + (", …" if len(names) > 4 else "")
    return f"{len(content)} items" if isinstance(content, list) else "one value"
