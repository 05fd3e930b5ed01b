# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Blocks of a pocolog file, version 2: a prologue, declarations of streams, and samples.

Numbers of the headers are little-endian; a flag of the prologue states the byte order of the samples. The
prologue has 16 bytes (the specification ``spec-v2.txt`` of tools-pocolog states 12, its code writes 16).
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, field
from pathlib import Path

from cdff_common.errors import CodecError
from cdff_dev.logs.byte_files import mapped_file

MAGIC = b"POCOSIM\0"
VERSION = 2
_PROLOGUE = struct.Struct("<8sII")
#: Type, padding, stream number and size of the content of a block.
BLOCK = struct.Struct("<BBHI")
#: Real and logical time (each seconds and microseconds), size of the sample, and whether it is compressed.
SAMPLE = struct.Struct("<IIIIIB")
#: Types of blocks.
DECLARATION_BLOCK, SAMPLE_BLOCK, CONTROL_BLOCK = 1, 2, 3
#: Largest declaration; definitions of the types of one stream of ROCK need some 10 kB.
_MAX_DECLARATION_BYTES = 16 << 20


class _DamageError(Exception):
    """Damaged block; the text states its content and the expectation."""


@dataclass(slots=True)
class StreamBlocks:
    """Samples of a stream in one file.

    Attributes
    ----------
    name : str
        Name in the log, such as ``/camera.frame``.
    type_name : str
        Type of the samples in ROCK.
    registry : bytes
        XML with the definitions of the types.
    starts, sizes : array of int
        Offset and number of bytes of each sample.
    logical_us : array of int
        Logical time of each sample, microseconds since 1970.
    compressed : array of int
        1 where the bytes are compressed.
    """

    name: str
    type_name: str
    registry: bytes
    starts: array[int] = field(default_factory=lambda: array("q"))
    sizes: array[int] = field(default_factory=lambda: array("q"))
    logical_us: array[int] = field(default_factory=lambda: array("q"))
    compressed: array[int] = field(default_factory=lambda: array("b"))


@dataclass(slots=True)
class FileBlocks:
    """Content of a file.

    Attributes
    ----------
    path : Path
    order : str
        Byte order of the samples: ``<`` or ``>``.
    streams : list of StreamBlocks
        In the order of their declaration.
    undeclared, control : int
        Number of samples of streams without a declaration, and of control blocks.
    damage : str
        Where and why the reading ended; empty if the whole file is readable.
    """

    path: Path
    order: str
    streams: list[StreamBlocks] = field(default_factory=list)
    undeclared: int = 0
    control: int = 0
    damage: str = ""


def read_blocks(path: Path) -> FileBlocks:
    """Index a file by one pass over the headers of its blocks; the samples are not read.

    A damaged block ends the reading, as nothing marks the start of the next block.

    Raises
    ------
    CodecError
        If the file does not begin with a prologue of version 2.
    """
    with path.open("rb") as file:
        prologue = file.read(_PROLOGUE.size)
    file_blocks = FileBlocks(path, _byte_order(prologue, path))
    with mapped_file(path) as mapped:
        declared: dict[int, StreamBlocks] = {}
        data = mapped.data.data
        at, size = _PROLOGUE.size, len(data)
        while at < size:
            try:
                at = _read_block(data, at, file_blocks, declared)
            except _DamageError as error:
                file_blocks.damage = f"damaged at byte {at} of {size}: {error}; the remainder is lost"
                break
            mapped.release_before(at)
    return file_blocks


def _byte_order(prologue: bytes, path: Path) -> str:
    """Return the byte order that the prologue of a file states; raises
    CodecError if it is no pocolog file.
    """
    if len(prologue) < _PROLOGUE.size:
        raise CodecError(
            f"{path}: {len(prologue)} bytes, expected a pocolog prologue of {_PROLOGUE.size} bytes"
        )
    magic, version, flags = _PROLOGUE.unpack(prologue)
    if magic != MAGIC:
        raise CodecError(f"{path}: it begins with {magic!r}, expected {MAGIC!r}")
    if version != VERSION:
        raise CodecError(
            f"{path}: pocolog version {version}, expected {VERSION}; convert it with pocolog --to-new-format"
        )
    return ">" if flags & 1 else "<"


def _read_block(data: memoryview, at: int, file_blocks: FileBlocks, declared: dict[int, StreamBlocks]) -> int:
    """Add a block to the index, and return the offset of the next."""
    if len(data) - at < BLOCK.size:
        raise _DamageError(f"{len(data) - at} bytes, expected a block header of {BLOCK.size}")
    kind, _, stream, size = BLOCK.unpack_from(data, at)
    start = at + BLOCK.size
    end: int = start + size
    if not DECLARATION_BLOCK <= kind <= CONTROL_BLOCK:
        raise _DamageError(f"block of type {kind}, expected 1 (declaration), 2 (sample) or 3 (control)")
    if end > len(data):
        raise _DamageError(f"block of {size} bytes, expected at most the {len(data) - start} of the file")
    if kind == CONTROL_BLOCK:
        file_blocks.control += 1
    elif kind == DECLARATION_BLOCK:
        if (declaration := _declaration(data, start, end)) is not None:
            declared[stream] = declaration
            file_blocks.streams.append(declaration)
    elif stream in declared:
        _add_sample(declared[stream], data, start, size)
    else:
        file_blocks.undeclared += 1
    return end


def _declaration(data: memoryview, start: int, end: int) -> StreamBlocks | None:
    """Return the declared stream; None for a control stream, which has no samples."""
    if end - start > _MAX_DECLARATION_BYTES:
        raise _DamageError(f"declaration of {end - start} bytes, expected at most {_MAX_DECLARATION_BYTES}")
    content = data[start:end].tobytes()
    if content[:1] == b"\x02":
        return None
    if content[:1] != b"\x01":
        raise _DamageError(f"declaration of kind {content[:1]!r}, expected 1 (data) or 2 (control)")
    texts = _texts(content[1:])
    if len(texts) < 2:
        raise _DamageError(f"declaration with {len(texts)} texts, expected name and type of a stream")
    name, type_name = (text.decode("utf-8", "replace") for text in texts[:2])
    return StreamBlocks(name, type_name, texts[2] if len(texts) > 2 else b"")


def _texts(content: bytes) -> list[bytes]:
    """Return the texts of a declaration, each after its number of bytes."""
    texts, at = [], 0
    while at < len(content):
        start = at + 4
        at = start + int.from_bytes(content[at:start], "little")
        if at > len(content):
            raise _DamageError(f"text of {at - start} bytes, expected at most {len(content) - start}")
        texts.append(content[start:at])
    return texts


def _add_sample(stream: StreamBlocks, data: memoryview, start: int, size: int) -> None:
    """Add the position, size and time of a sample block to its stream; raises _DamageError."""
    if size < SAMPLE.size:
        raise _DamageError(f"sample of {size} bytes, expected a header of {SAMPLE.size}")
    _, _, seconds, microseconds, sample_size, flags = SAMPLE.unpack_from(data, start)
    if sample_size != size - SAMPLE.size:
        raise _DamageError(
            f"sample of {sample_size} bytes, expected {size - SAMPLE.size} as its block has {size}"
        )
    stream.starts.append(start + SAMPLE.size)
    stream.sizes.append(sample_size)
    stream.logical_us.append(seconds * 1_000_000 + microseconds)
    stream.compressed.append(flags & 1)
