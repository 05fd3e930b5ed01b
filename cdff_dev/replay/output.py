# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The files that a replay writes: outputs, trajectories, the last maps and graphs, and the summary."""

from __future__ import annotations

import json
import resource
import time
from collections import defaultdict
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import ProductNotFoundError
from cdff_common.formats.payload import FORMATS, to_file
from cdff_common.formats.track_csv import write_track_csv
from cdff_common.formats.tracks import TRACK_COLUMNS, track_rows
from cdff_common.formats.tum import write_tum
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.product import Product
from cdff_common.output import make_folder, write_file
from cdff_common.types import ObjectTrack
from cdff_dev.logs import LogWriter

#: Types whose last value is written to a file.
_FILES = ("BodyMotion", "Pointcloud", "Mesh", "ElevationMap", "NavigationMap", "PoseGraph", "VisualMap")


class ReplayOutput:
    """Writer of ``outputs.msg``, of one file for each pose and track output, and of ``summary.json``.

    Poses are ``.tum`` files. Tracks of objects are ``.csv`` files: the rows of an output that has one state
    per product are those of all products, with their status; of other outputs, as predictions, the last
    product is written.

    ``write_items`` adds a file for the last map, graph and cloud of each port and item of the local store, in
    the first format of its type: ``map.tif``, ``graph.g2o``, ``cloud.ply``; and a table of the states of the
    objects of a port ``track``: ``tracks.csv``.

    Parameters
    ----------
    folder : Path or None
        None writes nothing.
    full_names : bool
        Name trajectories ``{robot}.{dfpc}.{port}`` instead of ``{port}``.
    absolute : collection of str
        Ports whose trajectories contain the poses as they are; others are relative to the first pose.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """

    def __init__(
        self, folder: Path | None, *, full_names: bool = False, absolute: Collection[str] = ()
    ) -> None:
        self._folder, self._full_names, self._absolute = folder, full_names, absolute
        self._paths: dict[str, list[tuple[int, se3.FloatArray]]] = defaultdict(list)
        self._tracks: dict[str, list[tuple[ObjectTrack, str]]] = defaultdict(list)
        self._last_values: dict[str, Any] = {}
        self._bearings: dict[str, list[str]] = defaultdict(list)
        self._start_s, self._cpu_start_s = time.monotonic(), time.process_time()
        self._writer: LogWriter | None = None
        if folder is not None:
            make_folder(folder)
            self._writer = LogWriter(folder / "outputs.msg")

    def write(self, products: Iterable[Product]) -> None:
        """Write products that have a value."""
        for product in products:
            if product.value is None:
                continue
            name, stamp_ns = f"{product.dfpc}.{product.port}", product.header.t1_ns
            if self._writer is not None:
                self._writer.write(f"/{product.robot}/{name}", product.value, stamp_ns, product.header)
            output = f"{product.robot}.{name}" if self._full_names else product.port
            if product.type_name == "ObjectTrack" and len(product.value.data.bearings):
                self._last_values[output] = product.value
                self._bearings[output].extend(track_rows(product.value))
                continue
            if product.type_name == "TransformWithCovariance":
                self._paths[output].append((stamp_ns, product.value.transform.matrix))
                continue
            self._last_values[output] = product.value
            if product.type_name == "ObjectTrack":
                if len(product.value.stamps_ns) != 1:
                    self._tracks[output].clear()
                self._tracks[output].append((product.value, product.header.quality.status.name))

    def drawn_values(self) -> dict[str, Any]:
        """Return the paths ``(n, 4, 4)`` of the pose outputs and the last values of the others, by output."""
        paths = {name: np.stack([T for _, T in track]) for name, track in self._paths.items()}
        return paths | self._last_values

    def write_items(self, dfpc: Dfpc) -> None:
        """Write the last maps, graphs and clouds; an item of the store replaces the port of its name."""
        if self._folder is None:
            return
        values = dict(self._last_values)
        for item in dfpc.store.items:
            with suppress(ProductNotFoundError):
                values[item] = dfpc.store.get(item)
        for name, rows in self._bearings.items():
            text = "\n".join([",".join(TRACK_COLUMNS), *rows]) + "\n"
            write_file(self._folder / f"{name.replace('track', 'tracks')}.csv", text.encode())
        for name, value in values.items():
            if (type_name := type(value).__name__) in _FILES:
                suffix = FORMATS[type_name][0]
                write_file(self._folder / f"{name}.{suffix}", to_file(value, suffix))

    def close(self) -> None:
        """Close the log."""
        if self._writer is not None:
            self._writer.close()

    def write_summary(self, counts: dict[str, Any]) -> dict[str, Any]:
        """Return the counts with times and memory; write them, and the trajectories.

        A trajectory contains ``T_first_current``: the first pose is the identity, except for absolute ports.
        """
        summary = {
            **counts,
            "wall_s": time.monotonic() - self._start_s,
            "cpu_s": time.process_time() - self._cpu_start_s,
            "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
        if self._folder is not None:
            for name, path in self._paths.items():
                stamps_ns, T = zip(*path, strict=True)
                start = np.eye(4) if name in self._absolute else T[0]
                text = write_tum(stamps_ns, se3.inverse(start) @ np.stack(T))
                write_file(self._folder / f"{name}.tum", text)
            for name, states in self._tracks.items():
                tracks, statuses = zip(*states, strict=True)
                write_file(self._folder / f"{name}.csv", write_track_csv(tracks, statuses))
            text = (json.dumps(summary, indent=2, sort_keys=True) + "\n").encode()
            write_file(self._folder / "summary.json", text)
        return summary
