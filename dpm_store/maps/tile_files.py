# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cache of tile statistics in files: derived data, so that files are not synced, and discarded if their
validity is uncertain.

The files are valid only if the store was closed after the last of them was written: closing writes an index
with the state of the store that the files include, and opening removes it.
"""

from __future__ import annotations

import json
import shutil
import zlib
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cdff_common.errors import StorageError

if TYPE_CHECKING:
    from cdff_common.raster import CellStatistics, GridGeometry

Key = tuple[str, int, int, int]

_INDEX = "closed.json"
#: Version of the files: those of another version are computed again.
_FORMAT = 2
#: Folder of the tiles in the directory of a store.
FOLDER = "tiles"
_FLOATS = ("count", "mean", "m2", "minimum", "maximum")


class TileFiles:
    """Tile files of a directory; beyond ``max_bytes`` the least recently used are removed."""

    def __init__(self, directory: Path, max_bytes: int) -> None:
        self._directory = directory
        self._max_bytes = max_bytes
        self._sizes: OrderedDict[Key, int] = OrderedDict()
        self._bytes = 0

    def open(self, last_event: int) -> tuple[int, dict[Key, int]]:
        """Read the index of the last ``close``.

        Returns
        -------
        event : int
            Ordinal of the last event that the files include, ``last_event`` without files.
        included : dict
            Ordinal of the last product in each tile.
        """
        included: dict[Key, int] = {}
        path = self._directory / _INDEX
        try:
            index = json.loads(path.read_text())
            path.unlink()
            if index["format"] != _FORMAT or index["event"] > last_event:
                raise ValueError("of another store or version")
            for frame, z, x, y, size, product in index["tiles"]:
                self._add((frame, z, x, y), size)
                included[frame, z, x, y] = product
            return int(index["event"]), included
        except (OSError, ValueError, KeyError, TypeError):
            shutil.rmtree(self._directory, ignore_errors=True)
            self._sizes.clear()
            self._bytes = 0
            return last_event, {}

    def close(self, event: int, included: Mapping[Key, int]) -> None:
        """Write the index, without which the files are discarded; parameters as ``open`` returns them."""
        if not self._sizes:
            return
        tiles = [[*key, size, included[key]] for key, size in self._sizes.items()]
        try:
            (self._directory / _INDEX).write_text(
                json.dumps({"format": _FORMAT, "event": event, "tiles": tiles})
            )
        except OSError as error:
            raise StorageError(f"{self._directory / _INDEX}: not written: {error.strerror}") from error

    def keys(self) -> Iterable[Key]:
        """Return the keys of the stored tiles."""
        return tuple(self._sizes)

    def frames(self) -> set[str]:
        """Return the frames with tiles."""
        return {key[0] for key in self._sizes}

    def read(self, key: Key, geometry: GridGeometry) -> CellStatistics | None:
        """Return the statistics of a tile; None if it is missing or corrupt."""
        from cdff_common.raster import CellStatistics

        if key not in self._sizes:
            return None
        try:
            data = self._path(key).read_bytes()
        except OSError:
            data = b""
        cells = geometry.rows * geometry.cols
        size = (len(_FLOATS) + 1) * 8 * cells
        if len(data) != size + 4 or zlib.crc32(memoryview(data)[:size]) != int.from_bytes(
            data[size:], "little"
        ):
            self.remove(key)
            return None
        self._sizes.move_to_end(key)
        floats = np.frombuffer(data, np.float64, len(_FLOATS) * cells).reshape(len(_FLOATS), *geometry.shape)
        newest = np.frombuffer(data, np.int64, cells, len(_FLOATS) * 8 * cells).reshape(geometry.shape)
        return CellStatistics(geometry, floats[0], floats[1], floats[2], floats[3], floats[4], newest)

    def write(self, key: Key, statistics: CellStatistics) -> None:
        """Write a tile, unless the disk is full."""
        data = b"".join(
            [getattr(statistics, name).tobytes() for name in _FLOATS] + [statistics.newest_ns.tobytes()]
        )
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data + zlib.crc32(data).to_bytes(4, "little"))
        except OSError:
            path.unlink(missing_ok=True)
            return
        self._add(key, len(data))
        while self._bytes > self._max_bytes:
            self.remove(next(iter(self._sizes)))

    def remove(self, key: Key) -> None:
        """Remove a tile."""
        size = self._sizes.pop(key, None)
        if size is not None:
            self._bytes -= size
            self._path(key).unlink(missing_ok=True)

    def _add(self, key: Key, size: int) -> None:
        self._bytes += size - self._sizes.pop(key, 0)
        self._sizes[key] = size

    def _path(self, key: Key) -> Path:
        frame, z, x, y = key
        return self._directory / frame.replace("/", "-") / str(z) / f"{x}_{y}.tile"
