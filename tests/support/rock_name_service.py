# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The name service of omniORB, in which tasks of ROCK register (``make peers``: build/rock-peers)."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cdff_dev.ports import free_port

PEERS = Path(__file__).resolve().parents[2] / "build" / "rock-peers" / "bin"


@contextmanager
def name_service(folder: Path) -> Iterator[int]:
    """Yield the port of a name service."""
    port = free_port()
    folder.mkdir()
    command = [
        PEERS / "omniNames",
        "-start",
        str(port),
        "-logdir",
        folder,
        "-ORBendPoint",
        f"giop:tcp:127.0.0.1:{port}",
    ]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        yield port
    finally:
        os.killpg(process.pid, signal.SIGKILL)  # the program is a script that starts another
        process.wait()
