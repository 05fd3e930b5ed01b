# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cache of converted payloads in files, so that clients can read parts of one, as GDAL does of a COG.

The files are derived data: they are discarded at start, not synced, and beyond a quota the least recently
used are removed. A file that is being read remains readable, since removal only unlinks its name.
"""

from __future__ import annotations

import logging
import shutil
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from services.dpm.rendering.convert import Converted

logger = logging.getLogger(__name__)

#: Folder of the files in the directory of a store.
FOLDER = "conversions"
#: Quota, bytes.
MAX_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class ConvertedFile:
    """A converted payload as an open file, which the caller closes."""

    file: IO[bytes]
    size: int
    encoding: str
    suffix: str


class ConversionCache:
    """Converted payloads by key; each is converted once, also when several callers ask at the same time.

    Parameters
    ----------
    directory : Path
        Directory of the store.
    max_bytes : int
    """

    def __init__(self, directory: Path, max_bytes: int = MAX_BYTES) -> None:
        self._folder = directory / FOLDER
        self._max_bytes = max_bytes
        self._files: OrderedDict[str, tuple[Path, Converted, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._in_work: dict[str, threading.Lock] = {}
        shutil.rmtree(self._folder, ignore_errors=True)

    def open(self, key: str, make: Callable[[], Converted]) -> ConvertedFile:
        """Return the converted payload of a key; ``make`` converts it if it is not in the cache."""
        with self._lock:
            in_work = self._in_work.setdefault(key, threading.Lock())
        with in_work:
            cached = self._cached(key)
            if cached is not None:
                return cached
            try:
                return self._added(key, make())
            finally:
                with self._lock:
                    self._in_work.pop(key, None)

    def _cached(self, key: str) -> ConvertedFile | None:
        with self._lock:
            entry = self._files.get(key)
            if entry is None:
                return None
            path, body, size = entry
            try:
                file = path.open("rb")
            except OSError as error:  # somebody removed it
                logger.warning("%s: not readable, converted again: %s", path.name, error.strerror)
                self._remove(key)
                return None
            self._files.move_to_end(key)
            return ConvertedFile(file, size, body.encoding, body.suffix)

    def _added(self, key: str, body: Converted) -> ConvertedFile:
        """Return the file of a new payload; it has no name if it exceeds the quota."""
        size = len(body.data)
        self._folder.mkdir(parents=True, exist_ok=True)
        if size > self._max_bytes:
            file: IO[bytes] = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115  # the caller closes it
            file.write(body.data)
            file.seek(0)
            return ConvertedFile(file, size, body.encoding, body.suffix)
        with tempfile.NamedTemporaryFile(dir=self._folder, delete=False) as named:
            path = Path(named.name)
            try:
                named.write(body.data)
                named.flush()
            except OSError:
                path.unlink(missing_ok=True)
                raise
        with self._lock:
            self._files[key] = (path, Converted(b"", body.encoding, body.suffix), size)
            self._bytes += size
            file = path.open("rb")
            while self._bytes > self._max_bytes:
                self._remove(next(iter(self._files)))
        return ConvertedFile(file, size, body.encoding, body.suffix)

    def _remove(self, key: str) -> None:
        path, _, size = self._files.pop(key)
        self._bytes -= size
        path.unlink(missing_ok=True)
