# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two replays of lidar SLAM give equal bytes and the recorded end position."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import se3
from cdff_dev.logs import LogWriter, open_log
from tests.support.hills import circle, hills, scan

pytestmark = pytest.mark.golden

GROUND = hills(1)
RADIUS_M, PERIOD_NS = 8.0, 500_000_000
#: Path length at each sweep.
DISTANCES_M = np.concatenate([[0.0, 0.0, 0.0, 0.05, 0.2], np.arange(0.5, 12.0, 0.5)])
#: End position of the recorded run, m; library versions may move it by millimetres.
REFERENCE_END_M = (7.764, 6.639, 2.224)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log of a drive from rest along a quarter of a circle over hills."""
    path = tmp_path_factory.mktemp("log") / "drive.msg"
    rng = np.random.default_rng(0)
    poses = circle(GROUND, RADIUS_M, DISTANCES_M)
    with LogWriter(path) as log:
        for i, T in enumerate(poses):
            T_previous, stamp_ns = poses[max(i - 1, 0)], (i + 1) * PERIOD_NS
            # A sweep takes the last fifth of the time between two sweeps.
            T_start = T_previous @ se3.exp_se3(0.8 * se3.log_se3(se3.inverse(T_previous) @ T))
            log.write("/mana/lidar.scan", scan(GROUND, T_start, T, stamp_ns, rng), stamp_ns)
    return path


def test_a_replay_is_repeatable_and_reproduces_the_recorded_result(log: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert main(["replay", str(log), "--dfpc", "lidar_slam", "--out", str(tmp_path / name)]) == 0
    for name in ("outputs.msg", "pose.tum", "odometry.tum"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    summary = json.loads((tmp_path / "a" / "summary.json").read_text(encoding="utf-8"))
    assert summary["failed"] == summary["dropped"] == 0
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as outputs:
        streams = {s.rpartition(".")[2]: info.count for s, info in outputs.streams.items()}
        poses = [s.value.transform.matrix for s in outputs.samples(["/mana/lidar_slam.pose"])]
    assert streams == {
        "pose": len(DISTANCES_M),
        "odometry": len(DISTANCES_M),
        "trajectory": 1,
        "graph": 1,
        "cloud": 1,
    }
    T_first, T_last = (circle(GROUND, RADIUS_M, DISTANCES_M)[i] for i in (0, -1))
    np.testing.assert_allclose(poses[-1][:3, 3], (se3.inverse(T_first) @ T_last)[:3, 3], atol=0.06)
    np.testing.assert_allclose(poses[-1][:3, 3], REFERENCE_END_M, atol=0.005)
