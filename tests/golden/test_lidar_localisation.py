# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two replays of lidar localisation give equal bytes and the recorded end position."""

from __future__ import annotations

import itertools
import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from cdff_dev.logs import LogWriter, open_log
from tests.support.mapped_hills import Hills

pytestmark = pytest.mark.golden

SWEEPS, PERIOD_NS = 8, 500_000_000
#: End position of the recorded run, m; library versions may move it by millimetres.
REFERENCE_END_M = (1.399, 2.801, -0.384)

HILLS = Hills(3)


def true_pose(i: int) -> np.ndarray:
    """Return ``T_site_lidar`` of a sweep."""
    return HILLS.pose(-7.0 + 1.2 * i, 0.4 * i, 0.06 * i)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log with a map in two pieces, sweeps, and drifting odometry.

    It contains no initial pose, so that the DFPC must search the map for the first pose.
    """
    path = tmp_path_factory.mktemp("log") / "drive.msg"
    rng = np.random.default_rng(0)
    map_points = HILLS.map(rng, 0.3)
    drift = se3.exp_se3([0.03, 0.01, 0.0, 0.0, 0.0, 0.005])
    T_odom_lidar = np.eye(4)
    with LogWriter(path) as log:
        for i, piece in enumerate(np.array_split(map_points, 2)):
            log.write(
                "/rover/lidar_slam.map",
                Pointcloud.from_points(piece, frame="site", stamp_ns=1000 * i),
                1000 * i,
            )
        for i, (previous, T) in enumerate(itertools.pairwise([true_pose(0), *map(true_pose, range(SWEEPS))])):
            stamp_ns = (i + 1) * PERIOD_NS
            T_odom_lidar = T_odom_lidar @ se3.inverse(previous) @ T @ drift
            odometry = TransformWithCovariance.from_transform(
                UncertainTransform(T_odom_lidar), parent="rover/odom", child="rover/lidar", stamp_ns=stamp_ns
            )
            log.write("/rover/wheels.odometry", odometry, stamp_ns)
            points = HILLS.scan(rng, T).astype(np.float32)
            sweep = LidarScan.from_arrays(
                points, np.zeros(len(points), np.uint32), frame="rover/lidar", t0_ns=stamp_ns, t1_ns=stamp_ns
            )
            log.write("/rover/lidar.scan", sweep, stamp_ns)
    return path


def replay(log: Path, out: Path) -> dict[str, object]:
    wiring = ["--map", "map=/rover/lidar_slam.map", "--map", "odometry=/rover/wheels.odometry"]
    assert main(["replay", str(log), "--dfpc", "lidar_localisation", *wiring, "--out", str(out)]) == 0
    summary: dict[str, object] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    return summary


def test_a_drive_on_a_map_is_repeatable_and_reproduces_the_recorded_result(log: Path, tmp_path: Path) -> None:
    summary, _ = (replay(log, tmp_path / name) for name in ("a", "b"))
    assert summary["failed"] == summary["dropped"] == 0
    assert summary["degraded"] == 1  # the first pose, found by the search
    for name in ("outputs.msg", "pose.tum"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as outputs:
        poses = [sample.value.transform for sample in outputs.samples()]
    assert len(poses) == SWEEPS
    np.testing.assert_allclose(poses[-1].matrix[:3, 3], true_pose(SWEEPS - 1)[:3, 3], atol=0.01)
    np.testing.assert_allclose(poses[-1].matrix[:3, 3], REFERENCE_END_M, atol=0.005)
