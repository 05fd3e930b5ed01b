# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reader of logs in MessagePack: those of ``LogWriter``, and those of the InFuse robots with their quirks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.dict_form import from_dict_form
from cdff_common.codecs.messagepack import unpack, unpack_message
from cdff_common.codecs.messagepack._kernels import skip, skip_many
from cdff_common.codecs.wire_types import base_type, message_node
from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.product import Header
from cdff_dev.logs.byte_files import LogFiles, MappedFile, mapped_file
from cdff_dev.logs.formats.infuse import quirks as quirk
from cdff_dev.logs.formats.infuse.without_meta import own_stamps_ns, type_by_fields
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.source import Unconverted

#: Number of samples that are skipped by one call of the compiled function.
_STRIDE = 64


@dataclass(slots=True)
class _Part:
    """Index of the samples of one stream in one file: byte offsets, stamps and headers."""

    file: int
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    headers: list[Any]


class LogReader(IndexedLog):
    """A log of one or several files.

    Opening a log indexes its files, which needs about 50 bytes of memory per sample. A sample is read when it
    is yielded and is not kept.

    Parameters
    ----------
    files : list of Path
        Files of the log, in the order in which they were written.

    Attributes
    ----------
    quirks : Quirks
        Accepted deviations from the format, and their numbers.
    """

    skips_damaged = False

    def __init__(self, files: list[Path]) -> None:
        self.files = files
        self.quirks = quirk.Quirks()
        self._files = LogFiles(files)
        self._parts: dict[str, list[_Part]] = {}
        self._types: dict[str, str] = {}
        self._lost: dict[str, Unconverted] = {}
        try:
            for file, path in enumerate(files):
                self._index(file, path)
        except BaseException:
            self.close()
            raise
        streams = {name: self._stream(name, parts) for name, parts in self._parts.items()}
        super().__init__(streams, self._lost)

    def close(self) -> None:
        """Close the files."""
        self._files.close()

    def _stream(self, name: str, parts: list[_Part]) -> IndexedStream:
        """Return a stream made of its parts in all files, in order."""
        first = np.cumsum([0, *(len(part.starts) for part in parts)])
        type_name = self._types[name]

        def part_of(number: int) -> tuple[_Part, int]:
            k = int(np.searchsorted(first, number, side="right")) - 1
            return parts[k], number - int(first[k])

        def read(number: int) -> Any:
            part, at = part_of(number)
            data = self._files.read(part.file, int(part.starts[at]), int(part.ends[at]))
            self.quirks.file_name = self.files[part.file].name
            with self._error_context(part, name, number):
                dict_form = quirk.with_microseconds(unpack_message(data, type_name), name, self.quirks)
                return from_dict_form(
                    type_name, dict_form, lambda text: self.quirks.record(f"{name}: {text}")
                )

        def header(number: int) -> Header | None:
            part, at = part_of(number)
            if not part.headers or part.headers[at] is None:
                return None
            with self._error_context(part, name, number):
                return Header.from_dict(part.headers[at])

        stamps_ns = np.concatenate([part.stamps_ns for part in parts])
        return IndexedStream(type_name, stamps_ns, read, header)

    @contextmanager
    def _error_context(self, part: _Part, name: str, number: int) -> Iterator[None]:
        """Name file, stream and sample in an InputError."""
        try:
            yield
        except InputError as error:
            raise CodecError(f"{self.files[part.file]}: {name} sample {number}: {error}") from error

    def _index(self, file: int, path: Path) -> None:
        """Index the samples of a file."""
        self.quirks.file_name = path.name
        size = path.stat().st_size
        if size == 0:
            self.quirks.record("empty file")
            return
        with mapped_file(path) as mapped:
            index = _read_index(mapped, path, self.quirks)
        metas, extents = index.metas, index.extents
        for name, (starts, ends) in extents.items():
            if name in metas or not index.is_truncated:
                self._add_part(path, file, name, metas.get(name), starts, ends)
            elif len(starts):
                self._add_without_meta(path, file, name, starts, ends)
        for name in metas.keys() - extents.keys():
            self.quirks.record(f"{name}.meta without {name}")

    def _add_without_meta(
        self, path: Path, file: int, name: str, starts: NDArray[np.int64], ends: NDArray[np.int64]
    ) -> None:
        """Add a stream whose ``.meta`` is beyond the end of the file, or list it as not converted."""

        def read(number: int) -> bytes:
            return self._files.read(file, int(starts[number]), int(ends[number]))

        def value(number: int) -> Any:
            dict_form = quirk.with_microseconds(unpack_message(read(number), type_name), name, self.quirks)
            return from_dict_form(type_name, dict_form)

        missing = f"{name}.meta is beyond the end of the file"
        try:
            type_name = self._types.get(name) or type_by_fields(unpack(read(0)))
            stamps_ns = np.array(own_stamps_ns(map(value, range(len(starts)))), np.int64)
        except (InputError, OverflowError) as error:
            self.quirks.record(f"{missing}; {len(starts)} samples are not read: {error}")
            self._lost[name] = Unconverted("unknown", len(starts), f"{path.name}: {missing}: {error}")
            return
        self.quirks.record(f"{missing}; read as {type_name} with the times of its samples")
        self._types[name] = type_name
        self._parts.setdefault(name, []).append(_Part(file, starts, ends, stamps_ns, []))

    def _add_part(
        self, path: Path, file: int, name: str, meta: Any, starts: NDArray[np.int64], ends: NDArray[np.int64]
    ) -> None:
        """Add the samples of a stream in one file; raises CodecError for malformed metadata."""
        if not isinstance(meta, dict) or not isinstance(meta.get("type"), str):
            raise CodecError(
                f"{path}: {name} has no {name}.meta with type and timestamps; expected an InFuse log"
            )
        times = meta.get("timestamps")
        if not isinstance(times, list) or not all(type(t) is int for t in times):
            raise CodecError(f"{path}: {name}.meta: expected timestamps as a list of integers")
        n = len(starts)
        if len(times) != n:
            self.quirks.record(
                f"{name} has {n} samples and {len(times)} timestamps; the remainder is ignored"
            )
            n = min(n, len(times))
        try:
            type_name = base_type(message_node(meta["type"]).name)
        except InputError as error:
            raise CodecError(f"{path}: {name}.meta: {error}") from error
        if self._types.setdefault(name, type_name) != type_name:
            raise CodecError(f"{path}: {name} is a {type_name}, expected {self._types[name]} as before")
        if meta["type"] != type_name:
            self.quirks.record(f"{name}.meta: type {meta['type']} read as {type_name}")
        try:
            stamps = np.array([quirk.stamp_ns(t, name, self.quirks) for t in times[:n]], dtype=np.int64)
        except OverflowError as error:
            raise CodecError(f"{path}: {name}.meta: timestamps are not within 64 bits") from error
        headers = meta.get("headers", [])
        if headers and (not isinstance(headers, list) or len(headers) < n):
            raise CodecError(f"{path}: {name}.meta: expected a list of {n} headers")
        self._parts.setdefault(name, []).append(_Part(file, starts[:n], ends[:n], stamps, headers))


@dataclass(slots=True)
class _Index:
    """Index of a file.

    Attributes
    ----------
    metas : dict
        The ``.meta`` entry of each stream.
    extents : dict
        Start and end offsets of the samples of each stream.
    is_truncated : bool
    """

    metas: dict[str, Any] = field(default_factory=dict)
    extents: dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]] = field(default_factory=dict)
    is_truncated: bool = True


def _read_index(file: MappedFile, path: Path, quirks: quirk.Quirks) -> _Index:
    """Return the index of a file."""
    buffer = file.data
    index = _Index()
    metas, extents, end = index.metas, index.extents, f"ends at byte {file.data.size}"
    pairs, at = _container(buffer, 0, path, "map")
    for _ in range(pairs):
        after = skip(buffer, at)
        if after < 0:
            quirks.record(f"truncated: {end}; the remainder is lost")
            return index
        key = _unpack_value(buffer, at, int(after), path)
        at = int(after)
        if not isinstance(key, str):
            raise CodecError(f"{path}: key {key!r}, expected a stream's name")
        if key.endswith(".meta"):
            after = skip(buffer, at)
            if after < 0:
                quirks.record(f"truncated in {key}: {end}; the remainder is lost")
                return index
            metas[key.removesuffix(".meta")] = _unpack_value(buffer, at, int(after), path)
            at = int(after)
            continue
        count, at = _container(buffer, at, path, "array")
        if count > buffer.size - at:
            quirks.record(f"truncated in {key}: {end}; the remainder is lost")
            count = buffer.size - at
        ends = np.zeros(count, dtype=np.int64)
        complete = _skip_samples(file, at, ends)
        extents[key] = (
            np.concatenate([[at], ends[: max(complete - 1, 0)]]).astype(np.int64)[:complete],
            ends[:complete],
        )
        if complete < count:
            quirks.record(
                f"truncated in {key}: {end}; {complete} of {count} samples are complete; "
                "the remainder is lost"
            )
            return index
        at = int(ends[-1]) if count else at
    index.is_truncated = False
    return index


def _skip_samples(file: MappedFile, at: int, ends: NDArray[np.int64]) -> int:
    """Store the end offsets of the samples from ``at`` on in ``ends``.

    Return the number of complete samples.
    """
    sample_count = 0
    while sample_count < ends.size:
        part = ends[sample_count : sample_count + _STRIDE]
        complete = int(skip_many(file.data, at, part))
        sample_count += complete
        if complete < part.size:
            break
        at = int(part[-1])
        file.release_before(at)
    return sample_count


def _unpack_value(buffer: NDArray[np.uint8], at: int, after: int, path: Path) -> Any:
    """Return the value between two offsets; raises CodecError with the offset if it is damaged."""
    try:
        return unpack(buffer[at:after].tobytes())
    except CodecError as error:
        raise CodecError(f"{path}: byte {at}: {error}; expected an InFuse log") from error


def _container(buffer: NDArray[np.uint8], at: int, path: Path, kind: str) -> tuple[int, int]:
    """Return the number of elements of the map or array at ``at``, and the offset of its first element."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(buffer[at : at + 5].tobytes())
    try:
        count = unpacker.read_map_header() if kind == "map" else unpacker.read_array_header()
    except (ValueError, msgpack.UnpackException) as error:
        raise CodecError(f"{path}: byte {at}: expected a MessagePack {kind} of an InFuse log") from error
    return int(count), at + int(unpacker.tell())
