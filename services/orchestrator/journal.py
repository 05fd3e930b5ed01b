# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The append-only journal on disk: one JSON object a line, on the disk before anything relies on it."""

from __future__ import annotations

import json
import logging
import os
import shutil
import threading
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cdff_common.clock import wall_ns
from cdff_common.errors import StorageError

logger = logging.getLogger(__name__)


class Journal:
    """Appends records durably; a torn last line, which a kill leaves, is cut off when the journal is opened.

    Parameters
    ----------
    path : Path
        Made with its folder where it is missing.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._cut_torn_line()
            self._file = path.open("ab", buffering=0)
        except OSError as error:
            raise StorageError(f"journal {path}: {error}") from error

    def append(self, kind: str, *, durable: bool = True, **record: Any) -> None:
        """Add a record, in order, and return once it is on the disk; raises StorageError.

        One that is not ``durable`` survives the end of this process but not the loss of power: for what no action
        outside relies on, as a request's way through its states.
        """
        line = json.dumps({"at_ns": wall_ns(), "kind": kind, **record}, default=str, separators=(",", ":"))
        with self._lock:
            try:
                self._file.write(line.encode() + b"\n")
                if durable:
                    os.fsync(self._file.fileno())
            except (OSError, ValueError) as error:
                raise StorageError(f"journal {self._path}: {error}") from error

    def records(self) -> Iterator[dict[str, Any]]:
        """All records, oldest first; lines that are no JSON objects are logged and passed over."""
        with self._path.open("rb") as file:
            for number, line in enumerate(file, 1):
                try:
                    record = json.loads(line)
                except ValueError:
                    record = None
                if isinstance(record, dict):
                    yield record
                else:
                    logger.warning("journal %s: line %d is no record; it is passed over", self._path, number)

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._path.stat().st_size

    def compact(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Put the records so far aside as ``…1.jsonl``, in place of an older one, and go on from ``records`` alone.

        A kill at any moment leaves the old journal or the new one. Raises StorageError.
        """
        fresh = self._path.with_suffix(".new")
        with self._lock:
            try:
                with fresh.open("wb") as file:
                    for record in records:
                        file.write(json.dumps(record, default=str, separators=(",", ":")).encode() + b"\n")
                    file.flush()
                    os.fsync(file.fileno())
                shutil.copyfile(self._path, self._path.with_suffix(".1.jsonl"))
                self._file.close()
                fresh.replace(self._path)
                self._file = self._path.open("ab", buffering=0)
            except OSError as error:
                raise StorageError(f"journal {self._path}: {error}") from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._file.close()

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
