# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the HTTP server of the DPM with idle connections, broken uploads and idle event streams.

    python benchmarks/dpm_connections.py [--idle 1000] [--out FILE]

- ``idle``: time of 200 calls of ``/api/v1/alarms``, without and with silent connections.
- ``uploads``: memory while eight uploads of 100 MB are sent all but their last byte, after they are broken
  off, and the lines of the log that they cause.
- ``streams``: CPU time of the process with 200 idle event streams.
"""

from __future__ import annotations

import argparse
import http.client
import json
import socket
import statistics
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from _report import write_report
from _services import PeakMemory, Services, cpu_s, descriptors, fetch, memory_mb

UPLOADS, UPLOAD_BYTES = 8, 100_000_000
STREAMS = 200
_SETTLE_S = 7.0
_STREAMING_S = 20.0


def call_times(services: Services, calls: int = 200) -> dict[str, Any]:
    """Return the time of calls, each over its own connection, milliseconds, and the number refused."""
    times_ms, refused = [], 0
    for _ in range(calls):
        start_s = time.perf_counter()
        try:
            status, _size = fetch(f"{services.http}/api/v1/alarms", 5.0)
            refused += status != 200
        except (OSError, http.client.HTTPException):
            refused += 1
        times_ms.append((time.perf_counter() - start_s) * 1e3)
        time.sleep(0.01)
    times_ms.sort()
    return {
        "p50_ms": round(statistics.median(times_ms), 1),
        "p99_ms": round(times_ms[int(len(times_ms) * 0.99)], 1),
        "most_ms": round(times_ms[-1], 1),
        "refused": refused,
    }


def idle(services: Services, count: int) -> dict[str, Any]:
    """Return the time of calls without and with silent connections."""
    alone = call_times(services)
    address = ("127.0.0.1", services.port)
    sockets = [socket.create_connection(address, timeout=10.0) for _ in range(count)]
    time.sleep(1.0)
    try:
        return {
            "alone": alone,
            "idle": count,
            "with_idle": call_times(services),
            "descriptors": descriptors(services.dpm.pid),
        }
    finally:
        for connection in sockets:
            connection.close()


def uploads(services: Services) -> dict[str, Any]:
    """Return the memory during and after uploads that are broken off."""
    pid, log = services.dpm.pid, services.folder / "services.log"
    start_mb, lines = memory_mb(pid), len(log.read_text().splitlines())
    header = json.dumps({"id": "x"})
    head = (
        "POST /api/v1/products?robot=mana&dfpc=load&port=dem&product=dem HTTP/1.1\r\n"
        f"Host: 127.0.0.1:{services.port}\r\nCDFF-Header: {header}\r\n"
        "Content-Type: application/vnd.cdff+uper;ElevationMap/1\r\n"
        f"Content-Length: {UPLOAD_BYTES}\r\n\r\n"
    ).encode()
    connections = []

    def send() -> None:
        connection = socket.create_connection(("127.0.0.1", services.port), timeout=60.0)
        connections.append(connection)
        try:
            connection.sendall(head)
            for _ in range(UPLOAD_BYTES // 1_000_000 - 1):
                connection.sendall(bytes(1_000_000))
            connection.sendall(bytes(999_999))
        except OSError:  # refused
            return

    with PeakMemory(pid) as peak:
        senders = [threading.Thread(target=send) for _ in range(UPLOADS)]
        for sender in senders:
            sender.start()
        for sender in senders:
            sender.join()
        time.sleep(1.0)
        for connection in connections:
            connection.close()
        time.sleep(_SETTLE_S)
    return {
        "start_mb": start_mb,
        "peak_mb": peak.peak_mb,
        "after_mb": memory_mb(pid),
        "log_lines": len(log.read_text().splitlines()) - lines,
    }


def streams(services: Services) -> dict[str, Any]:
    """Return the CPU time of the process per second with idle event streams."""
    request = f"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1:{services.port}\r\n\r\n".encode()
    sockets = []
    for _ in range(STREAMS):
        connection = socket.create_connection(("127.0.0.1", services.port), timeout=10.0)
        connection.sendall(request)
        sockets.append(connection)
    opened = sum(b"200" in connection.recv(64) for connection in sockets)
    time.sleep(2.0)
    start_s, start_cpu_s = time.monotonic(), cpu_s(services.dpm.pid)
    time.sleep(_STREAMING_S)
    cpu_fraction = (cpu_s(services.dpm.pid) - start_cpu_s) / (time.monotonic() - start_s)
    for connection in sockets:
        connection.close()
    return {"streams": opened, "cpu_percent": round(100.0 * cpu_fraction, 1)}


def main() -> None:
    """Run the measurements and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--idle", type=int, default=1000)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, Services(Path(folder)) as services:
        time.sleep(5.0)  # the DPM loads its codecs
        report = {"idle": idle(services, args.idle), "uploads": uploads(services)}
        report["streams"] = streams(services)
    write_report(report, args.out)


if __name__ == "__main__":
    main()
