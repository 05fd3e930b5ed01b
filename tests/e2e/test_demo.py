# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff demo`` in a process of its own."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400)]


def demo(*arguments: str) -> subprocess.Popen[str]:
    addresses = ["--connect", f"tcp/127.0.0.1:{free_port()}", "--http", f"127.0.0.1:{free_port()}"]
    return subprocess.Popen(
        [sys.executable, "-m", "cdff_common.cli", "demo", *addresses, *arguments],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-028")
def test_every_request_of_the_simulated_traverse_is_satisfied(traverse: Path) -> None:
    process = demo("--once")
    output, _ = process.communicate(timeout=380)
    assert process.returncode == 0, output
    assert "8 of 8 requests were answered as asked" in output


@pytest.mark.slow
def test_the_demonstration_answers_every_request_on_a_recorded_drive(
    real_data: Callable[[str], Path],
) -> None:
    process = demo("--once", "--log", str(real_data("kitti_stereo/KITTI_sequence_1")))
    output, _ = process.communicate(timeout=380)
    assert process.returncode == 0, output
    assert "4 of 4 requests were answered as asked" in output


@pytest.mark.slow
def test_ctrl_c_ends_every_process_within_five_seconds(traverse: Path) -> None:
    with demo() as process:  # closes the pipe and waits, also after a failure
        assert process.stdout is not None
        try:
            ready = (re.search(r"(\d+) of (\d+) ready", line) for line in process.stdout)
            assert any(match and match[1] == match[2] for match in ready)
            processes = psutil.Process(process.pid).children(recursive=True)
            assert len(processes) > 8
            process.send_signal(signal.SIGINT)
            process.wait(5.0)
        finally:
            process.kill()
    survivors = [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
    assert not survivors, [p.cmdline() for p in survivors]


def test_an_address_in_use_is_reported_as_an_error() -> None:
    import socket

    with socket.socket() as used_socket:
        used_socket.bind(("127.0.0.1", 0))
        used_socket.listen()
        process = subprocess.run(
            [
                sys.executable,
                "-m",
                "cdff_common.cli",
                "demo",
                "--once",
                "--http",
                f"127.0.0.1:{used_socket.getsockname()[1]}",
                "--connect",
                f"tcp/127.0.0.1:{free_port()}",
            ],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
    assert process.returncode == 1
    assert "is in use" in process.stderr
