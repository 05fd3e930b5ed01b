# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the tutorial of the demonstration work as printed."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cdff_dev.missions.stage import Stage
from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(240)]

TUTORIAL = ROOT / "docs" / "tutorials" / "demonstration.md"


def command_lines() -> list[str]:
    """Return the commands of the tutorial that query the running system."""
    blocks = re.findall(r"^```\w*\n(.*?)^```", TUTORIAL.read_text(encoding="utf-8"), re.M | re.S)
    return [line for block in blocks for line in block.splitlines() if line.startswith(".venv/bin/cdff")]


def snippet() -> str:
    """Return the tutorial's Python block."""
    (block,) = re.findall(r"^```python\n(.*?)^```", TUTORIAL.read_text(encoding="utf-8"), re.M | re.S)
    return str(block)


@pytest.mark.parametrize("line", command_lines())
def test_every_command_of_the_tutorial_succeeds(
    stage: Stage, endpoint: str, line: str, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "cdff_common.cli", *shlex.split(line)[1:]]
    result = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "CDFF_CONNECT": endpoint, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout
    for name in re.findall(r"--out (\S+)", line):
        assert (tmp_path / name).stat().st_size > 0


def test_the_python_block_of_the_tutorial_runs(stage: Stage, endpoint: str) -> None:
    result = subprocess.run(
        [sys.executable, "-c", snippet()],
        env={**os.environ, "CDFF_CONNECT": endpoint, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "cells" in result.stdout
