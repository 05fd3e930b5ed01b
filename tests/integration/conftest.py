# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Real processes for integration tests: a router of one's own, services, and waiting with a deadline."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cdff_dev.ports import free_port

ROOT = Path(__file__).resolve().parents[2]
PLUGIN = Path(__file__).parent / "plugin"

Spawn = Callable[..., subprocess.Popen[bytes]]
Eventually = Callable[..., None]


def wait_until(condition: Callable[[], object], timeout_s: float = 10.0, what: str = "the condition") -> None:
    """Return once the condition holds; fail when time is up."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            pytest.fail(f"{what} did not hold within {timeout_s:g} s")
        time.sleep(0.02)


@pytest.fixture
def eventually() -> Eventually:
    """``eventually(condition, timeout_s=10)``: ``wait_until``."""
    return wait_until


@pytest.fixture
def endpoint() -> str:
    """A router endpoint of this test's own."""
    return f"tcp/127.0.0.1:{free_port()}"


@contextmanager
def process_starter(endpoint: str, folder: Path) -> Iterator[Spawn]:
    """``start("services.router", …) -> Popen``: a Python module as a process, ended with the context.

    The process connects to ``endpoint``, finds the test's DFPCs and writes its output to ``folder/{module}.log``.
    """
    processes: list[subprocess.Popen[bytes]] = []
    environment = {
        **os.environ,
        "CDFF_CONNECT": endpoint,
        "CDFF_LISTEN": endpoint,
        "CDFF_DATA_DIR": str(folder / "data"),
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(PLUGIN)]),
        "OMP_NUM_THREADS": "1",
        "NUMBA_NUM_THREADS": "1",
    }

    def start(module: str, *arguments: str) -> subprocess.Popen[bytes]:
        with (folder / f"{module}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                env=environment,
                stdout=log,
                stderr=log,
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
            )
        processes.append(process)
        return process

    try:
        yield start
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def spawn(endpoint: str, tmp_path: Path) -> Iterator[Spawn]:
    """``process_starter`` for one test."""
    with process_starter(endpoint, tmp_path) as start:
        yield start


@pytest.fixture
def router(spawn: Spawn) -> subprocess.Popen[bytes]:
    """A running router at ``endpoint``."""
    return spawn("services.router")
