# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff play`` on a terminal is controlled by keys, and leaves the terminal as it was."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.errors import UnavailableError
from cdff_common.types import IMUSensors, Time
from cdff_dev.logs.formats.infuse.writer import LogWriter
from tests.integration.conftest import ROOT, Eventually

pytestmark = pytest.mark.integration

S = 1_000_000_000
#: The system starts and answers slowly on a loaded machine.
PATIENCE_S = 60.0


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "a.msg"
    with LogWriter(path) as writer:
        for n in range(1000):
            t_ns = 100 * S + n * S // 10
            sample = IMUSensors(Time.from_ns(t_ns), np.ones(3), np.zeros(3), np.zeros(3))
            writer.write("/mana/imu.sample", sample, t_ns)
    return path


@contextmanager
def terminal(endpoint: str, log: Path, *options: str) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """Run ``cdff play`` on a terminal of its own session; yield the process and the end of the keyboard."""
    keyboard, end = pty.openpty()
    command = ["play", str(log), "--connect", endpoint, *options]
    # The child of the new session makes the terminal its own before it becomes cdff.
    script = (
        "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0);"
        "os.execv(sys.executable, [sys.executable, '-m', 'cdff_common.cli', *sys.argv[1:]])"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, *command],
        cwd=ROOT,
        stdin=end,
        stdout=end,
        stderr=end,
        start_new_session=True,
    )
    try:
        yield process, keyboard
    finally:
        process.kill()
        process.wait()
        os.close(end)
        os.close(keyboard)


@pytest.mark.slow
def test_keys_on_a_terminal_step_change_the_speed_pause_and_end(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    with (
        Bus.open(endpoint, name="operator", wait_s=20) as operator,
        terminal(endpoint, log, "--step") as (process, keyboard),
    ):
        shown = b""

        def status() -> dict[str, Any]:
            try:
                body = operator.call(keys.player_rpc("ground", "status"), {}, timeout_s=5).body()
            except UnavailableError:
                return {"published": 0}
            assert isinstance(body, dict)
            return body

        def is_shown(text: bytes) -> bool:
            nonlocal shown
            os.set_blocking(keyboard, False)
            with suppress(BlockingIOError):
                shown += os.read(keyboard, 4096)
            return text in shown

        settings = termios.tcgetattr(keyboard)
        eventually(lambda: status()["published"] == 1, timeout_s=PATIENCE_S)
        eventually(lambda: is_shown(b"space or p: pause or resume"), timeout_s=PATIENCE_S)
        os.write(keyboard, b" s\x1b[C")  # three keys at once: each is a step
        eventually(lambda: status()["published"] == 4, timeout_s=PATIENCE_S)
        assert status()["paused"] is True
        os.write(keyboard, b"++-\x1b[A?\x1b[5~")
        eventually(lambda: status()["speed"] == 4.0, timeout_s=PATIENCE_S)
        eventually(lambda: is_shown(b"paused at 0.300 s, speed 4"), timeout_s=PATIENCE_S)
        os.write(keyboard, b">")
        eventually(lambda: status()["now_ns"] == 110 * S + 3 * S // 10, timeout_s=PATIENCE_S)
        os.write(keyboard, b"p")
        eventually(lambda: status()["published"] > 6, timeout_s=PATIENCE_S)
        assert status()["paused"] is False
        os.write(keyboard, b"q")
        assert process.wait(PATIENCE_S) == 0
        assert termios.tcgetattr(keyboard) == settings


def test_a_player_without_a_terminal_plays_on_at_its_speed(
    router: subprocess.Popen[bytes], endpoint: str, log: Path, eventually: Eventually
) -> None:
    command = [sys.executable, "-m", "cdff_common.cli", "play", str(log), "--connect", endpoint]
    with Bus.open(endpoint, name="operator", wait_s=20) as operator:
        process = subprocess.Popen(
            [*command, "--speed", "3"], cwd=ROOT, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        try:

            def published() -> int:
                try:
                    body = operator.call(keys.player_rpc("ground", "status"), {}, timeout_s=5).body()
                except UnavailableError:
                    return 0
                assert body["speed"] == 3.0
                return int(body["published"])

            eventually(lambda: published() > 3, timeout_s=PATIENCE_S)
        finally:
            process.terminate()
            _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert b"space or p" not in errors
