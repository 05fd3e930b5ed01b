# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded samples that wait for the mission clock, in files of the data directory."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from cdff_common.clock import wall_ns
from cdff_common.errors import CodecError
from cdff_common.output import replace_file
from dpm_store.engine.disk_space import DiskSpace
from services.product_file import product_file, read_product_file

logger = logging.getLogger(__name__)

#: Folder in the data directory, and largest sum of the files, bytes.
FOLDER, CAPACITY_BYTES = "waiting", 64 << 20
_SUFFIX = ".sample"


class RecordedSample(NamedTuple):
    """Arguments of ``StoreWriter.put``."""

    names: dict[str, str]
    payload: bytes
    encoding: str
    attachment: bytes

    def to_bytes(self) -> bytes:
        """Return the content of its file."""
        return product_file(
            {"names": self.names, "encoding": self.encoding, "attachment": self.attachment}, self.payload
        )

    @classmethod
    def read(cls, path: Path) -> RecordedSample:
        """Return the sample in a file; raises OSError or CodecError."""
        header, payload = read_product_file(path)
        try:
            return cls(payload=payload, **header)
        except TypeError as error:
            raise CodecError(f"{path}: expected a recorded sample: {error}") from error


@dataclass(slots=True, eq=False)
class _Entry:
    """A sample: its file, or the sample itself if the disk took no file."""

    size: int
    path: Path
    sample: RecordedSample | None = None


class WaitingSamples:
    """Queue of samples, oldest first; a kill of the process loses none. Not thread-safe.

    Files are not synced one by one: a loss of power may cost the seconds that the kernel has not yet written.
    While the disk has no space for them, samples stay in memory.

    Parameters
    ----------
    folder : Path
        Files of an earlier process are queued.
    disk_space : DiskSpace
    capacity : int
        Bytes; beyond it the oldest samples are dropped.
    """

    def __init__(self, folder: Path, disk_space: DiskSpace, capacity: int) -> None:
        self._folder, self._disk_space, self._capacity = folder, disk_space, capacity
        self._entries: deque[_Entry] = deque()
        self._bytes = self._last = 0
        for path in sorted(p for p in folder.glob(f"*{_SUFFIX}") if p.stem.isdecimal()):
            self._last = max(self._last, int(path.stem))
            self._append(_Entry(path.stat().st_size, path))

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, sample: RecordedSample) -> int:
        """Append a sample; return the number of older ones that were dropped."""
        self._last = max(self._last + 1, wall_ns())
        path, data = self._folder / f"{self._last:020d}{_SUFFIX}", sample.to_bytes()
        entry = _Entry(len(data), path, sample)
        if self._disk_space.holds(len(data)):
            try:
                replace_file(path, data)
                entry.sample = None
            except OSError as error:
                logger.warning("a sample waits for the mission clock in memory only: %s", error)
        self._append(entry)
        dropped = 0
        while self._bytes > self._capacity and len(self._entries) > 1:
            self.remove_first()
            dropped += 1
        return dropped

    def first(self) -> RecordedSample:
        """Return the oldest sample.

        Raises
        ------
        IndexError
            If none waits.
        OSError, CodecError
            If its file cannot be read.
        """
        entry = self._entries[0]
        return RecordedSample.read(entry.path) if entry.sample is None else entry.sample

    def remove_first(self) -> None:
        """Remove the oldest sample."""
        entry = self._entries.popleft()
        self._bytes -= entry.size
        if entry.sample is None:
            try:
                entry.path.unlink(missing_ok=True)
            except OSError as error:  # stored again by the next process, which changes nothing
                logger.warning("%s is not removed: %s", entry.path, error)

    def _append(self, entry: _Entry) -> None:
        self._entries.append(entry)
        self._bytes += entry.size
