# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare the bus of CDFF with raw Zenoh: publications and requests through one router.

    python benchmarks/bus.py [--out FILE] [--scale X]

For each payload size, with shared memory on and off, rounds of both alternate in the same two processes; the
median over all round trips is reported. Publication: a payload is put; the callback in the other process
copies it and answers with one byte. Request: a small query is answered with the payload, which the client
copies. Neither side hashes or decodes. The latency includes two process switches on a shared machine; compare
ratios, not absolute times.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import socket
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import zenoh
from _report import write_report

from cdff_common.bus import Bus, Message, Qos, Reply, Request
from cdff_common.bus.session import open_client

SIZES = {"64 B": 64, "100 kB": 100_000, "1 MB": 1_000_000, "10 MB": 10_000_000}
ROUNDS = {"64 B": 400, "100 kB": 200, "1 MB": 80, "10 MB": 16}
BATCH = 8


def echo() -> None:
    """Answer pings with one byte, and queries with the requested number of bytes, until stdin is closed."""
    raw, bus = open_client(None, 10.0), Bus.open(name="echo", wait_s=10.0)
    payloads = {size: os.urandom(size) for size in SIZES.values()}

    def on_raw(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        raw.put("bench/raw/pong", b"1", priority=zenoh.Priority.DATA_HIGH, express=True)

    def on_message(_message: Message) -> None:
        bus.publish("bench/ours/pong", b"1", qos=Qos.POSE)

    def on_raw_query(query: zenoh.Query) -> None:
        with query:
            query.reply("bench/raw/get", payloads[int(str(query.parameters).partition("=")[2])])

    def on_request(request: Request) -> Reply:
        return Reply(payloads[int(request.parameters["n"])])

    declarations = [
        raw.declare_subscriber("bench/raw/ping", on_raw),
        raw.declare_queryable("bench/raw/get", on_raw_query),
    ]
    bus.subscribe("bench/ours/ping", on_message)
    bus.serve("bench/ours/get", on_request)
    print("ready", flush=True)
    sys.stdin.read()
    for declaration in declarations:
        declaration.undeclare()
    bus.close()
    raw.close()


class Pinger:
    """Round trips over raw Zenoh and over the bus, from the client process."""

    def __init__(self) -> None:
        self.raw, self.bus = open_client(None, 10.0), Bus.open(name="ping", wait_s=10.0)
        self._pong = threading.Event()
        self._subscriber = self.raw.declare_subscriber("bench/raw/pong", lambda _s: self._pong.set())
        self.bus.subscribe("bench/ours/pong", lambda _m: self._pong.set())
        self._querier = self.raw.declare_querier(
            "bench/raw/get",
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=10.0,
            express=True,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
        )

    def raw_publish(self, payload: bytes) -> None:
        """Make a round trip over raw Zenoh."""
        self._pong.clear()
        self.raw.put("bench/raw/ping", payload, congestion_control=zenoh.CongestionControl.BLOCK)
        assert self._pong.wait(10)

    def bus_publish(self, payload: bytes) -> None:
        """Make a round trip over the bus of CDFF."""
        self._pong.clear()
        self.bus.publish("bench/ours/ping", payload)
        assert self._pong.wait(10)

    def raw_request(self, payload: bytes) -> None:
        """Send a query over raw Zenoh."""
        for reply in self._querier.get(parameters=f"n={len(payload)}"):
            assert reply.ok is not None
            assert len(reply.ok.payload.to_bytes()) == len(payload)

    def bus_request(self, payload: bytes) -> None:
        """Send a request over the bus of CDFF."""
        assert len(self.bus.call("bench/ours/get", {"n": len(payload)}, timeout_s=10.0).payload) == len(
            payload
        )

    def close(self) -> None:
        """Close both sessions."""
        self._querier.undeclare()
        self._subscriber.undeclare()
        self.bus.close()
        self.raw.close()


def measure(
    raw_call: Callable[[bytes], None], bus_call: Callable[[bytes], None], payload: bytes, rounds: int
) -> dict[str, float]:
    """Alternate batches of both; return medians in microseconds, their ratio, and CPU time per call."""
    times: tuple[list[float], list[float]] = ([], [])
    cpu = [0.0, 0.0]
    for call in (raw_call, bus_call):
        for _ in range(3):
            call(payload)
    for batch in range(max(rounds // BATCH, 2)):
        for index in (0, 1) if batch % 2 else (1, 0):
            call = (raw_call, bus_call)[index]
            cpu_s = time.process_time()
            for _ in range(BATCH):
                start = time.perf_counter()
                call(payload)
                times[index].append((time.perf_counter() - start) * 1e6)
            cpu[index] += time.process_time() - cpu_s
    raw_us, bus_us = (statistics.median(t) for t in times)
    return {
        "raw_us": round(raw_us, 1),
        "ours_us": round(bus_us, 1),
        "ratio": round(bus_us / raw_us, 3),
        "raw_cpu_us": round(cpu[0] / len(times[0]) * 1e6, 1),
        "ours_cpu_us": round(cpu[1] / len(times[1]) * 1e6, 1),
        "round_trips": len(times[0]),
    }


def free_endpoint() -> str:
    """Return an endpoint on which no process listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def run(shm_mb: int, scale: float) -> dict[str, dict[str, dict[str, float]]]:
    """Measure all sizes once, with a new router and echo process."""
    os.environ.update(CDFF_SHM_MB=str(shm_mb), CDFF_CONNECT=free_endpoint())
    router = subprocess.Popen(
        [sys.executable, "-m", "services.router", "--listen", os.environ["CDFF_CONNECT"]],
        stderr=subprocess.DEVNULL,
    )
    echo_process = subprocess.Popen(
        [sys.executable, __file__, "--echo"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert echo_process.stdout is not None
        assert echo_process.stdout.readline() == "ready\n"
        pinger = Pinger()
        time.sleep(0.5)  # the declarations must reach the router
        results: dict[str, dict[str, dict[str, float]]] = {"publish": {}, "request": {}}
        for name, size in SIZES.items():
            payload = os.urandom(size)
            rounds = max(int(ROUNDS[name] * scale), 16)
            results["publish"][name] = measure(pinger.raw_publish, pinger.bus_publish, payload, rounds)
            results["request"][name] = measure(pinger.raw_request, pinger.bus_request, payload, rounds)
        pinger.close()
        return results
    finally:
        assert echo_process.stdin is not None
        echo_process.stdin.close()
        echo_process.wait(10)
        router.terminate()
        router.wait(10)


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--echo", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--scale", type=float, default=1.0, help="factor on the number of round trips")
    args = parser.parse_args()
    if args.echo:
        echo()
        return
    report = {
        "benchmark": "bus",
        "hashing": "none on either side",
        "zenoh": version("eclipse-zenoh"),
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "shared_memory_on": run(256, args.scale),
        "shared_memory_off": run(0, args.scale),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
