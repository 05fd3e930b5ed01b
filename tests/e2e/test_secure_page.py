# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the page on a secured mission work as printed, in their order, except containers."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from cdff_common.bus.session import SECURE_ENDPOINT
from cdff_common.output import make_folder
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(600)]

PAGE = (ROOT / "docs" / "how-to" / "secure-a-mission.md").read_text(encoding="utf-8")


def command_lines() -> list[str]:
    """Return the commands of the page without those of containers and of a second machine."""
    blocks = [b for b in re.findall(r"^```\n(.*?)^```", PAGE, re.M | re.S) if "docker compose" not in b]
    return [line for block in blocks for line in block.splitlines()]


class Shell:
    """Shell in which the lines of the page run, one after the other, on free ports."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._router, self._http = folder, free_port(), free_port()
        self._environment = {**os.environ, "PYTHONPATH": os.environ.get("PYTHONPATH", str(ROOT))}
        self._environment["CDFF_CONNECT"] = f"tls/127.0.0.1:{self._router}"
        self._environment["CDFF_DATA_DIR"] = str(make_folder(folder / "data"))
        self.mission: subprocess.Popen[bytes] | None = None

    def run(self, line: str) -> str:
        """Run one line and return its output; ``cdff up`` is left running."""
        words = shlex.split(line.replace("127.0.0.1:8080", f"127.0.0.1:{self._http}"))
        if words[0] == "export":
            name, _, value = words[1].partition("=")
            self._environment[name] = value
            return ""
        command = [sys.executable, "-m", "cdff_common.cli", *words[1:]] if words[0] == "cdff" else words
        if words[:2] == ["cdff", "up"]:
            with (self.folder / "up.log").open("wb") as log:
                self.mission = subprocess.Popen(
                    command, cwd=self.folder, env=self._environment, stdout=log, stderr=log
                )
            return ""
        result = self._run_until_ready(command)
        assert result.returncode == 0, f"{line}: {result.stderr}"
        return result.stdout

    def _run_until_ready(self, command: list[str]) -> subprocess.CompletedProcess[str]:
        """Run a command, and again while the mission starts or its router restarts."""
        until_s = time.monotonic() + (60 if self.mission is not None else 0)
        while True:
            result = subprocess.run(
                command,
                cwd=self.folder,
                env=self._environment,
                capture_output=True,
                text=True,
                timeout=120,
                check=False,
            )
            if result.returncode == 0 or time.monotonic() > until_s:
                return result

    def close(self) -> None:
        """End the mission."""
        if self.mission is not None:
            self.mission.send_signal(signal.SIGTERM)
            self.mission.wait(20)


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Shell]:
    opened = Shell(tmp_path)
    yield opened
    opened.close()


def test_every_command_of_the_page_succeeds_and_a_refusal_is_listed(shell: Shell) -> None:
    lines = command_lines()
    assert any(line.startswith("cdff up") for line in lines)
    assert SECURE_ENDPOINT in PAGE
    *first, history = lines
    outputs = {line: shell.run(line) for line in first}
    assert "eve.1" in outputs["cdff keys list"]
    robots = next(output for line, output in outputs.items() if line.endswith("/api/v1/robots"))
    assert {robot["id"] for robot in json.loads(robots)["items"]} == {"mana", "minnie"}
    refused = _refused_publication(shell)
    until_s = time.monotonic() + 20
    while refused not in (listed := shell.run(history)) and time.monotonic() < until_s:
        time.sleep(0.2)
    (event,) = (item for item in json.loads(listed)["items"] if item.get("key") == refused)
    assert (event["identity"], event["operation"]) == ("mana.1", "Put")


def _refused_publication(shell: Shell) -> str:
    """Publish a product of another robot as mana, and return its key."""
    key = "cdff/@v1/minnie/product/digital_elevation_mapping/dem"
    source = (
        f"from cdff_common.bus import Bus\nwith Bus.open(name='mana') as bus: bus.publish({key!r}, b'forged')"
    )
    environment = {**shell._environment, "CDFF_IDENTITY": "secrets/mana"}
    subprocess.run([sys.executable, "-c", source], cwd=shell.folder, env=environment, check=True, timeout=60)
    return key
