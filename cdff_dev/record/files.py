# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of a recording: one log, or several of limited size or duration."""

from __future__ import annotations

from collections import Counter
from itertools import chain
from pathlib import Path
from typing import Any

from cdff_common.errors import InputError, StorageError
from cdff_common.interfaces.product import Header
from cdff_dev.logs.formats.infuse.writer import chunk_files
from cdff_dev.logs.mapping import LogMap, StreamTarget, ros_name
from cdff_dev.logs.sinks import LogSink, Loss, create_log


class RecordingFiles:
    """Writes samples to a log, and to the next one when a limit is reached.

    Parameters
    ----------
    path : Path
        The log, see ``create_log``. With a limit the logs are ``NAME_000.EXT``, ``NAME_001.EXT``, ….
    max_bytes : float, optional
        Size of the payloads in a log after which the next one begins.
    max_s : float, optional
        Mission time in a log after which the next one begins, seconds.

    Raises
    ------
    InputError
        If the log exists, also in chunks, or a limit is not above 0.
    """

    def __init__(self, path: Path, max_bytes: float | None = None, max_s: float | None = None) -> None:
        for name, limit in (("--split-mb", max_bytes), ("--split-s", max_s)):
            if limit is not None and not limit > 0:
                raise InputError(f"{name}: expected above 0")
        self.paths: list[Path] = []
        self._path, self._max_bytes, self._max_s = path, max_bytes, max_s
        self._targets: dict[str, StreamTarget] = {}
        self._losses: Counter[Loss] = Counter()
        self._sink: LogSink | None = None
        self._size = 0
        self._first_ns: int | None = None
        self._open()

    @property
    def losses(self) -> Counter[Loss]:
        """Number of samples by stream and field that the logs do not hold."""
        return self._losses + Counter(self._sink.losses if self._sink is not None else {})

    def write(self, stream: str, value: Any, stamp_ns: int, header: Header, size: int) -> None:
        """Append a sample whose payload has ``size`` bytes.

        Raises InputError, or StorageError if it cannot be written or the next log exists.
        """
        if self._first_ns is None:
            self._first_ns = stamp_ns
        elif self._is_full(stamp_ns):
            self.close()
            try:
                self._open()
            except InputError as error:
                raise StorageError(f"next log: {error}") from error
            self._first_ns = stamp_ns
        self._targets.setdefault(stream, StreamTarget("/" + ros_name(stream.replace(".", "/"))))
        assert self._sink is not None
        self._sink.write(stream, value, stamp_ns, header)
        self._size += size

    def close(self) -> None:
        """Complete the log; one that cannot be completed keeps its samples. Raises StorageError."""
        sink, self._sink = self._sink, None
        if sink is not None:
            try:
                sink.close()
            except StorageError:
                sink.keep()
                raise
            self._losses += Counter(sink.losses)

    def existing(self) -> list[Path]:
        """Return the files and folders that were written, chunks included."""
        files_of_paths = [
            [path] if path.exists() else chunk_files(path.parent, path.stem) for path in self.paths
        ]
        return list(chain.from_iterable(files_of_paths))

    def _is_full(self, stamp_ns: int) -> bool:
        is_large = self._max_bytes is not None and self._size >= self._max_bytes
        assert self._first_ns is not None
        return is_large or (self._max_s is not None and stamp_ns - self._first_ns >= self._max_s * 1e9)

    def _open(self) -> None:
        """Open the next file; raises InputError if it exists."""
        path = self._path
        if self._max_bytes is not None or self._max_s is not None:
            path = path.with_name(f"{path.stem}_{len(self.paths):03d}{path.suffix}")
        existing_files = [path] if path.exists() else chunk_files(path.resolve().parent, path.stem)
        if existing_files:
            raise InputError(f"{existing_files[0]} exists: name another file")
        self._sink = create_log(path, LogMap(self._targets))
        self.paths.append(path)
        self._size, self._first_ns = 0, None
