# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure speed and memory of writing, reading and converting logs of clouds and images.

    python benchmarks/logs.py [--out FILE] [--folder DIR] [--megabytes N] [--targets NAME ...]

An InFuse log with simulated data (random points and pixels, half of the bytes each) is written, read, and
converted to a ROS 1 bag, MCAP files with messages of ROS 2 and of Foxglove (protobuf, JSON) and a ROS 2 bag,
which are read. In the same run the libraries rosbags and mcap read and copy the same files: ``rosbags read``
decodes each message of ROS, ``mcap read`` does not; neither converts to types of CDFF. Each step is a process
of its own that first handles a small log, so that the times are without imports. Memory is sampled:
``anonymous_mb`` is that of the process, ``resident_mb`` has also its pages of libraries and files.
``--folder`` is the folder of the logs, by default in memory (/dev/shm if it exists).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import platform
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import psutil
from _report import write_report

from cdff_common.types import FramePair, LidarScan
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.conversion import convert_log
from cdff_dev.logs.sinks import FOXGLOVE, ROS2, SCHEMAS

_POINTS, _ROWS, _COLS = 120_000, 960, 1280
_SAMPLE_BYTES = _POINTS * 20 + 2 * _ROWS * _COLS
_PERIOD_NS = 100_000_000
#: File names of the new logs. A name with Foxglove's schemas starts with the name of the log without them.
_TARGETS = ("run.bag", "run.mcap", "foxglove.mcap", "foxglove-json.mcap", "run_ros2")
_SMALL_COUNT = 3
_Step = Callable[[Path, int], object]


def _source(folder: Path) -> Path:
    """Return the log that ``write`` has written, one file or a pattern."""
    single = folder / "source.msg"
    return single if single.exists() else folder / "source_*.msg"


def write(folder: Path, count: int) -> None:
    """Write the log of scans and stereo pairs."""
    rng = np.random.default_rng(0)
    points = [rng.normal(scale=20.0, size=(_POINTS, 3)).astype(np.float32) for _ in range(4)]
    offsets_us = np.linspace(0, 99_000, _POINTS).astype(np.uint32)
    intensity = rng.integers(0, 65535, _POINTS, np.uint16)
    ring = rng.integers(0, 64, _POINTS).astype(np.uint16)
    images = [rng.integers(0, 255, (_ROWS, _COLS), np.uint8) for _ in range(4)]
    K = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
    with LogWriter(folder / "source.msg") as log:
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


def convert_to(target: str) -> _Step:
    """Return the step that converts the log; nothing may be lost."""
    schemas = Path(target).stem if Path(target).stem in SCHEMAS else ROS2

    def step(folder: Path, count: int) -> None:
        with open_log(_source(folder)) as log:
            report = convert_log(log, folder / target, schemas=schemas)
        assert not report.losses
        assert sum(report.written.values()) == 2 * count

    return step


def read(target: str) -> _Step:
    """Return the step that reads all samples of a log."""

    def step(folder: Path, count: int) -> None:
        with open_log(folder / target if target else _source(folder)) as log:
            samples = 0
            for sample in log.samples():
                value = sample.value
                samples += len(value.points_m if isinstance(value, LidarScan) else value.left.image) > 0
        assert samples == 2 * count

    return step


def read_with_rosbags(target: str) -> _Step:
    """Return the step that reads and decodes all messages with rosbags."""

    def step(folder: Path, _: int) -> None:
        from rosbags.highlevel import AnyReader

        with AnyReader([folder / target]) as reader:
            for connection, _, raw in reader.messages():
                reader.deserialize(raw, connection.msgtype)

    return step


def read_with_mcap(target: str) -> _Step:
    """Return the step that reads all messages with mcap, without decoding."""

    def step(folder: Path, _: int) -> None:
        from mcap.reader import make_reader

        with (folder / target).open("rb") as file:
            for _, _, message in make_reader(file).iter_messages():
                assert len(message.data)

    return step


def copy_with_rosbags(target: str) -> _Step:
    """Return the step that copies the encoded messages of a bag into a new bag with rosbags."""

    def step(folder: Path, _: int) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.highlevel import AnyReader

        copy = folder / f"copy_{target}"
        with AnyReader([folder / target]) as reader:
            writer = rosbag2.Writer(copy, version=9) if reader.is2 else rosbag1.Writer(copy)
            with writer as bag:
                topics = {
                    c.id: bag.add_connection(c.topic, c.msgtype, typestore=reader.typestore)
                    for c in reader.connections
                }
                for connection, stamp_ns, raw in reader.messages():
                    bag.write(topics[connection.id], stamp_ns, raw)
        _remove(copy)

    return step


def copy_with_mcap(target: str) -> _Step:
    """Return the step that copies the encoded messages of an MCAP file into a new one with mcap."""

    def step(folder: Path, _: int) -> None:
        from mcap.reader import make_reader
        from mcap.writer import CompressionType, Writer

        copy = folder / f"copy_{target}"
        with (folder / target).open("rb") as file, copy.open("wb") as out:
            writer = Writer(out, compression=CompressionType.NONE)
            writer.start()
            known: dict[int, int] = {}
            for schema, channel, message in make_reader(file).iter_messages():
                if channel.id not in known:
                    assert schema is not None
                    added = writer.register_schema(schema.name, schema.encoding, schema.data)
                    known[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, added
                    )
                stamp_ns = message.log_time
                writer.add_message(known[channel.id], stamp_ns, message.data, stamp_ns)
            writer.finish()
        _remove(copy)

    return step


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()


class _Memory(threading.Thread):
    """Largest memory of this process, sampled while a step runs."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.anonymous_mb = self.resident_mb = 0.0
        self._stop_event = threading.Event()

    def run(self) -> None:
        while not self._stop_event.wait(0.02):
            self.sample()

    def sample(self) -> None:
        with Path("/proc/self/status").open(encoding="ascii") as status:
            sizes = dict(line.split(":", 1) for line in status)
        self.anonymous_mb = max(self.anonymous_mb, int(sizes["RssAnon"].split()[0]) / 1024)
        self.resident_mb = max(self.resident_mb, int(sizes["VmRSS"].split()[0]) / 1024)

    def stop(self) -> None:
        self._stop_event.set()
        self.join()
        self.sample()


def _run(name: str, target: str, folders: tuple[Path, Path], count: int, queue: Any) -> None:
    """Put times and memory of a step into a queue, after the same step for the small log."""
    step = _STEPS[name](target)
    step(folders[0], _SMALL_COUNT)
    memory = _Memory()
    memory.start()
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    step(folders[1], count)
    cpu_s, wall_s = time.process_time() - cpu_s, time.perf_counter() - wall_s
    memory.stop()
    queue.put((cpu_s, wall_s, memory.anonymous_mb, memory.resident_mb))


_STEPS: dict[str, Callable[[str], _Step]] = {
    "write": lambda _: write,
    "read": read,
    "convert to": convert_to,
    "rosbags read": read_with_rosbags,
    "mcap read": read_with_mcap,
    "rosbags copy": copy_with_rosbags,
    "mcap copy": copy_with_mcap,
}


def measured(name: str, target: str, folders: tuple[Path, Path], count: int) -> dict[str, float]:
    """Return times, speeds and memory of a step in a process of its own."""
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    process = context.Process(target=_run, args=(name, target, folders, count, queue))
    process.start()
    while process.is_alive() and queue.empty():
        time.sleep(0.05)
    if queue.empty():
        raise SystemExit(f"{name} {target}: the process ended with {process.exitcode}")
    cpu_s, wall_s, anonymous_mb, resident_mb = queue.get()
    process.join()
    megabytes = count * _SAMPLE_BYTES / 1e6
    return {
        "cpu_s": round(cpu_s, 2),
        "wall_s": round(wall_s, 2),
        "mb_per_cpu_s": round(megabytes / cpu_s),
        "mb_per_wall_s": round(megabytes / wall_s),
        "anonymous_mb": round(anonymous_mb),
        "resident_mb": round(resident_mb),
    }


def _file_system(folder: Path) -> str:
    mounts = [p for p in psutil.disk_partitions(all=True) if folder.resolve().is_relative_to(p.mountpoint)]
    return max(mounts, key=lambda p: len(p.mountpoint)).fstype if mounts else "unknown"


def main() -> None:
    """Write, read and convert logs; print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    shared_memory = Path("/dev/shm")
    default = shared_memory if shared_memory.is_dir() else Path(tempfile.gettempdir())
    parser.add_argument("--out", type=Path, help="write JSON here too")
    parser.add_argument("--folder", type=Path, default=default, help="folder of the logs")
    parser.add_argument("--megabytes", type=int, default=2000)
    parser.add_argument("--targets", nargs="+", choices=_TARGETS, default=_TARGETS)
    args = parser.parse_args()
    count = max(_SMALL_COUNT, round(args.megabytes * 1e6 / _SAMPLE_BYTES))
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(dir=args.folder) as name:
        folders = (Path(name) / "small", Path(name) / "whole")
        for folder in folders:
            folder.mkdir()
        for step in ("write", "read"):
            rows[f"{step} source.msg"] = measured(step, "", folders, count)
        for target in args.targets:
            library: tuple[str, ...] = ("rosbags copy",)
            if target.endswith(".mcap"):
                library = ("mcap read", "mcap copy")
            if not target.startswith(FOXGLOVE):
                library = ("rosbags read", *library)
            for step in ("convert to", "read", *library):
                rows[f"{step} {target}"] = measured(step, target, folders, count)
            for folder in folders:
                _remove(folder / target)
        report = {
            "what": "simulated scans of 120 000 points and stereo pairs of 1280 x 960 pixels",
            "megabytes": round(count * _SAMPLE_BYTES / 1e6),
            "file_system": _file_system(args.folder),
            "machine": platform.processor() or platform.machine(),
            "python": platform.python_version(),
            "load_average": os.getloadavg()[0],
            "steps": rows,
        }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
