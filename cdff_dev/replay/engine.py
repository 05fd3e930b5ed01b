# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay: a log in, the DFPC's outputs, a summary and trajectories out."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.product import Product, Quality, product_id
from cdff_common.output import make_folder, write_file
from cdff_core.runtime import Runner
from cdff_dev.logs import LogSample, LogSource, LogWriter


@dataclass(slots=True)
class PoseLines:
    """Collects one pose output for its ``.tum`` file: T_first_current, the first pose identity."""

    T_first: se3.FloatArray | None = None
    lines: list[str] = field(default_factory=list)

    def add(self, stamp_ns: int, T: se3.FloatArray) -> None:
        """Add the pose at ``stamp_ns``."""
        if self.T_first is None:
            self.T_first = T
        relative = se3.inverse(self.T_first) @ T
        q = se3.quaternion_xyzw_from_matrix(relative[:3, :3])
        values = " ".join(f"{x:.9f}" for x in [*relative[:3, 3], *q])
        self.lines.append(f"{stamp_ns // 1_000_000_000}.{stamp_ns % 1_000_000_000 // 1000:06d} {values}")


def samples_of(log: LogSource, wired: Mapping[str, str], robot: str) -> Iterator[Sample]:
    """Yield the log's samples as samples of ports, in (stamp_ns, port, seq) order."""
    port_of = {stream: port for port, stream in wired.items()}

    def sample(item: LogSample) -> Sample:
        component, _, stream = item.stream.rsplit("/", 1)[-1].partition(".")
        header = item.header
        return Sample(
            port=port_of[item.stream],
            stamp_ns=item.stamp_ns,
            seq=item.seq,
            value=item.value,
            id=header.id if header else product_id(robot, component, stream, item.stamp_ns, item.seq, ""),
            frame=header.frame if header else "",
            child=(header.child or "") if header else "",
            quality=header.quality if header else Quality(),
        )

    batch: list[Sample] = []
    for item in log.samples(list(wired.values())):
        if batch and item.stamp_ns != batch[0].stamp_ns:
            yield from sorted(batch, key=lambda s: (s.port, s.seq))
            batch.clear()
        batch.append(sample(item))
    yield from sorted(batch, key=lambda s: (s.port, s.seq))


def paced(samples: Iterable[Sample], speed: float | None) -> Iterator[Sample]:
    """Yield samples at ``speed`` times their own pace; None is as fast as they are taken."""
    begin_s = time.monotonic()
    first_ns: int | None = None
    for sample in samples:
        if speed is not None:
            first_ns = sample.stamp_ns if first_ns is None else first_ns
            wait_s = (sample.stamp_ns - first_ns) * 1e-9 / speed - (time.monotonic() - begin_s)
            if wait_s > 0:
                time.sleep(wait_s)
        yield sample


def replay(
    dfpc: Dfpc,
    samples: Iterable[Sample],
    out: Path | None,
    on_sample: Callable[[Sample], None] | None = None,
) -> dict[str, Any]:
    """Feed samples to a configured DFPC and write what comes out.

    Parameters
    ----------
    out : Path or None
        Folder for ``outputs.msg``, ``summary.json`` and ``<port>.tum``; None writes nothing.
    on_sample : callable or None
        Called after each sample, for progress.

    Returns
    -------
    dict
        The summary: counts, wall and CPU seconds, peak memory, configuration hash.

    Raises
    ------
    StorageError
        If ``out`` cannot be written.
    """
    runner = Runner(dfpc)
    tracks: dict[str, PoseLines] = {}
    wall_s, cpu_s = time.monotonic(), time.process_time()
    writer: LogWriter | None = None
    if out is not None:
        make_folder(out)
        writer = LogWriter(out / "outputs.msg")

    def keep(products: Iterable[Product]) -> None:
        for product in products:
            if product.value is None:
                continue
            if writer is not None:
                stream = f"/{product.robot}/{product.dfpc}.{product.port}"
                writer.write(stream, product.value, product.header.t1_ns, product.header)
            if product.type_name == "TransformWithCovariance":
                tracks.setdefault(product.port, PoseLines()).add(product.header.t1_ns, product.value.transform.matrix)

    try:
        for sample in samples:
            runner.push(sample)
            keep(runner.drain())
            if on_sample is not None:
                on_sample(sample)
        keep(runner.finish())
    finally:
        if writer is not None:
            writer.close()
    counters = runner.counters.to_dict()
    summary = {
        "dfpc": dfpc.name,
        "implementation": dfpc.implementation,
        "config_hash": dfpc.config_hash,
        "samples": counters["samples"],
        "outputs": counters["outputs"],
        "dropped": counters["late"],
        "degraded": counters["degraded"],
        "failed": counters["failed"],
        "errors": counters["errors"],
        "last_error": counters["last_error"],
        "out_of_order": counters["out_of_order"],
        "samples_by_port": counters["samples_by_port"],
        "outputs_by_port": counters["outputs_by_port"],
        "wall_s": time.monotonic() - wall_s,
        "cpu_s": time.process_time() - cpu_s,
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    if out is not None:
        for port, track in tracks.items():
            write_file(out / f"{port}.tum", ("\n".join(track.lines) + "\n").encode())
        write_file(out / "summary.json", (json.dumps(summary, indent=2, sort_keys=True) + "\n").encode())
    return summary


def read_tum(path: Path) -> tuple[np.ndarray[Any, np.dtype[np.float64]], se3.FloatArray]:
    """Read a ``.tum`` file: stamps ``(n,)`` in seconds and transforms ``(n, 4, 4)``."""
    rows = np.loadtxt(path, ndmin=2)
    return rows[:, 0], se3.transform_from_quaternion_xyzw(rows[:, 1:4], rows[:, 4:8])
