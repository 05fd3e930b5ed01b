# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of integration tests: a router and services as real processes, and waiting with a deadline."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from cdff_dev.ports import free_port

ROOT = Path(__file__).resolve().parents[2]
PLUGIN = Path(__file__).parent / "plugin"

Spawn = Callable[..., subprocess.Popen[bytes]]
Eventually = Callable[..., None]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests with a router, so that they run one after the other and at normal priority."""
    for item in items:
        if item.path.parent == Path(__file__).parent and "endpoint" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.integration)


def wait_until(condition: Callable[[], object], timeout_s: float = 10.0, what: str = "the condition") -> None:
    """Wait until the condition holds; fail after ``timeout_s``."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            pytest.fail(f"{what} did not hold within {timeout_s:g} s")
        time.sleep(0.02)


@pytest.fixture
def eventually() -> Eventually:
    """``wait_until`` as a fixture: ``eventually(condition, timeout_s=10)``."""
    return wait_until


@pytest.fixture
def endpoint() -> str:
    """The endpoint of this test's router."""
    return f"tcp/127.0.0.1:{free_port()}"


@contextmanager
def process_starter(endpoint: str, folder: Path, **variables: str) -> Iterator[Spawn]:
    """Yield ``start("services.router", …) -> Popen``, which runs a Python module until the context ends.

    The process connects to ``endpoint``, can load the DFPCs of ``plugin``, has the environment ``variables``
    and writes its output to ``folder/{module}.log``.
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
        **variables,
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
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """The data folder of spawned processes on a file system of 100 MB."""
    disk = tmp_path / "data"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=100m", "tmpfs", str(disk)]
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"a small file system cannot be mounted here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def fill_disk(folder: Path) -> Path:
    """Fill the file system of a folder with one file, and return it."""
    ballast = folder / "ballast"
    with suppress(OSError), ballast.open("wb", buffering=0) as file:
        while file.write(bytes(1 << 16)):
            pass
    with suppress(OSError), ballast.open("ab", buffering=0) as file:
        while file.write(bytes(1)):
            pass
    return ballast


@pytest.fixture
def router(spawn: Spawn) -> subprocess.Popen[bytes]:
    """A running router at ``endpoint``."""
    return spawn("services.router")
