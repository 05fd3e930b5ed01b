# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare calls over a secured bus (`cdff up --secure`) with calls over an open one.

    python benchmarks/bus_security.py [--out FILE] [--scale X] [--repeats N]

Two routers run: one without identities, one with certificates on both ends, an access-control list and its
record of refusals. A robot answers a small query with 64 bytes or 1 MB on both; a client asks both in turn,
in one process. Shared memory is off. Medians of all calls and their ratio are reported, and the same of the
10th percentiles and of the CPU time of all three processes, which other load on the machine affects least.
Some processes are slower than others of the same program for their whole life, so that this is repeated with
new processes; the report has the median of each value over the repetitions, and all ratios.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from _report import write_report

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.interfaces.profile import Profile
from cdff_dev.ports import free_port
from services.keys.access_control import Kind
from services.keys.mission_keys import MissionKeys

SIZES = {"64 B": 64, "1 MB": 1_000_000}
ROUNDS = {"64 B": 2000, "1 MB": 240}
BATCH = 8
RATIOS = ("ratio", "p10_ratio", "cpu_ratio")
KEY = keys.dfpc_rpc("mana", "benchmark", "call/read")


def answer() -> None:
    """Answer calls with the requested number of bytes until stdin is closed."""
    payloads = {size: os.urandom(size) for size in SIZES.values()}

    def on_request(request: Request) -> Reply:
        return Reply(payloads[int(request.parameters["n"])])

    with Bus.open(name="answer", wait_s=20.0) as bus:
        bus.serve(KEY, on_request)
        bus.declare_alive("mana", "benchmark")
        sys.stdin.read()


def identity_of(folder: Path | None, name: str) -> dict[str, str]:
    """Return the environment of an identity; none on the open bus."""
    return {} if folder is None else {"CDFF_IDENTITY": str(folder / name)}


class Deployment:
    """A router and an answering process, open or with the identities of a folder."""

    def __init__(self, folder: Path | None) -> None:
        os.environ.pop("CDFF_IDENTITY", None)  # of the last deployment
        endpoint = f"{'tcp' if folder is None else 'tls'}/127.0.0.1:{free_port()}"
        common = {**os.environ, "CDFF_SHM_MB": "0", "CDFF_CONNECT": endpoint, "CDFF_LISTEN": endpoint}
        self._router = subprocess.Popen(
            [sys.executable, "-m", "services.router"],
            env=common | identity_of(folder, "ground"),
            stderr=subprocess.DEVNULL,
        )
        self._robot = subprocess.Popen(
            [sys.executable, __file__, "--answer"],
            env=common | identity_of(folder, "mana"),
            stdin=subprocess.PIPE,
        )
        os.environ.update(CDFF_SHM_MB="0", **identity_of(folder, "autonomy"))
        self.bus = Bus.open(endpoint, name="client", wait_s=20.0)
        while not self.bus.alive(keys.alive("mana", "benchmark")):
            time.sleep(0.1)

    def call_us(self, size: int) -> float:
        """Return the time of one call, microseconds."""
        start_s = time.perf_counter()
        reply = self.bus.call(KEY, {"n": size}, timeout_s=10.0)
        elapsed_s = time.perf_counter() - start_s
        assert len(reply.payload) == size
        return elapsed_s * 1e6

    def cpu_us(self) -> float:
        """Return the CPU time of router, robot and this process since their start, microseconds."""
        return sum(map(_cpu_us, (self._router.pid, self._robot.pid, os.getpid())))

    def close(self) -> None:
        """End the processes."""
        self.bus.close()
        assert self._robot.stdin is not None
        self._robot.stdin.close()
        self._robot.wait(10)
        self._router.terminate()
        self._router.wait(10)


def _cpu_us(pid: int) -> float:
    """Return the CPU time of the threads of a process, microseconds, with the resolution of the scheduler."""
    nanoseconds = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError):  # the thread has ended
            nanoseconds += int((task / "schedstat").read_text().split()[0])
    return nanoseconds / 1e3


def measure(deployments: dict[str, Deployment], size: int, rounds: int) -> dict[str, float]:
    """Alternate batches of both; return the medians and their ratio."""
    times: dict[str, list[float]] = {name: [] for name in deployments}
    cpu_us = dict.fromkeys(deployments, 0.0)
    for deployment in deployments.values():
        deployment.call_us(size)
    for batch in range(max(rounds // BATCH, 2)):
        for name in list(deployments)[:: 1 if batch % 2 else -1]:
            before_us = deployments[name].cpu_us()
            times[name] += [deployments[name].call_us(size) for _ in range(BATCH)]
            cpu_us[name] += deployments[name].cpu_us() - before_us
    medians = {name: statistics.median(values) for name, values in times.items()}
    least = {name: statistics.quantiles(values, n=10)[0] for name, values in times.items()}
    return {
        **{f"{name}_us": round(median, 1) for name, median in medians.items()},
        "ratio": round(medians["secured"] / medians["open"], 3),
        **{f"{name}_p10_us": round(value, 1) for name, value in least.items()},
        "p10_ratio": round(least["secured"] / least["open"], 3),
        **{f"{name}_cpu_us": round(used_us / len(times[name]), 1) for name, used_us in cpu_us.items()},
        "cpu_ratio": round(cpu_us["secured"] / cpu_us["open"], 3),
        "calls": len(times["open"]),
    }


def run(secrets: Path, scale: float) -> dict[str, dict[str, float]]:
    """Measure with new processes; return the values by size."""
    deployments = {"open": Deployment(None), "secured": Deployment(secrets)}
    try:
        return {
            name: measure(deployments, size, max(int(ROUNDS[name] * scale), 16))
            for name, size in SIZES.items()
        }
    finally:
        for deployment in deployments.values():
            deployment.close()


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--answer", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--scale", type=float, default=1.0, help="factor on the number of calls")
    parser.add_argument("--repeats", type=int, default=5, help="number of repetitions with new processes")
    args = parser.parse_args()
    if args.answer:
        answer()
        return
    with tempfile.TemporaryDirectory() as folder:
        mission = MissionKeys.create(
            Path(folder) / "secrets",
            Profile.model_validate({"name": "bench", "robots": [{"id": "mana"}]}),
            (),
        )
        mission.issue("mana", Kind.ROBOT)
        mission.issue("autonomy", Kind.CLIENT)
        results = [run(mission.folder, args.scale) for _ in range(args.repeats)]
    calls = {
        size: {name: round(statistics.median(r[size][name] for r in results), 3) for name in results[0][size]}
        | {f"all_{name}s": [r[size][name] for r in results] for name in RATIOS}
        for size in SIZES
    }
    report = {
        "benchmark": "bus_security",
        "zenoh": version("eclipse-zenoh"),
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "load_1min": round(os.getloadavg()[0], 1),
        "calls": calls,
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
