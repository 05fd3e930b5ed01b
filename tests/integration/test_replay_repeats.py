# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.types import Pointcloud
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.source import recorded_header


@pytest.fixture
def log(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A log of six clouds of gently sloping ground in the site frame, at 10 Hz."""
    path = tmp_path / "clouds.msg"
    with LogWriter(path) as writer:
        for i in range(6):
            points = rng.uniform([-2, -2, 0], [2, 2, 0], (800, 3))
            points[:, 2] = 0.1 * points[:, 0] + rng.normal(0, 0.01, len(points))
            stamp_ns = 1_000_000_000 + i * 100_000_000
            writer.write(
                "/mana/lidar.cloud", Pointcloud.from_points(points, frame="site", stamp_ns=stamp_ns), stamp_ns
            )
    return path


def _replay(log: Path, out: Path, hash_seed: str, *options: str) -> dict[str, object]:
    command = ["replay", str(log), "--dfpc", "digital_elevation_mapping", "--map", "cloud=/mana/lidar.cloud"]
    subprocess.run(
        [sys.executable, "-m", "cdff_common.cli", *command, *options, "--out", str(out)],
        env=os.environ | {"PYTHONHASHSEED": hash_seed},
        check=True,
        capture_output=True,
    )
    summary: dict[str, object] = json.loads((out / "summary.json").read_text())
    return summary


@pytest.mark.integration
@pytest.mark.req("CDFF-DEV-021", "CDFF-DEV-022")
@pytest.mark.slow
def test_two_replays_in_two_processes_give_the_same_bytes(log: Path, tmp_path: Path) -> None:
    first = _replay(log, tmp_path / "a", "1")
    second = _replay(log, tmp_path / "b", "2")
    assert (tmp_path / "a" / "outputs.msg").read_bytes() == (tmp_path / "b" / "outputs.msg").read_bytes()
    assert first["samples"] == second["samples"] == 6
    assert first["outputs"] == second["outputs"]
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as outputs:
        assert outputs.streams["/mana/digital_elevation_mapping.map"].count >= 1


@pytest.mark.integration
@pytest.mark.slow
def test_a_replay_from_a_position_gives_the_bytes_of_a_log_that_begins_there(
    log: Path, tmp_path: Path
) -> None:
    part = tmp_path / "part.msg"
    with closing(open_log(log)) as whole_log, LogWriter(part) as writer:
        for sample in list(whole_log.samples())[3:]:
            header = recorded_header(sample.stream, sample.seq, sample.stamp_ns)
            writer.write(sample.stream, sample.value, sample.stamp_ns, header)
    from_start = _replay(log, tmp_path / "a", "1", "--start", "0.3")
    from_end = _replay(log, tmp_path / "b", "2", "--start=-0.2")
    assert from_start["samples"] == from_end["samples"] == _replay(part, tmp_path / "c", "3")["samples"] == 3
    first, second, third = ((tmp_path / name / "outputs.msg").read_bytes() for name in "abc")
    assert first == second == third
