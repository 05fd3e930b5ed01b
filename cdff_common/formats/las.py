# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LAS 1.0 to 1.4, the airborne lidar format of ASPRS, and its compressed form LAZ: points, intensity, colour.

LAS Specification 1.4-R15, American Society for Photogrammetry and Remote Sensing (2019). LAZ needs laspy and
lazrs.
"""

from __future__ import annotations

import io
import struct

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.file_source import Readable, Source, load

_COLOR_OFFSET = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
_MIN_RECORD_BYTES = {0: 20, 1: 28, 2: 26, 3: 34, 4: 57, 5: 63, 6: 30, 7: 36, 8: 38, 9: 59, 10: 67}
_LEGACY_HEADER_BYTES = 227
#: Header of a variable length record; laspy reads as many as the file states.
_VARIABLE_RECORD_BYTES = 54


def read_las(source: Readable) -> CloudArrays:
    """Read all points of a LAS or LAZ file, scaled by the header to metres; raises CodecError."""
    s = load(source)
    if not s.data.startswith(b"LASF") or len(s.data) < _LEGACY_HEADER_BYTES:
        raise s.error("LAS header missing")
    minor = s.data[25]
    (start,) = struct.unpack_from("<I", s.data, 96)
    point_format, record_bytes = struct.unpack_from("<BH", s.data, 104)
    (count,) = struct.unpack_from("<I", s.data, 107)
    scale, offset = struct.unpack_from("<3d", s.data, 131), struct.unpack_from("<3d", s.data, 155)
    if point_format & 0xC0:
        return _read_laz(s)
    if minor >= 4 and len(s.data) >= 375 and count == 0:
        (count,) = struct.unpack_from("<Q", s.data, 247)
    if point_format not in _MIN_RECORD_BYTES or record_bytes < _MIN_RECORD_BYTES[point_format]:
        raise s.error(
            f"point format {point_format} with records of {record_bytes} bytes, expected format 0 to 10"
        )
    if start + count * record_bytes > len(s.data):
        raise s.error(
            f"ends after {len(s.data)} bytes, expected {start + count * record_bytes} for {count} points"
        )
    raw = np.frombuffer(s.data, np.uint8, count * record_bytes, start).reshape(count, record_bytes)
    xyz = np.ascontiguousarray(raw[:, :12]).view("<i4").reshape(count, 3)
    points = xyz * np.array(scale) + np.array(offset)
    if not np.all(np.isfinite(points)):
        raise s.error(f"scale {scale} and offset {offset}: expected finite numbers")
    intensity = np.ascontiguousarray(raw[:, 12:14]).view("<u2").reshape(count).astype(np.float64)
    return CloudArrays(points, intensity, _colors(raw, point_format))


def write_las(cloud: CloudArrays, *, scale_m: float = 0.001) -> bytes:
    """Return a LAS 1.2 file, point format 0 (2 with colours); coordinates are rounded to ``scale_m``."""
    n = len(cloud.points_m)
    offset = np.floor(np.nan_to_num(cloud.points_m.min(axis=0))) if n else np.zeros(3)
    ticks = np.rint((cloud.points_m - offset) / scale_m)
    s = load(b"")
    if not np.all(np.isfinite(ticks)) or (n and np.abs(ticks).max() >= 1 << 31):
        raise s.error(f"points that are not finite or too far apart for LAS at {scale_m} m")
    point_format, record_bytes = (0, 20) if cloud.colors is None else (2, 26)
    raw = np.zeros((n, record_bytes), np.uint8)
    raw[:, :12] = ticks.astype("<i4").view(np.uint8).reshape(n, 12)
    if cloud.intensity is not None:
        raw[:, 12:14] = np.clip(cloud.intensity, 0, 65535).astype("<u2").view(np.uint8).reshape(n, 2)
    raw[:, 14] = 0b00_001_001  # return 1 of 1
    if cloud.colors is not None:
        raw[:, 20:26] = (cloud.colors.astype("<u2") * 257).view(np.uint8).reshape(n, 6)
    low = cloud.points_m.min(axis=0) if n else np.zeros(3)
    high = cloud.points_m.max(axis=0) if n else np.zeros(3)
    head = bytearray(_LEGACY_HEADER_BYTES)
    head[0:4], head[24:26] = b"LASF", bytes((1, 2))
    head[58:62] = b"CDFF"
    struct.pack_into("<HII", head, 94, _LEGACY_HEADER_BYTES, _LEGACY_HEADER_BYTES, 0)
    struct.pack_into("<BHI5I", head, 104, point_format, record_bytes, n, n, 0, 0, 0, 0)
    bounds = [v for axis in range(3) for v in (high[axis], low[axis])]
    struct.pack_into("<12d", head, 131, scale_m, scale_m, scale_m, *offset, *bounds)
    return bytes(head) + raw.tobytes()


def write_laz(cloud: CloudArrays) -> bytes:
    """Return the file of ``write_las`` in lossless compression, about a third of the size."""
    import laspy

    out = io.BytesIO()
    laspy.read(io.BytesIO(write_las(cloud))).write(out, do_compress=True)
    return out.getvalue()


def _check_chunks(s: Source, start: int, count: int) -> None:
    """Refuse a table of more chunks than points: lazrs allocates memory for all and ends the process."""
    last = len(s.data) - 8
    if 0 <= start <= last:
        (at,) = struct.unpack_from("<q", s.data, start)
        if at == -1:  # the writer could not go back
            (at,) = struct.unpack_from("<q", s.data, last)
        if 0 <= at <= last:
            _, chunks = struct.unpack_from("<II", s.data, at)
            if chunks > max(count, 1):
                raise s.error(f"byte {at}: {chunks} chunks for {count} points, expected at most {count}")


def _read_laz(s: Source) -> CloudArrays:
    """Return the cloud of a compressed file; its sizes are checked before it is decompressed."""
    try:
        import laspy
        import lazrs
    except ImportError as error:
        raise s.error(
            f"compressed points (LAZ), and {error.name} is not installed; convert it to LAS"
        ) from error
    (records,) = struct.unpack_from("<I", s.data, 100)
    if s.data[25] >= 4 and len(s.data) >= 375:
        records += struct.unpack_from("<I", s.data, 243)[0]
    if records * _VARIABLE_RECORD_BYTES > len(s.data):
        raise s.error(f"{len(s.data)} bytes, too few for {records} variable length records")
    (start,) = struct.unpack_from("<I", s.data, 96)
    record_bytes, count = struct.unpack_from("<HI", s.data, 105)
    if s.data[25] >= 4 and len(s.data) >= 375:
        count = max(count, *struct.unpack_from("<Q", s.data, 247))
    s.check_claim(count * record_bytes, f"{count} points of {record_bytes} bytes")
    _check_chunks(s, start, count)
    try:
        unpacked = laspy.read(io.BytesIO(s.data), laz_backend=laspy.LazBackend.Lazrs)
        points = np.stack([unpacked.x, unpacked.y, unpacked.z], axis=1).astype(np.float64)
        intensity = np.asarray(unpacked.intensity, dtype=np.float64)
        names = set(unpacked.point_format.dimension_names)
        wide = np.stack([unpacked[c] for c in ("red", "green", "blue")], axis=1) if "red" in names else None
    except (laspy.errors.LaspyException, lazrs.LazrsError, ValueError, struct.error) as error:
        raise s.error(f"not a readable LAZ: {error}") from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # lazrs, in Rust, raises it for damaged chunks
            raise
        raise s.error(f"not a readable LAZ: {error}") from error
    if not np.all(np.isfinite(points)):
        raise s.error("scale or offset that is not finite")
    return CloudArrays(points, intensity, None if wide is None else _eight_bits(wide))


def _colors(raw: NDArray[np.uint8], kind: int) -> NDArray[np.uint8] | None:
    if kind not in _COLOR_OFFSET:
        return None
    at = _COLOR_OFFSET[kind]
    wide = np.ascontiguousarray(raw[:, at : at + 6]).view("<u2").reshape(-1, 3)
    return _eight_bits(wide)


def _eight_bits(wide: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return 8-bit colours; some writers store 8-bit values in the 16-bit fields."""
    return (wide if wide.size and wide.max() < 256 else wide >> 8).astype(np.uint8)
