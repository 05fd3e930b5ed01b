# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writer of logs: each chunk file is a complete MessagePack map with ``.meta`` before its samples."""

from __future__ import annotations

import glob
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Self

import msgpack

from cdff_common.codecs import encode
from cdff_common.errors import InputError, StorageError
from cdff_common.interfaces.product import Header
from cdff_common.output import storage_errors
from cdff_dev.logs.sinks import LogSink

#: Largest chunk, bytes; a larger sample is stored in a chunk of its own.
CHUNK_BYTES = 64_000_000


def chunk_files(folder: Path, name: str) -> list[Path]:
    """Return the chunk files of the log ``name`` in a folder: ``{name}_000000000.msg``, …, in order."""
    return sorted(folder.glob(f"{glob.escape(name)}_{'[0-9]' * 9}.msg"))


class _Stream:
    """Samples of one stream that are not yet written to a chunk."""

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self.samples: list[bytes] = []
        self.stamps_us: list[int] = []
        self.headers: list[dict[str, Any] | None] = []

    def clear(self) -> None:
        self.samples, self.stamps_us, self.headers = [], [], []


class LogWriter(LogSink):
    """Writes samples to a log.

    Parameters
    ----------
    path : str or Path
        ``NAME.msg``: the log is written to this file; if it needs several chunks, to ``NAME_000000000.msg``,
        ``NAME_000000001.msg``, … instead. A name without ``.msg`` is a folder that holds the chunks as
        ``log_000000000.msg``, ….
        An existing log of that name is replaced.
    chunk_bytes : int
        Largest size of a chunk; the samples of a chunk are kept in memory until it is written.
    is_whole : bool
        Give the files their names only when the log is complete, and remove them after an error: an existing
        log stays until then. Otherwise each chunk has its name when it is complete, and the samples before an
        error stay: a process that is killed loses only those of its current chunk.
    """

    def __init__(self, path: str | Path, *, chunk_bytes: int = CHUNK_BYTES, is_whole: bool = False) -> None:
        self.path = Path(path)
        self._single = self.path.suffix == ".msg"
        self._prefix = self.path.with_suffix("") if self._single else self.path / "log"
        self._chunk_bytes, self._is_whole = chunk_bytes, is_whole
        self._streams: dict[str, _Stream] = {}
        self._size = 0
        self._chunks: list[Path] = []
        self._closed = False
        try:
            self._prefix.parent.mkdir(parents=True, exist_ok=True)
            if not is_whole:
                self._remove_existing()
            elif not os.access(self._prefix.parent, os.W_OK):
                raise PermissionError(None, "no permission to write there")
        except OSError as error:
            raise StorageError(f"log {self.path}: cannot be written: {error.strerror or error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._is_whole and error[0] is not None:
            self.abort()
        else:
            self.close()

    def abort(self) -> None:
        """Close the log; one that had to be whole is removed."""
        self._closed = True
        for path in (*self._chunks, self._next_chunk()) if self._is_whole else ():
            with suppress(OSError):
                path.with_suffix(".part").unlink()

    def write(self, stream: str, value: Any, stamp_ns: int, header: Header | None = None) -> None:
        """Append a sample.

        Parameters
        ----------
        stream : str
            ``/{robot}/{sensor}.{stream}``; all samples of a stream have the same type.
        value : Any
            A message of ``cdff_common.types``.
        stamp_ns : int
            A multiple of 1000.
        header : Header, optional
            Of a product.

        Raises
        ------
        InputError
            If the stamp is not a multiple of 1000, the name ends in ``.meta``, or the type differs from
            that of the previous samples of the stream.
        StorageError
            If the chunk cannot be written.
        """
        if self._closed:
            raise InputError(f"log {self.path}: closed")
        if stamp_ns % 1000:
            raise InputError(
                f"stamp {stamp_ns} of {stream}: expected a multiple of 1000 ns (logs carry microseconds)"
            )
        if not stream.startswith("/") or stream.endswith(".meta"):
            raise InputError(f"stream {stream!r}: expected /robot/component.port, not ending in .meta")
        type_name = type(value).ASN1_NAME
        packed = encode(value, "msgpack")
        entry = self._streams.setdefault(stream, _Stream(type_name))
        if entry.type_name != type_name:
            raise InputError(f"stream {stream}: a {type_name}, expected {entry.type_name} as before")
        if self._size and self._size + len(packed) > self._chunk_bytes:
            self._flush()
        entry.samples.append(packed)
        entry.stamps_us.append(stamp_ns // 1000)
        entry.headers.append(None if header is None else header.to_dict())
        self._size += len(packed)

    def close(self) -> None:
        """Write the last chunk. A log without samples is one file with an empty map."""
        if self._closed:
            return
        self._closed = True
        try:
            self._complete()
        except StorageError:
            self.abort()
            raise

    def keep(self) -> None:
        """Do nothing: complete chunks have their names already."""

    def _complete(self) -> None:
        """Write the last chunk and give the files their names."""
        if self._size or not self._chunks:
            self._flush()
        with storage_errors(f"log {self.path}"):
            if self._is_whole:
                self._remove_existing()
                for path in self._chunks:
                    path.with_suffix(".part").replace(path)
            if self._single and len(self._chunks) == 1:
                self._chunks[0].replace(self.path)

    def _remove_existing(self) -> None:
        """Remove the log that has the name of this one."""
        if self._single:
            self.path.unlink(missing_ok=True)
        for old in chunk_files(self._prefix.parent, self._prefix.name):
            old.unlink()

    def _next_chunk(self) -> Path:
        return self._prefix.with_name(f"{self._prefix.name}_{len(self._chunks):09d}.msg")

    def _flush(self) -> None:
        """Write the collected samples as the next chunk file; an incomplete file is removed."""
        path = self._next_chunk()
        part = path.with_suffix(".part")
        try:
            with part.open("wb") as file:
                self._write_chunk(file)
            if not self._is_whole:
                part.replace(path)
        except OSError as error:
            raise StorageError(f"log {path}: cannot be written: {error.strerror or error}") from error
        finally:
            if not self._is_whole:
                part.unlink(missing_ok=True)
        self._chunks.append(path)
        self._size = 0
        for stream in self._streams.values():
            stream.clear()

    def _write_chunk(self, file: BinaryIO) -> None:
        """Write the collected samples of all streams as one MessagePack map."""
        packer = msgpack.Packer(unicode_errors="surrogateescape")
        filled = {name: s for name, s in sorted(self._streams.items()) if s.samples}
        file.write(packer.pack_map_header(2 * len(filled)))
        for name, stream in filled.items():
            meta: dict[str, Any] = {"type": stream.type_name, "timestamps": stream.stamps_us}
            if any(h is not None for h in stream.headers):
                meta["headers"] = stream.headers
            file.write(packer.pack(f"{name}.meta"))
            file.write(packer.pack(meta))
            file.write(packer.pack(name))
            file.write(packer.pack_array_header(len(stream.samples)))
            file.writelines(stream.samples)
