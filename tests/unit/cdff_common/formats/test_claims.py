# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files that declare more data than they contain, or expand beyond memory, are refused before allocation."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

from cdff_common.errors import CodecError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.geotiff import read_bands
from cdff_common.formats.image import read_image
from cdff_common.formats.las import read_las, write_laz
from cdff_common.formats.npz import read_npz, write_npz
from cdff_common.formats.ply import read_ply

MAX_GROWTH_BYTES = 96 << 20
_MEGABYTE = bytes(1 << 20)


def zip_of_zeros(megabytes: int) -> bytes:
    """Return a compressed npz, some kilobytes long, with an array of zeros."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.npy", "w") as member:
        np.lib.format.write_array_header_1_0(
            member, {"descr": "|u1", "fortran_order": False, "shape": (megabytes << 20,)}
        )
        for _ in range(megabytes):
            member.write(_MEGABYTE)
    return out.getvalue()


def npz_with_shape(shape: tuple[int, ...]) -> bytes:
    """Return an npz with a declared array shape but only eight numbers."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive, archive.open("a.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": shape})
        member.write(bytes(64))
    return out.getvalue()


def png_of(side: int) -> bytes:
    """Return a PNG with a declared size of side × side pixels but only 1000 bytes of pixels."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def sparse_tiff(side: int) -> bytes:
    """Return a GeoTIFF without blocks."""
    import rasterio
    from rasterio.io import MemoryFile

    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff",
            width=side,
            height=side,
            count=1,
            dtype="float32",
            sparse_ok=True,
            tiled=True,
            blockxsize=4096,
            blockysize=4096,
            transform=rasterio.Affine(2, 0, 0, 0, -2, 0),
        ):
            pass
        return bytes(memory.read())


def las_of(points: int) -> bytes:
    """Return a LAS header that declares a number of points."""
    head = bytearray(227)
    head[0:4], head[24:26] = b"LASF", bytes((1, 2))
    struct.pack_into("<HII", head, 94, 227, 227, 0)
    struct.pack_into("<BHI", head, 104, 0, 20, points)
    return bytes(head)


def laz_of(count: int, offset: int = 107) -> bytes:
    """Return a LAZ file of ten points; ``count`` is written into its header at ``offset``, default points."""
    data = bytearray(write_laz(CloudArrays.of(np.zeros((10, 3)))))
    struct.pack_into("<I", data, offset, count)
    return bytes(data)


def laz_of_chunks(count: int) -> bytes:
    """Return a LAZ file of ten points whose table states a number of chunks."""
    data = bytearray(laz_of(10))
    (start,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, start)
    struct.pack_into("<I", data, table + 4, count)
    return bytes(data)


def ply_of(points: int) -> bytes:
    """Return a PLY header that declares a number of points."""
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {points}",
        "property double x",
        "property double y",
        "property double z",
        "end_header",
        "",
    ]
    return "\n".join(lines).encode()


BOMBS: dict[str, tuple[Callable[[bytes], object], Callable[[], bytes]]] = {
    "a zip of 300 MB of zeros": (read_npz, lambda: zip_of_zeros(300)),
    "an array of 8 TB": (read_npz, lambda: npz_with_shape((1 << 40,))),
    "an array whose size overflows": (read_npz, lambda: npz_with_shape((1 << 33, 1 << 33))),
    "an array of negative length": (read_npz, lambda: npz_with_shape((-4,))),
    "an image of 768 MB": (read_image, lambda: png_of(16_000)),
    "an image of 12 GB": (read_image, lambda: png_of(65_535)),
    "a raster of 3.6 GB in a file of some kB": (read_bands, lambda: sparse_tiff(30_000)),
    "a cloud of 4 G points as LAS": (read_las, lambda: las_of((1 << 32) - 1)),
    "a cloud of 4 G points as LAZ": (read_las, lambda: laz_of((1 << 32) - 1)),
    "a LAZ file with 4 G variable length records": (read_las, lambda: laz_of((1 << 32) - 1, offset=100)),
    "a LAZ file with 4 G chunks": (read_las, lambda: laz_of_chunks((1 << 32) - 1)),
    "a cloud of 4 G points as PLY": (read_ply, lambda: ply_of((1 << 32) - 1)),
}


@pytest.mark.req("CDFF-SUP-162")
@pytest.mark.parametrize("name", BOMBS)
def test_a_decompression_bomb_is_refused_without_allocating(name: str) -> None:
    read, make = BOMBS[name]
    data = make()
    process = psutil.Process()
    rss_before = process.memory_info().rss
    with pytest.raises(CodecError):
        read(data)
    assert process.memory_info().rss - rss_before < MAX_GROWTH_BYTES


def test_a_raster_that_references_local_files_is_refused(tmp_path: Path) -> None:
    vrt = (
        b'<VRTDataset rasterXSize="1" rasterYSize="1"><VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
        + (b"<SourceFilename>/etc/hostname</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>")
    )
    with pytest.raises(CodecError):
        read_bands(vrt)


def test_highly_compressible_data_are_still_read() -> None:
    unobserved = np.full((2000, 2000), np.nan, dtype=np.float32)
    assert read_npz(write_npz({"mean": unobserved}))["mean"].shape == (2000, 2000)
