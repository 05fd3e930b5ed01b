# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""kiss-icp on the sweeps of the traverses that ``lidar_slam`` is judged by, in the environment of CDFF_PEER_PYTHON.

It has its own parameters for the range. It deskews by the motion between sweeps, so it is given that motion in the
share of a sweep that a revolution takes. Both traverses run at once, each on one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from cdff_dev.evaluate._lidar_slam_drive import ROBOT, SEEDS, Run, errors, slam, times
from cdff_dev.evaluate._lidar_slam_page import peer_table as table
from cdff_dev.evaluate._peers import SweepFile, peer_python
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.traverse import simulate
from cdff_dev.trajectory.track import Track

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Drift and cost of the peer on each traverse; nothing where there is no peer."""
    python = peer_python("kiss_icp")
    if python is None:
        progress("lidar slam: no interpreter with kiss-icp, left out")
        return {}
    with ThreadPoolExecutor(len(SEEDS)) as pool:
        found = list(pool.map(lambda seed: traverse(seed, python, progress), SEEDS))
    return {f"lidar_traverse, seed {seed}": row for seed, row in zip(SEEDS, found, strict=True)}


def traverse(seed: int, python: str, progress: Callable[[str], None]) -> dict[str, Any]:
    """The peer on one traverse."""
    scenario = load_scenario("lidar_traverse", seed)
    run, stamps_ns = Run(slam(scenario)), []
    with SweepFile() as stored:
        for entry, value in simulate(scenario, workers=1):
            if entry.stream == f"/{ROBOT}/truth.pose":
                run.truth[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
            elif entry.stream == f"/{ROBOT}/lidar.scan":
                stored.append(value)
                stamps_ns.append(value.t1_ns)
        progress(f"lidar slam: kiss-icp, seed {seed}, {len(stamps_ns)} sweeps")
        config = run.node.config
        poses, cpu_s, wall_s = stored.kiss_icp(python, (config.min_range_m, config.max_range_m))
    row = errors(Track("kiss-icp", np.array(stamps_ns), poses), run)
    return row | {"cpu_s_per_sweep": times(cpu_s), "wall_s_per_sweep": times(wall_s)}
