# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure speed and memory of writing, indexing and reading logs of images.

    python benchmarks/logs.py [--out FILE] [--folder DIR] [--megabytes N]

``--folder`` is the folder of the log, by default in memory (/dev/shm if it exists); the report states its
file system. Speeds are bytes of the log per CPU time of this process and per wall time. ``--megabytes 10000``
shows that memory does not grow with the log.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import psutil
from _report import write_report

from cdff_common.types import Frame, FramePair
from cdff_dev.logs import LogWriter, open_log

ROWS, COLS = 960, 1280


def file_system(folder: Path) -> str:
    """Return the type of the file system of a folder."""
    mounts = [p for p in psutil.disk_partitions(all=True) if folder.resolve().is_relative_to(p.mountpoint)]
    return max(mounts, key=lambda p: len(p.mountpoint)).fstype if mounts else "unknown"


def timed(call: Callable[[], Any], byte_count: int) -> dict[str, float]:
    """Return CPU and wall time of a call that processes ``byte_count`` bytes, and MB/s."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    call()
    cpu_s, wall_s = time.process_time() - cpu_s, time.perf_counter() - wall_s
    return {
        "cpu_s": round(cpu_s, 4),
        "wall_s": round(wall_s, 4),
        "mb_per_cpu_s": round(byte_count / 1e6 / max(cpu_s, 1e-9)),
        "mb_per_wall_s": round(byte_count / 1e6 / wall_s),
    }


def anonymous_mb() -> float:
    """Return the anonymous memory of this process (without file pages), megabytes."""
    with Path("/proc/self/status").open(encoding="ascii") as status:
        return sum(int(line.split()[1]) for line in status if line.startswith("RssAnon")) / 1024


def main() -> None:
    """Write, index and read a log of stereo pairs; print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="write JSON here too")
    parser.add_argument("--folder", type=Path, help="where to put the log")
    parser.add_argument("--megabytes", type=int, default=1000)
    args = parser.parse_args()
    shared_memory = Path("/dev/shm")
    folder = args.folder or (shared_memory if shared_memory.is_dir() else Path(tempfile.gettempdir()))
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (ROWS, COLS), dtype=np.uint8) for _ in range(4)]
    pairs = max(1, round(args.megabytes * 1e6 / (2 * ROWS * COLS)))
    byte_count = pairs * 2 * ROWS * COLS

    def pair(i: int) -> FramePair:
        left, right = (Frame.from_image(images[(i + k) % 4], stamp_ns=i * 1_000_000) for k in (0, 1))
        return FramePair(baseline=0.2, left=left, right=right)

    with tempfile.TemporaryDirectory(dir=folder) as name:
        path = Path(name) / "bench.msg"

        def write(count: int, path: Path) -> None:
            with LogWriter(path) as log:
                for i in range(count):
                    log.write("/mana/navcam.pair", pair(i), i * 1_000_000)

        write(4, Path(name) / "warm.msg")
        with open_log(Path(name) / "warm.msg") as log:
            list(log.samples())
        rows: dict[str, Any] = {"write": timed(lambda: write(pairs, path), byte_count)}
        target = path if path.exists() else Path(str(path.with_suffix("")) + "_*.msg")
        log = None

        def index() -> None:
            nonlocal log
            log = open_log(target)

        rows["index"] = timed(index, byte_count)
        assert log is not None
        initial_mb, peak_mb = anonymous_mb(), 0.0

        def read() -> None:
            nonlocal peak_mb
            assert log is not None
            count = 0
            for sample in log.samples():
                count += sample.value.left.image.size > 0
                if count % 64 == 0:
                    peak_mb = max(peak_mb, anonymous_mb())
            assert count == pairs

        rows["read"] = timed(read, byte_count)
        log.close()
        report = {
            "what": "a log of stereo pairs of 1280 x 960 bytes",
            "megabytes": round(byte_count / 1e6),
            "file_system": file_system(folder),
            "machine": platform.processor() or platform.machine(),
            "python": platform.python_version(),
            "load_average": os.getloadavg()[0],
            **rows,
            "memory_before_reading_mb": round(initial_mb),
            "most_memory_while_reading_mb": round(max(peak_mb, anonymous_mb())),
            "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10,
        }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
