# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The demonstration on a secured bus: TLS, certificates of all identities, and access control."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from cdff_common.bus import keys
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.e2e, pytest.mark.soak, pytest.mark.timeout(900)]

PROFILE = "rover_traverse"
#: Liveliness tokens of a system that is ready for the first sample.
SERVICES = [
    keys.alive("ground", "dpm"),
    keys.alive("ground", "orchestrator"),
    *(
        keys.alive(robot, dfpc)
        for robot in ("mana", "minnie")
        for dfpc in ("visual_odometry_sparse", "position_manager", "navigation_mapping")
    ),
]


@contextmanager
def running(command: list[str], log: Path, environment: dict[str, str]) -> Iterator[None]:
    """Run a command until the end of the block, with its output in a file."""
    with log.open("wb") as output:
        process = subprocess.Popen(command, env=environment, stdout=output, stderr=output)
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


def test_every_request_of_the_demonstration_is_answered_on_a_secured_bus(
    tmp_path: Path, traverse: Path
) -> None:
    cdff = [sys.executable, "-m", "cdff_common.cli"]
    secrets, http = tmp_path / "secrets", f"127.0.0.1:{free_port()}"
    base = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "CDFF_CONNECT": f"tls/127.0.0.1:{free_port()}",
        "CDFF_DATA_DIR": str(tmp_path / "data"),
    }

    def identity(name: str) -> dict[str, str]:
        return base | {"CDFF_IDENTITY": str(secrets / name)}

    for arguments in (
        ("init", "--profile", PROFILE),
        ("robot", "mana"),
        ("robot", "minnie"),
        ("player", "player"),
        ("client", "autonomy"),
    ):
        subprocess.run([*cdff, "keys", *arguments, "--folder", str(secrets)], env=base, check=True)
    up = [*cdff, "up", "--profile", PROFILE, "--secure", str(secrets), "--http", http]
    play = [*cdff, "play", str(traverse), "--patience", "2", "--wait-s", "120", "--wait-for", *SERVICES]
    with ExitStack() as processes:
        processes.enter_context(running(up, tmp_path / "up.log", base))
        processes.enter_context(running(play, tmp_path / "play.log", identity("player")))
        result = subprocess.run(
            [*cdff, "demo", "--attach", "--once", "--http", http],
            env=identity("autonomy"),
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "8 of 8 requests were answered as asked" in result.stdout
