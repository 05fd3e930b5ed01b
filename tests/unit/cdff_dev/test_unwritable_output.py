# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every command that writes files: an unwritable output is a known error, one line with exit code 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from cdff_dev.logs import LogWriter

ROOT = Path(__file__).resolve().parents[3]
PROFILE = str(ROOT / "deploy" / "profiles" / "rover_traverse.yaml")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of one wheel pose."""
    path = tmp_path_factory.mktemp("log") / "a.msg"
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4), np.eye(6)), parent="mana/odom", child="mana/base", stamp_ns=0
    )
    with LogWriter(path) as writer:
        writer.write("/mana/wheels.odometry", pose, 0)
    return path


@pytest.mark.parametrize(
    "command",
    [
        ["replay", "LOG", "--dfpc", "position_manager", "--out", "PLACE"],
        ["log", "cut", "LOG", "--out", "PLACE"],
        ["log", "cut", "LOG", "--out", "PLACE.msg"],
        ["log", "merge", "LOG", "--out", "PLACE"],
        ["simulate", "rover_traverse", "--out", "PLACE"],
        ["simulate", "rover_traverse", "--out", "PLACE.msg"],
        ["demo", "--once", "--data-dir", "PLACE"],
        ["up", "--profile", PROFILE, "--data-dir", "PLACE"],
        ["dpm", "verify", "--data-dir", "PLACE"],
    ],
    ids=lambda c: " ".join(c[:2]) + c[-1],
)
def test_an_unwritable_output_is_a_known_error(
    command: list[str], log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = str(log / "below" / "x")  # no user, not even root, can create a folder below a file
    assert main([part.replace("LOG", str(log)).replace("PLACE", place) for part in command]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "Not a directory" in line
