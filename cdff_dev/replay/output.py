# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The files that a replay writes: outputs, trajectories and the summary."""

from __future__ import annotations

import json
import resource
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.tum import write_tum
from cdff_common.geometry import se3
from cdff_common.interfaces.product import Product
from cdff_common.output import make_folder, write_file
from cdff_dev.logs import LogWriter


class ReplayOutput:
    """Writer of ``outputs.msg``, of one ``.tum`` file for each pose output, and of ``summary.json``.

    Parameters
    ----------
    folder : Path or None
        None writes nothing.
    full_names : bool
        Name trajectories ``{robot}.{dfpc}.{port}`` instead of ``{port}``.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """

    def __init__(self, folder: Path | None, *, full_names: bool = False) -> None:
        self._folder, self._full_names = folder, full_names
        self._tracks: dict[str, list[tuple[int, se3.FloatArray]]] = defaultdict(list)
        self._start_s, self._cpu_start_s = time.monotonic(), time.process_time()
        self._writer: LogWriter | None = None
        if folder is not None:
            make_folder(folder)
            self._writer = LogWriter(folder / "outputs.msg")

    def write(self, products: Iterable[Product]) -> None:
        """Write products that have a value."""
        for product in products:
            if product.value is None or self._writer is None:
                continue
            name, stamp_ns = f"{product.dfpc}.{product.port}", product.header.t1_ns
            self._writer.write(f"/{product.robot}/{name}", product.value, stamp_ns, product.header)
            if product.type_name == "TransformWithCovariance":
                track = f"{product.robot}.{name}" if self._full_names else product.port
                self._tracks[track].append((stamp_ns, product.value.transform.matrix))

    def close(self) -> None:
        """Close the log."""
        if self._writer is not None:
            self._writer.close()

    def write_summary(self, counts: dict[str, Any]) -> dict[str, Any]:
        """Return the counts with times and memory; write them, and the trajectories.

        A trajectory contains ``T_first_current``: the first pose is the identity.
        """
        summary = {
            **counts,
            "wall_s": time.monotonic() - self._start_s,
            "cpu_s": time.process_time() - self._cpu_start_s,
            "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
        if self._folder is not None:
            for name, track in self._tracks.items():
                stamps_ns, T = zip(*track, strict=True)
                text = write_tum(stamps_ns, se3.inverse(T[0]) @ np.stack(T))
                write_file(self._folder / f"{name}.tum", text)
            text = (json.dumps(summary, indent=2, sort_keys=True) + "\n").encode()
            write_file(self._folder / "summary.json", text)
        return summary
