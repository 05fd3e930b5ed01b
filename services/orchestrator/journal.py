# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The append-only journal on disk: one JSON object a line, on the disk before anything relies on it."""

from __future__ import annotations

import json
import logging
import os
import shutil
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from cdff_common.clock import Clock, WallClock, wall_ns
from cdff_common.errors import StorageError

logger = logging.getLogger(__name__)


class Journal:
    """Appends records durably; a torn last line, which a kill leaves, is cut off when the journal is opened.

    Parameters
    ----------
    path : Path
        Made with its folder where it is missing.
    clock : Clock, optional
        Mission clock for the records' ``stamp_ns``; the wall clock by default.
    """

    def __init__(self, path: Path, clock: Clock | None = None) -> None:
        self._path = path
        self._clock = clock or WallClock()
        self._lock = threading.Lock()
        self._syncing = threading.Lock()
        self._synced = 0
        self._listeners: list[Callable[[Mapping[str, Any]], None]] = []
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._cut_torn_line()
            self._file = path.open("ab", buffering=0)
        except OSError as error:
            raise StorageError(f"journal {path}: {error}") from error
        self._number = max((int(r.get("n", 0)) for r in chain(self.put_aside(), self.records())), default=0)

    def listen(self, listener: Callable[[Mapping[str, Any]], None]) -> None:
        """Have each record told once it is written, in the thread that wrote it."""
        self._listeners.append(listener)

    def append(self, kind: str, *, durable: bool = True, **record: Any) -> None:
        """Add a record, in order, and return once it is on the disk; raises StorageError.

        It gets the next number ``n``, the mission time ``stamp_ns`` and the wall time ``at_ns``.

        One that is not ``durable`` survives the end of this process but not the loss of power: for what no action
        outside relies on, as a request's way through its states.
        """
        with self._lock:
            number = self._number + 1
            head = {"n": number, "at_ns": wall_ns(), "stamp_ns": self._clock.now_ns(), "kind": kind}
            line = json.dumps({**head, **record}, default=str, separators=(",", ":"))
            try:
                self._file.write(line.encode() + b"\n")
            except (OSError, ValueError) as error:
                raise StorageError(f"journal {self._path}: {error}") from error
            self._number = number
        if durable:
            self._sync(number)
        for listener in self._listeners:
            listener({**head, **record})

    def _sync(self, number: int) -> None:
        """Return once the record of that number is on the disk; of threads that wait one syncs for all."""
        with self._syncing:
            if self._synced >= number:
                return
            written = self._number
            try:
                os.fsync(self._file.fileno())
            except (OSError, ValueError) as error:
                raise StorageError(f"journal {self._path}: {error}") from error
            self._synced = written

    def records(self) -> Iterator[dict[str, Any]]:
        """Records since the last compaction, oldest first; lines that are none are logged and passed over."""
        return (record for record, _ in _records(self._path, 0))

    def put_aside(self) -> Iterator[dict[str, Any]]:
        """Records that the last compaction put aside."""
        return (record for record, _ in _records(self._aside, 0))

    def records_from(self, offset: int) -> Iterator[tuple[dict[str, Any], int]]:
        """Records from a byte of the journal on, each with the byte after it: where to go on."""
        return _records(self._path, offset)

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._path.stat().st_size

    def compact(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Put the records so far aside as ``…1.jsonl``, in place of an older one, and go on from ``records`` alone.

        What is carried over has no number: it was said before. A kill at any moment leaves the old journal or the new
        one. Raises StorageError.
        """
        fresh = self._path.with_suffix(".new")
        with self._lock:
            try:
                with fresh.open("wb") as file:
                    for record in records:
                        file.write(json.dumps(record, default=str, separators=(",", ":")).encode() + b"\n")
                    file.flush()
                    os.fsync(file.fileno())
                shutil.copyfile(self._path, self._aside)
                self._file.close()
                fresh.replace(self._path)
                self._file = self._path.open("ab", buffering=0)
            except OSError as error:
                raise StorageError(f"journal {self._path}: {error}") from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._file.close()

    @property
    def _aside(self) -> Path:
        return self._path.with_suffix(".1.jsonl")

    def _cut_torn_line(self) -> None:
        if not self._path.exists():
            return
        with self._path.open("rb+") as file:
            size = file.seek(0, os.SEEK_END)
            end = size
            while end > 0:
                start = max(end - 65536, 0)
                file.seek(start)
                at = file.read(end - start).rfind(b"\n")
                if at >= 0:
                    end = start + at + 1
                    break
                end = start
            if end != size:
                logger.warning("journal %s: %d bytes of a torn last line are cut off", self._path, size - end)
                file.truncate(end)


def _records(path: Path, offset: int) -> Iterator[tuple[dict[str, Any], int]]:
    if not path.exists():
        return
    with path.open("rb") as file:
        file.seek(offset)
        for line in file:
            if not line.endswith(b"\n"):
                return  # it is being written
            offset += len(line)
            try:
                record = json.loads(line)
            except ValueError:
                record = None
            if isinstance(record, dict):
                yield record, offset
            else:
                logger.warning("journal %s: the line that ends at byte %d is no record", path, offset)
