# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the page "bring up your own robot" work as printed, on the bag of the page."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.integration.conftest import ROOT

PAGE = ROOT / "docs" / "tutorials" / "bring-up-your-own-robot.md"


@pytest.mark.slow
def test_every_command_of_the_page_succeeds_and_every_sample_is_used(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    page = PAGE.read_text(encoding="utf-8")
    lines = [
        line for block in re.findall(r"^```bash\n(.*?)^```", page, re.M | re.S) for line in block.splitlines()
    ]
    assert len(lines) == 5
    printed = ""
    for line in lines:
        expanded = line.replace("$CDFF_DATA", str(real_data("rosbags").parent))
        command = [sys.executable, "-m", "cdff_common.cli", *shlex.split(expanded)[1:]]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        result = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        # The check of the log finds the mount that the next command calibrates.
        is_check = command[3] == "check"
        assert result.returncode == (1 if is_check else 0), result.stderr
        assert (
            not is_check or "imu_data disagrees with the other sensors by a rotation of 90" in result.stdout
        )
        printed += result.stdout
    for found in re.findall(r"^  (?:roll|pitch|yaw) .*°$", page, re.MULTILINE):
        assert found in printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["failed"] == summary["dropped"] == 0
    assert "refused" not in result.stderr
    assert len((tmp_path / "out" / "pose.tum").read_text().splitlines()) > 1400
    assert (tmp_path / "frames.svg").read_text().startswith("<svg")
