# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure speed and memory of reading and converting logs of clouds and images.

    python benchmarks/log_conversion.py [--out FILE] [--folder DIR] [--megabytes N]

An InFuse log with simulated data (random points and pixels, half of the bytes each) is converted to a ROS 1 bag,
an MCAP file and a ROS 2 bag, and each log is read. The libraries rosbags and mcap read the same files for
comparison: ``library`` yields each message and decodes it, without conversion to types of CDFF. Each step is a
process of its own, whose peak of resident memory without file pages is sampled.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from _report import write_report

from cdff_common.types import FramePair, LidarScan
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.conversion import convert_log

_POINTS, _ROWS, _COLS = 120_000, 960, 1280
_PERIOD_NS = 100_000_000
_SOURCE = "source.msg"
_TARGETS = ("run.bag", "run.mcap", "run_ros2")


def write_source(folder: Path, megabytes: int) -> int:
    """Write the log of scans and stereo pairs; return the bytes of their columns and pixels."""
    rng = np.random.default_rng(0)
    points = [rng.normal(scale=20.0, size=(_POINTS, 3)).astype(np.float32) for _ in range(4)]
    offsets_us = np.linspace(0, 99_000, _POINTS).astype(np.uint32)
    intensity, ring = (
        rng.integers(0, 65535, _POINTS, np.uint16),
        rng.integers(0, 64, _POINTS).astype(np.uint16),
    )
    images = [rng.integers(0, 255, (_ROWS, _COLS), np.uint8) for _ in range(4)]
    K = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
    sample_bytes = _POINTS * 20 + 2 * _ROWS * _COLS
    count = max(4, round(megabytes * 1e6 / sample_bytes))
    with LogWriter(folder / _SOURCE) as log:
        for k in range(count):
            stamp_ns = k * _PERIOD_NS
            scan = LidarScan.from_arrays(
                points[k % 4],
                offsets_us,
                frame="mana/lidar",
                t0_ns=stamp_ns,
                t1_ns=stamp_ns + 99_000_000,
                intensity=intensity,
                ring=ring,
            )
            pair = FramePair.from_images(
                images[k % 4],
                images[(k + 1) % 4],
                baseline_m=0.2,
                camera_matrix=K,
                stamp_ns=stamp_ns,
                sensor="mana/navcam_left",
            )
            log.write("/mana/lidar.scan", scan, stamp_ns)
            log.write("/mana/navcam.pair", pair, stamp_ns)
    return count * sample_bytes


def convert(source: Path, target: Path) -> None:
    """Convert a log; nothing may be lost."""
    with open_log(source) as log:
        assert not convert_log(log, target).losses


def read(path: Path) -> None:
    """Read all samples of a log."""
    with open_log(path) as log:
        for sample in log.samples():
            value = sample.value
            assert len(value.points_m if isinstance(value, LidarScan) else value.left.image)


def read_with_rosbags(path: Path) -> None:
    """Read and decode all messages with rosbags."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)


def read_with_mcap(path: Path) -> None:
    """Read all messages with mcap, without decoding."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            assert len(message.data)


def _anonymous_mb() -> float:
    with Path("/proc/self/status").open(encoding="ascii") as status:
        return sum(int(line.split()[1]) for line in status if line.startswith("RssAnon")) / 1024


def _run(call: Callable[..., None], args: tuple[Any, ...], queue: Any) -> None:
    """Put CPU time, wall time and largest anonymous memory of a call into a queue."""
    peak_mb, stop = [0.0], threading.Event()

    def sample() -> None:
        while not stop.wait(0.05):
            peak_mb[0] = max(peak_mb[0], _anonymous_mb())

    thread = threading.Thread(target=sample)
    thread.start()
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    call(*args)
    times = time.process_time() - cpu_s, time.perf_counter() - wall_s
    stop.set()
    thread.join()
    queue.put((*times, max(peak_mb[0], _anonymous_mb())))


def measured(call: Callable[..., None], *args: Any, byte_count: int) -> dict[str, float]:
    """Return times, speeds and memory of a call in a process of its own."""
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    process = context.Process(target=_run, args=(call, args, queue))
    process.start()
    cpu_s, wall_s, peak_mb = queue.get()
    process.join()
    return {
        "cpu_s": round(cpu_s, 2),
        "wall_s": round(wall_s, 2),
        "mb_per_cpu_s": round(byte_count / 1e6 / cpu_s),
        "mb_per_wall_s": round(byte_count / 1e6 / wall_s),
        "peak_mb": round(peak_mb),
    }


def main() -> None:
    """Write, convert and read logs; print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="write JSON here too")
    parser.add_argument("--folder", type=Path, default=Path("/dev/shm"), help="folder of the logs")
    parser.add_argument("--megabytes", type=int, default=500)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.folder) as name:
        folder = Path(name)
        count = write_source(folder, args.megabytes)
        source = folder / _SOURCE if (folder / _SOURCE).exists() else folder / "source_*.msg"
        rows = {f"read {_SOURCE}": measured(read, source, byte_count=count)}
        for target in _TARGETS:
            path = folder / target
            rows[f"convert to {target}"] = measured(convert, source, path, byte_count=count)
            rows[f"read {target}"] = measured(read, path, byte_count=count)
            rows[f"rosbags {target}"] = measured(read_with_rosbags, path, byte_count=count)
            if path.suffix == ".mcap":
                rows[f"mcap {target}"] = measured(read_with_mcap, path, byte_count=count)
            for file in [path] if path.is_file() else list(path.iterdir()):
                file.unlink()
        report = {
            "what": "simulated scans of 120 000 points and stereo pairs of 1280 x 960 pixels",
            "megabytes": round(count / 1e6),
            "load_average": os.getloadavg()[0],
            "steps": rows,
        }
    print(json.dumps(rows, indent=1))
    write_report(report, args.out)


if __name__ == "__main__":
    main()
