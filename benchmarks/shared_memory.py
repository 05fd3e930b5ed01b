# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure what publishers that end leave in the router and in a subscriber, with and without shared memory.

    python benchmarks/shared_memory.py [--publishers 200] [--mb 0 --mb 16] [--out FILE]

Each publisher is a process that opens the bus, publishes ten messages of 100 kB within a second, and ends.
Reported for router and subscriber: growth of mapped shared memory, resident memory and descriptors per
publisher (slope of a straight line over all of them). ``benchmarks/bus.py`` measures the cost of no pool.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report
from _services import Services, descriptors, memory_mb

from cdff_common.bus import Bus, Message
from cdff_common.bus.keys import GROUND

_KEY = f"cdff/@v1/{GROUND}/bench/shared_memory"
_PUBLISHER = f"""
import time
from cdff_common.bus import Bus
with Bus.open(name="publisher", wait_s=60.0) as bus:
    for _ in range(10):
        bus.publish({_KEY!r}, bytes(100_000))
        time.sleep(0.1)
"""


def shared_mb(pid: int) -> float:
    """Return the shared memory that is mapped by a process, MB."""
    size = 0
    for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
        if "/dev/shm/" in line:
            first, last = line.split()[0].split("-")
            size += int(last, 16) - int(first, 16)
    return round(size / 1e6, 2)


def publishers(count: int, pool_mb: int) -> dict[str, Any]:
    """Return the growth of router and subscriber per publisher."""
    os.environ["CDFF_SHM_MB"] = str(pool_mb)
    received = []

    def on_message(message: Message) -> None:
        received.append(len(message.payload))

    rows = []
    with (
        tempfile.TemporaryDirectory() as folder,
        Services(Path(folder), with_dpm=False) as services,
        Bus.open(services.endpoint, name="subscriber", wait_s=60.0) as bus,
    ):
        bus.subscribe(_KEY, on_message, depth=256)
        environment = {**os.environ, "CDFF_CONNECT": services.endpoint}
        processes = {"router": services.router.pid, "subscriber": os.getpid()}
        for _ in range(count):
            subprocess.run([sys.executable, "-c", _PUBLISHER], env=environment, check=True)
            rows.append([f(pid) for pid in processes.values() for f in (shared_mb, memory_mb, descriptors)])
    slopes = np.polyfit(np.arange(len(rows)), np.array(rows, dtype=float), 1)[0]
    names = [
        f"{name}_{quantity}" for name in processes for quantity in ("shared_mb", "memory_mb", "descriptors")
    ]
    per_publisher = {name: round(float(slope), 4) for name, slope in zip(names, slopes, strict=True)}
    return {"publishers": count, "messages": len(received), "per_publisher": per_publisher}


def main() -> None:
    """Run the measurement for each size of the pool and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--publishers", type=int, default=200)
    parser.add_argument("--mb", type=int, action="append", help="size of the pool; 0: no shared memory")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    write_report({f"{mb} MB": publishers(args.publishers, mb) for mb in args.mb or (0, 16)}, args.out)


if __name__ == "__main__":
    main()
