# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Router and DPM as processes for benchmarks, and the memory, descriptors and CPU time of processes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cdff_dev.ports import free_port

ROOT = Path(__file__).resolve().parent.parent
_SLOPE_PERIOD_S = 1.0
_CLOCK_TICKS = os.sysconf("SC_CLK_TCK")


class Services:
    """A router and, unless ``with_dpm`` is False, a DPM in a folder, while the context is open."""

    def __init__(self, folder: Path, *, with_dpm: bool = True) -> None:
        self.folder = folder
        self._with_dpm = with_dpm
        self.port, self.endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
        self.http = f"http://127.0.0.1:{self.port}"
        self._environment = {
            **os.environ,
            "CDFF_CONNECT": self.endpoint,
            "CDFF_LISTEN": self.endpoint,
        }
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        self.router = self.start("-m", "services.router")
        if not self._with_dpm:
            return self
        arguments = ("--data-dir", str(self.folder / "data"), "--http", f"127.0.0.1:{self.port}")
        self.dpm = self.start("-m", "services.dpm", *arguments)
        until_s = time.monotonic() + 180.0
        while time.monotonic() < until_s:
            try:
                urllib.request.urlopen(f"{self.http}/readyz", timeout=2.0).read()
                return self
            except OSError:
                time.sleep(0.2)
        raise TimeoutError(f"the DPM does not answer; see {self.folder}/services.log")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in reversed(self._processes):
            process.terminate()
        for process in self._processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()

    def start(self, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
        """Start a Python process that writes its log to ``services.log``."""
        with (self.folder / "services.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, *arguments],
                env=self._environment,
                cwd=ROOT,
                stderr=log,
                **{"stdout": log, **options},
            )
        self._processes.append(process)
        return process


class PeakMemory:
    """Thread that samples the resident memory of a process while the context is open.

    Descriptors and threads are sampled too, once in ``_SLOPE_PERIOD_S``.
    """

    def __init__(self, pid: int, period_s: float = 0.05) -> None:
        self._pid, self._period_s = pid, period_s
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._samples: list[tuple[float, float, int, int]] = []
        self.peak_mb = 0.0

    def slopes_per_hour(self) -> dict[str, float]:
        """Return the slopes of straight lines through the second half of the samples, per hour.

        The first half is excluded, because caches fill in it.
        """
        rows = np.array(self._samples[len(self._samples) // 2 :])
        if len(rows) < 3:
            return {}
        slopes = np.polyfit(rows[:, 0] / 3600.0, rows[:, 1:], 1)[0]
        names = ("memory_mb", "descriptors", "threads")
        return {name: round(float(slope), 2) for name, slope in zip(names, slopes, strict=True)}

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        next_s = time.monotonic()
        while not self._ended.wait(self._period_s):
            resident_mb, now_s = memory_mb(self._pid), time.monotonic()
            self.peak_mb = max(self.peak_mb, resident_mb)
            if now_s >= next_s:
                next_s = now_s + _SLOPE_PERIOD_S
                self._samples.append((now_s, resident_mb, descriptors(self._pid), threads(self._pid)))


def memory_mb(pid: int) -> float:
    """Return the resident memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


def descriptors(pid: int) -> int:
    """Return the number of open descriptors of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def threads(pid: int) -> int:
    """Return the number of threads of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


def cpu_s(pid: int) -> float:
    """Return the CPU time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _CLOCK_TICKS


def fetch(url: str, timeout_s: float = 300.0) -> tuple[int, int]:
    """Return the status and the number of bytes of the answer to a GET, read in parts."""
    try:
        with urllib.request.urlopen(url, timeout=timeout_s) as answer:
            return answer.status, sum(len(part) for part in iter(lambda: answer.read(1 << 16), b""))
    except urllib.error.HTTPError as error:
        return error.code, len(error.read())
