# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reader of logs in MessagePack: those of ``LogWriter`` and of InFuse's robots, with their deviations."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import msgpack
import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.dict_form import from_dict_form
from cdff_common.codecs.messagepack import unpack, unpack_message
from cdff_common.codecs.messagepack._kernels import skip, skip_many
from cdff_common.codecs.nodes import message_node
from cdff_common.codecs.size_variants import base_type
from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.product import Header
from cdff_dev.logs import quirks as quirk
from cdff_dev.logs.byte_files import LogFiles, MappedFile, mapped_file
from cdff_dev.logs.source import LogSample, StreamInfo, chosen_streams

#: Samples that are skipped in one go.
_STRIDE = 64


@dataclass(slots=True)
class _Part:
    """Samples of one stream in one file."""

    file: int
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    headers: list[Any]


class LogReader:
    """A log of one or several files.

    Opening indexes the files: about 50 bytes of memory a sample. No sample is read before it is asked for,
    and none is kept: memory does not grow with the log.

    Parameters
    ----------
    files : list of Path
        In the order of writing.

    Attributes
    ----------
    quirks : Quirks
        Deviations that were read all the same, and how often.
    """

    def __init__(self, files: list[Path]) -> None:
        self.files = files
        self.quirks = quirk.Quirks(files[0].name if files else "log")
        self._files = LogFiles(files)
        self._parts: dict[str, list[_Part]] = {}
        self._types: dict[str, str] = {}
        try:
            for file, path in enumerate(files):
                self._index(file, path)
        except BaseException:
            self.close()
            raise
        self.streams: dict[str, StreamInfo] = {name: self._info(name) for name in sorted(self._parts)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        self._files.close()

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq).

        Raises
        ------
        InputError
            If a stream is not in the log.
        CodecError
            If a sample is not of its stream's type.
        """
        names = chosen_streams(self.streams, streams)
        rows = []
        for rank, name in enumerate(names):
            seq = 0
            for number, part in enumerate(self._parts[name]):
                n = len(part.starts)
                row = np.empty((n, 5), dtype=np.int64)
                row[:, 0], row[:, 1], row[:, 2] = part.stamps_ns, rank, np.arange(seq, seq + n)
                row[:, 3], row[:, 4] = number, np.arange(n)
                rows.append(row)
                seq += n
        if not rows:
            return
        table = np.concatenate(rows)
        for i in np.lexsort((table[:, 2], table[:, 1], table[:, 0])):
            stamp_ns, rank, seq, number, at = (int(v) for v in table[i])
            yield self._sample(names[rank], self._parts[names[rank]][number], at, stamp_ns, seq)

    def _sample(self, name: str, part: _Part, at: int, stamp_ns: int, seq: int) -> LogSample:
        data = self._files.read(part.file, int(part.starts[at]), int(part.ends[at]))
        type_name = self._types[name]
        try:
            plain = quirk.with_microseconds(unpack_message(data, type_name), name, self.quirks)
            value = from_dict_form(type_name, plain, lambda text: self.quirks.tell(f"{name}: {text}"))
            header = (
                Header.from_dict(part.headers[at]) if part.headers and part.headers[at] is not None else None
            )
        except InputError as error:
            raise CodecError(f"{self.files[part.file]}: {name} sample {seq}: {error}") from error
        return LogSample(name, type_name, stamp_ns, seq, value, header)

    def _info(self, name: str) -> StreamInfo:
        stamps = [p.stamps_ns for p in self._parts[name] if len(p.stamps_ns)]
        if not stamps:
            return StreamInfo(self._types[name], 0, 0, 0)
        return StreamInfo(
            self._types[name],
            sum(len(s) for s in stamps),
            min(int(s.min()) for s in stamps),
            max(int(s.max()) for s in stamps),
        )

    def _index(self, file: int, path: Path) -> None:
        """Note where the samples of a file lie."""
        size = path.stat().st_size
        if size == 0:
            self.quirks.tell(f"{path.name}: empty file")
            return
        with mapped_file(path) as walk:
            metas, found = _walk(walk, path, self.quirks)
        for name, (starts, ends) in found.items():
            self._add(path, file, name, metas.get(name), starts, ends)
        for name in metas.keys() - found.keys():
            self.quirks.tell(f"{path.name}: {name}.meta without {name}")

    def _add(
        self, path: Path, file: int, name: str, meta: Any, starts: NDArray[np.int64], ends: NDArray[np.int64]
    ) -> None:
        if not isinstance(meta, dict) or not isinstance(meta.get("type"), str):
            raise CodecError(
                f"{path}: {name} has no {name}.meta with type and timestamps; this is no InFuse log"
            )
        times = meta.get("timestamps")
        if not isinstance(times, list) or not all(type(t) is int for t in times):
            raise CodecError(f"{path}: {name}.meta: timestamps are no list of integers")
        n = len(starts)
        if len(times) != n:
            self.quirks.tell(
                f"{path.name}: {name} has {n} samples and {len(times)} timestamps; the rest is left out"
            )
            n = min(n, len(times))
        type_name = base_type(message_node(meta["type"]).name)
        if self._types.setdefault(name, type_name) != type_name:
            raise CodecError(f"{path}: {name} is a {type_name}, expected {self._types[name]} as before")
        if meta["type"] != type_name:
            self.quirks.tell(f"{name}.meta: type {meta['type']} read as {type_name}")
        try:
            stamps = np.array([quirk.stamp_ns(t, name, self.quirks) for t in times[:n]], dtype=np.int64)
        except OverflowError as error:
            raise CodecError(f"{path}: {name}.meta: timestamps are not within 64 bits") from error
        headers = meta.get("headers", [])
        if headers and (not isinstance(headers, list) or len(headers) < n):
            raise CodecError(f"{path}: {name}.meta: headers are no list of {n}")
        self._parts.setdefault(name, []).append(_Part(file, starts[:n], ends[:n], stamps, headers))


_Samples = dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]


def _walk(walk: MappedFile, path: Path, quirks: quirk.Quirks) -> tuple[dict[str, Any], _Samples]:
    """Metas, and begin and end of the samples of each stream, of a file's map."""
    buffer = walk.data
    metas: dict[str, Any] = {}
    found: _Samples = {}
    pairs, at = _container(buffer, 0, path, "map")
    for _ in range(pairs):
        after = skip(buffer, at)
        if after < 0:
            quirks.tell(f"{path.name}: truncated; what followed is lost")
            return metas, found
        key = unpack(buffer[at:after].tobytes())
        at = int(after)
        if not isinstance(key, str):
            raise CodecError(f"{path}: key {key!r}, expected a stream's name")
        if key.endswith(".meta"):
            after = skip(buffer, at)
            if after < 0:
                quirks.tell(f"{path.name}: truncated in {key}; what followed is lost")
                return metas, found
            metas[key.removesuffix(".meta")] = unpack(buffer[at:after].tobytes())
            at = int(after)
            continue
        count, at = _container(buffer, at, path, "array")
        if count > buffer.size - at:
            quirks.tell(f"{path.name}: truncated in {key}; what followed is lost")
            count = buffer.size - at
        ends = np.zeros(count, dtype=np.int64)
        whole = _skip_samples(walk, at, ends)
        found[key] = (
            np.concatenate([[at], ends[: max(whole - 1, 0)]]).astype(np.int64)[:whole],
            ends[:whole],
        )
        if whole < count:
            quirks.tell(
                f"{path.name}: truncated in {key}: {whole} of {count} samples are whole; what followed is "
                "lost"
            )
            return metas, found
        at = int(ends[-1]) if count else at
    return metas, found


def _skip_samples(walk: MappedFile, at: int, ends: NDArray[np.int64]) -> int:
    """Store the end of each of ``ends.size`` samples, releasing those already read; return the count of
    complete ones.
    """
    done = 0
    while done < ends.size:
        part = ends[done : done + _STRIDE]
        whole = int(skip_many(walk.data, at, part))
        done += whole
        if whole < part.size:
            break
        at = int(part[-1])
        walk.passed(at)
    return done


def _container(buffer: NDArray[np.uint8], at: int, path: Path, kind: str) -> tuple[int, int]:
    """Return the number of elements of the map or array at ``at``, and the offset of the first one."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(buffer[at : at + 5].tobytes())
    try:
        count = unpacker.read_map_header() if kind == "map" else unpacker.read_array_header()
    except (ValueError, msgpack.UnpackException) as error:
        raise CodecError(
            f"{path}: octet {at}: expected a MessagePack {kind}; this is no InFuse log"
        ) from error
    return int(count), at + int(unpacker.tell())
