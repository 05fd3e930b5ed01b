# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Searches over HTTP in one store by one, two and four DPM processes on one address.

Clients search regions of a store on PostgreSQL with payloads in an object store, all at once, each on a
connection of its own. The servers are started here (``make peers``), on the same machine as the clients. The
last rows have the embedded store. CPU times are those of all processes for one search.

    python benchmarks/dpm_workers.py [--products N] [--seconds S] [--clients 1,32] [--processes 1,2,4]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import psutil

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]

from dpm import SIDE_M, Figures, fill, show  # noqa: E402

from cdff_common.clock import ManualClock  # noqa: E402
from cdff_dev.ports import free_port  # noqa: E402
from dpm_store import open_store  # noqa: E402
from tests.integration.conftest import process_starter, wait_until  # noqa: E402
from tests.support import postgresql, seaweedfs  # noqa: E402

#: Side of the searched regions, metres.
_SIDE_M = 20.0


class Load:
    """Clients on connections of their own that search without a pause."""

    def __init__(self, port: int, seconds: float) -> None:
        self._port, self._end_s = port, time.monotonic() + seconds
        self._rng = np.random.default_rng(1)
        self.latencies_s: list[float] = []

    async def run(self, clients: int) -> None:
        """Search until the time is over."""
        await asyncio.gather(*(self._client() for _ in range(clients)))

    def _request(self) -> bytes:
        x, y = self._rng.uniform(0.0, SIDE_M - _SIDE_M, 2)
        box = f"{x:.2f},{y:.2f},{x + _SIDE_M:.2f},{y + _SIDE_M:.2f}"
        path = f"/api/v1/products?frame=mana%2Fmap&region=bbox:{box}&limit=20"
        return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()

    async def _client(self) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        while time.monotonic() < self._end_s:
            started_s = time.perf_counter()
            writer.write(self._request())
            header = await reader.readuntil(b"\r\n\r\n")
            if not header.startswith(b"HTTP/1.1 200"):
                raise RuntimeError(header.decode())
            fields = dict(line.split(b": ", 1) for line in header.lower().split(b"\r\n") if b": " in line)
            await reader.readexactly(int(fields[b"content-length"]))
            self.latencies_s.append(time.perf_counter() - started_s)
        writer.close()


def cpu_s(processes: list[psutil.Process]) -> float:
    """Return the CPU time of processes and of the children that they have now or have waited for."""
    total = 0.0
    for process in processes:
        for member in (process, *process.children(recursive=True)):
            times = member.cpu_times()
            total += times.user + times.system
    return total


def measure(port: int, clients: int, seconds: float, processes: list[psutil.Process]) -> Figures:
    """Return the figures of a load."""
    asyncio.run(Load(port, 1.0).run(clients))  # connections and caches
    before_s, own_s, load = cpu_s(processes), time.process_time(), Load(port, seconds)
    started_s = time.monotonic()
    asyncio.run(load.run(clients))
    elapsed_s, count = time.monotonic() - started_s, len(load.latencies_s)
    latencies_ms = 1e3 * np.array(load.latencies_s)
    return {
        "searches_per_s": round(count / elapsed_s, 1),
        "p50_ms": round(float(np.median(latencies_ms)), 2),
        "p95_ms": round(float(np.percentile(latencies_ms, 95)), 2),
        "cpu_ms": round(1e3 * (cpu_s(processes) - before_s) / count, 2),
        "client_cpu_ms": round(1e3 * (time.process_time() - own_s) / count, 2),
    }


def serve(
    stack: ExitStack, folder: Path, store: str, workers: int
) -> tuple[int, list[subprocess.Popen[bytes]]]:
    """Start a router, a DPM and workers; return the port of HTTP and the processes that answer."""
    port, endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    variables = {"CDFF_STORE": store} if store else {}
    folder.mkdir(exist_ok=True)
    start = stack.enter_context(process_starter(endpoint, folder, **variables))
    start("services.router")
    sharing = ["--share-port"] if store else []
    address = f"127.0.0.1:{port}"
    processes = [
        start("services.dpm", "--http", address, *sharing),
        *(start("services.dpm", "--http", address, "--worker", str(n + 1)) for n in range(workers)),
    ]
    log = folder / "services.dpm.log"
    wait_until(lambda: log.read_text().count('"serving"') > workers, 120, "the processes serve")
    return port, processes


def main() -> None:
    """Measure, print a table, and write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--products", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--clients", default="1,32")
    parser.add_argument("--processes", default="1,2,4")
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    clients = [int(n) for n in args.clients.split(",")]
    results: dict[str, Any] = {"about": {"products": args.products, "cpus": os.cpu_count()}}
    with tempfile.TemporaryDirectory() as base, ExitStack() as servers:
        folder = Path(base)
        servers.enter_context(seaweedfs.object_server())
        cluster = servers.enter_context(postgresql.cluster())
        cluster.execute("CREATE DATABASE store")
        store = cluster.url("store", folder / "server", f"s3://{seaweedfs.BUCKET}/store")
        with open_store(store, ManualClock(1_000_000_000)) as opened:
            fill(opened, args.products)
        database = psutil.Process(int((cluster.folder / "data" / "postmaster.pid").read_text().split()[0]))
        for count in (int(n) for n in args.processes.split(",")):
            with ExitStack() as stack:
                port, processes = serve(stack, folder / f"processes_{count}", store, count - 1)
                counted = [database, *(psutil.Process(process.pid) for process in processes)]
                for n in clients:
                    name = f"{count} processes, {n} clients"
                    results[name] = show(name, measure(port, n, args.seconds, counted))
        embedded = folder / "embedded" / "data"
        with open_store(f"sqlite:///{embedded}", ManualClock(1_000_000_000)) as opened:
            fill(opened, args.products)
        with ExitStack() as stack:
            port, processes = serve(stack, folder / "embedded", "", 0)
            for n in clients:
                name = f"embedded, {n} clients"
                counted = [psutil.Process(process.pid) for process in processes]
                results[name] = show(name, measure(port, n, args.seconds, counted))
        results["about"]["load"] = os.getloadavg()[0]
    show("about", results["about"])
    if args.out is not None:
        args.out.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
