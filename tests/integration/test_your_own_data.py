# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the page "your own data" work as printed, on the shared data sets."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.integration.conftest import ROOT

PAGE = ROOT / "docs" / "tutorials" / "your-own-data.md"


@pytest.mark.slow
def test_every_command_of_the_page_succeeds(real_data: Callable[[str], Path], tmp_path: Path) -> None:
    blocks = re.findall(r"^```bash\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    assert len(lines) == 4
    for line in lines:
        expanded = line.replace("$CDFF_DATA", str(real_data("kitti_stereo").parent))
        command = [sys.executable, "-m", "cdff_common.cli", *shlex.split(expanded)[1:]]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        result = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert result.returncode == 0, result.stderr
        assert result.stdout
    for name in ("slam/map.png", "slam/map.ply", "vo/trajectory.png", "vo/run.json"):
        assert (tmp_path / name).stat().st_size > 0
