# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A scheduler of Dask with two workers as processes, on loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from cdff_dev.ports import free_port

_ROOT = Path(__file__).resolve().parents[2]


class DaskCluster:
    """A running scheduler with its workers.

    Parameters
    ----------
    folder : Path
        Working folder of the processes.
    workers : int

    Attributes
    ----------
    address : str
    """

    def __init__(self, folder: Path, workers: int = 2) -> None:
        port = free_port()
        self.address = f"tcp://127.0.0.1:{port}"
        self._folder = folder
        self._environment = {
            **os.environ,
            "PYTHONPATH": str(_ROOT),
            "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "10s",
        }
        self._scheduler = self._start(
            "dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"
        )
        options = ("--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--no-nanny")
        self._workers = [
            self._start(
                "dask_worker", self.address, *options, "--local-directory", str(folder / f"worker_{i}")
            )
            for i in range(workers)
        ]

    def kill_worker(self) -> None:
        """Kill the first worker with the commands that it executes."""
        os.killpg(self._workers[0].pid, signal.SIGKILL)

    def close(self) -> None:
        """Kill all processes."""
        for process in (*self._workers, self._scheduler):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def _start(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *arguments]
        with (self._folder / "dask.log").open("ab") as log:
            return subprocess.Popen(
                command,
                env=self._environment,
                cwd=self._folder,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
