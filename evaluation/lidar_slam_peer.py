# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run kiss-icp on the sweeps of the traverses of ``lidar_slam``, in the environment of CDFF_PEER_PYTHON.

kiss-icp deskews with the motion between sweeps. Because a revolution takes only a fraction of the time
between two sweeps, the motion passed to it is scaled by this fraction. Both traverses run in parallel, each
on one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from cdff_dev.compare.trajectory.track import Track
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.traverse import simulate
from evaluation.peers.environments import SweepFile, peer_python
from evaluation.runs.lidar_slam import ROBOT, SEEDS, Run, errors, make_lidar_slam, times
from evaluation.runs.lidar_slam_page import peer_table as table

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return drift and cost of kiss-icp on each traverse; empty if it is not installed."""
    python = peer_python("kiss_icp")
    if python is None:
        progress("lidar slam: no interpreter with kiss-icp; skipped")
        return {}
    with ThreadPoolExecutor(len(SEEDS)) as pool:
        result = list(pool.map(lambda seed: traverse(seed, python, progress), SEEDS))
    return {f"lidar_traverse, seed {seed}": row for seed, row in zip(SEEDS, result, strict=True)}


def traverse(seed: int, python: str, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return drift and cost of kiss-icp on one traverse."""
    scenario = load_scenario("lidar_traverse", seed)
    run, stamps_ns = Run(make_lidar_slam(scenario)), []
    with SweepFile() as sweep_file:
        for entry, value in simulate(scenario, workers=1):
            if entry.stream == f"/{ROBOT}/truth.pose":
                run.truth[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
            elif entry.stream == f"/{ROBOT}/lidar.scan":
                sweep_file.append(value)
                stamps_ns.append(value.t1_ns)
        progress(f"lidar slam: kiss-icp, seed {seed}, {len(stamps_ns)} sweeps")
        config = run.node.config
        poses, cpu_s, wall_s = sweep_file.kiss_icp(python, (config.min_range_m, config.max_range_m))
    row = errors(Track("kiss-icp", np.array(stamps_ns), poses), run)
    return row | {"cpu_s_per_sweep": times(cpu_s), "wall_s_per_sweep": times(wall_s)}
