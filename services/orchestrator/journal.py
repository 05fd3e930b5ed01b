# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Append-only journal on disk: one JSON object per line, durable before any action depends on it."""

from __future__ import annotations

import json
import logging
import os
import shutil
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

from cdff_common.bus.handler_pool import waiting
from cdff_common.clock import Clock, WallClock, wall_ns
from cdff_common.errors import StorageError

logger = logging.getLogger(__name__)


class Journal:
    """Durable journal; an incomplete last line, left by a kill, is removed when the journal is opened.

    Parameters
    ----------
    path : Path
        Created with its folder if missing.
    clock : Clock, optional
        Mission clock for the records' ``stamp_ns``; the wall clock by default.
    """

    def __init__(self, path: Path, clock: Clock | None = None) -> None:
        self._path = path
        self._clock = clock or WallClock()
        self._lock = threading.Lock()
        self._sync_lock = threading.Lock()
        self._synced = 0
        self._listeners: list[Callable[[Mapping[str, Any]], None]] = []
        with self._storage_errors():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._remove_incomplete_line()
            self._file = path.open("ab", buffering=0)
        self._number = max((int(r.get("n", 0)) for r in chain(self.archived(), self.records())), default=0)

    def listen(self, listener: Callable[[Mapping[str, Any]], None]) -> None:
        """Call a listener with each written record, in the writing thread."""
        self._listeners.append(listener)

    def append(self, kind: str, *, durable: bool = True, **record: Any) -> int:
        """Append a record and return its mission time once it is on the disk; raises StorageError.

        Meanwhile other requests are served.

        It gets the next number ``n``, the mission time ``stamp_ns`` and the wall time ``at_ns``. A record
        that is not ``durable``, such as an intermediate job state, survives the end of the process but not a
        loss of power.
        """
        with self._lock:
            number = self._number + 1
            stamp_ns = self._clock.now_ns()
            fields = {"n": number, "at_ns": wall_ns(), "stamp_ns": stamp_ns, "kind": kind}
            with self._storage_errors():
                self._file.write(_line({**fields, **record}))
            self._number = number
        if durable:
            with waiting():
                self._sync(number)
        for listener in self._listeners:
            listener({**fields, **record})
        return stamp_ns

    def _sync(self, number: int) -> None:
        """Return once a record is on the disk; one of the waiting threads syncs for all."""
        with self._sync_lock:
            if self._synced >= number:
                return
            written = self._number
            with self._storage_errors():
                os.fsync(self._file.fileno())
            self._synced = written

    def records(self) -> Iterator[dict[str, Any]]:
        """Return the records since the last compaction, oldest first; malformed lines are skipped."""
        return (record for record, _ in _records(self._path, 0))

    def archived(self) -> Iterator[dict[str, Any]]:
        """Return the records archived by the last compaction."""
        return (record for record, _ in _records(self._archive, 0))

    def records_from(self, offset: int) -> Iterator[tuple[dict[str, Any], int]]:
        """Return the records from a byte offset, each with the offset after it."""
        return _records(self._path, offset)

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self._path.stat().st_size

    def compact(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Archive the journal as ``….1.jsonl``, replacing an older archive, and continue with ``records``.

        The records carried over have no number. A kill leaves the old or the new journal. Raises
        StorageError.
        """
        new_path = self._path.with_suffix(".new")
        with self._lock, self._storage_errors():
            with new_path.open("wb") as file:
                file.writelines(map(_line, records))
                file.flush()
                os.fsync(file.fileno())
            shutil.copyfile(self._path, self._archive)
            self._file.close()
            new_path.replace(self._path)
            self._file = self._path.open("ab", buffering=0)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._file.close()

    @contextmanager
    def _storage_errors(self) -> Iterator[None]:
        """Convert the errors of a full or defective disk, and of a closed file, to StorageError."""
        try:
            yield
        except (OSError, ValueError) as error:
            raise StorageError(f"journal {self._path}: {error}") from error

    @property
    def _archive(self) -> Path:
        return self._path.with_suffix(".1.jsonl")

    def _remove_incomplete_line(self) -> None:
        if not self._path.exists():
            return
        with self._path.open("rb+") as file:
            size = os.fstat(file.fileno()).st_size
            if size == 0:
                return
            with mmap(file.fileno(), 0, access=ACCESS_READ) as content:
                end = content.rfind(b"\n") + 1
            if end != size:
                logger.warning(
                    "journal %s: %d bytes of an incomplete last line are removed", self._path, size - end
                )
                file.truncate(end)


def _line(record: Mapping[str, Any]) -> bytes:
    return json.dumps(record, default=str, separators=(",", ":")).encode() + b"\n"


def _records(path: Path, offset: int) -> Iterator[tuple[dict[str, Any], int]]:
    if not path.exists():
        return
    with path.open("rb") as file:
        file.seek(offset)
        for line in file:
            if not line.endswith(b"\n"):
                return  # being written
            offset += len(line)
            try:
                record = json.loads(line)
            except ValueError:
                record = None
            if isinstance(record, dict):
                yield record, offset
            else:
                logger.warning("journal %s: the line that ends at byte %d is malformed", path, offset)
