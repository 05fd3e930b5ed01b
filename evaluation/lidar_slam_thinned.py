# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate ``lidar_slam`` and kiss-icp on sweeps with few points or rings, and after fast turns.

Real: KITTI 00, sweeps 94 and 95, also with the second one rotated by 50 degrees. Simulated: the start of
``lidar_traverse``, also with a turn of 50 degrees within one sweep. Each is evaluated with all points, with
20 000 random points and with 16 of 64 rings. Development used seeds 1 and 2 and KITTI's sweeps 0 to 2.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from evaluation.data_sets.clouds import kitti_pair
from evaluation.peers.environments import SweepFile, peer_python
from evaluation.real import RealRow
from evaluation.runs.lidar_slam import times
from evaluation.runs.lidar_slam_page import thinned_table as table
from evaluation.runs.thinned_sweeps import Turn, kitti_sweeps, simulated_drive, thinned

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
KINDS = ("full", "points", "rings")
DRIVE_SEEDS, DRIVE_S = (20260901,), 14.0
TURN_DEG = 50.0
#: A turn within one sweep; sweeps take 0.1 s and start every 0.5 s.
TURN = Turn(start_s=9.0, duration_s=0.1, angle_deg=TURN_DEG)
#: Ranges of kiss-icp: its default, from which it derives its voxels, and that of lidar_slam.
KITTI_RANGE_M, DRIVE_RANGE_M = (0.5, 100.0), (0.5, 60.0)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors and CPU times of both programs, and the NEES."""
    python = peer_python("kiss_icp")
    figures: dict[str, Any] = {"real": {}, "simulated": {}}
    *_, T_94_95 = kitti_pair(data)
    paths = [data / "kitti_velodyne" / f"{i:06d}.bin" for i in (94, 95)]
    run_lidar_slam(list(thinned(kitti_sweeps(paths), "rings")))  # compiles the kernels
    for turn_deg in (0.0, TURN_DEG):
        T_turn = se3.transform(se3.exp_so3(np.array([0.0, 0.0, np.radians(turn_deg)])), np.zeros(3))
        sweeps = kitti_sweeps(paths, T_turn)
        truth = {sweeps[0].t1_ns: np.eye(4), sweeps[1].t1_ns: T_94_95 @ se3.inverse(T_turn)}
        for kind in KINDS:
            progress(f"lidar slam: KITTI 94, 95, turned by {turn_deg:g} degrees, {kind}")
            row = compare(list(thinned(sweeps, kind)), truth, python, KITTI_RANGE_M)
            figures["real"][f"94, 95, turn {turn_deg:g} deg, {kind}"] = row
    for seed in DRIVE_SEEDS:
        for name, turn in (("straight", None), (f"turn {TURN_DEG:g} deg", TURN)):
            drive = simulated_drive(seed, DRIVE_S, progress, turn)
            for kind in KINDS:
                progress(f"lidar slam: seed {seed}, {name}, {kind}")
                row = compare(list(thinned(drive.sweeps, kind)), drive.truth, python, DRIVE_RANGE_M)
                figures["simulated"][f"seed {seed}, {name}, {kind}"] = row
    return figures


def compare(
    sweeps: list[LidarScan],
    truth: dict[int, FloatArray],
    python: str | None,
    range_m: tuple[float, float],
) -> dict[str, Any]:
    """Return the results of both programs on the same sweeps."""
    outputs, cpu_s = run_lidar_slam(sweeps)
    stamps = [sweep.t1_ns for sweep in sweeps]
    published = [(stamp, o) for stamp, o in zip(stamps, outputs, strict=True) if o.value is not None]
    row: dict[str, Any] = {
        "points": len(sweeps[0].points_m),
        "lidar_slam": errors(
            [stamp for stamp, _ in published],
            np.array([o.value.transform.matrix for _, o in published]),
            truth,
        )
        | {
            "squared_error": squared_errors(published, truth),
            "cpu_s": mean_time(cpu_s),
            "sweeps": dict(Counter(str(o.quality.status) for o in outputs)),
        },
    }
    if python is not None:
        with SweepFile() as sweep_file:
            for sweep in sweeps:
                sweep_file.append(sweep)
            poses, kiss_cpu_s, _ = sweep_file.kiss_icp(python, range_m)
        row["kiss_icp"] = errors(stamps, poses, truth) | {"cpu_s": mean_time(kiss_cpu_s)}
        row["error_ratio"] = round(row["lidar_slam"]["rmse_m"] / row["kiss_icp"]["rmse_m"], 3)
    return row


def run_lidar_slam(sweeps: list[LidarScan]) -> tuple[list[Output], list[float]]:
    """Return the odometry of each sweep and its CPU seconds."""
    node = Registry.default().make_dfpc("lidar_slam")
    node.configure(None)
    outputs, cpu_s = [], []
    for k, sweep in enumerate(sweeps):
        started_s = time.process_time()
        results = list(node.step(Sample("scan", sweep.t1_ns, k, sweep)))
        cpu_s.append(time.process_time() - started_s)
        outputs.append(next(o for o in results if o.port == "odometry"))
    return outputs, cpu_s


def errors(stamps: list[int], poses: FloatArray, truth: dict[int, FloatArray]) -> dict[str, float]:
    """Return the errors relative to the first sweep: rms and maximum, and those of the last sweep."""
    E = np.array(
        [
            se3.inverse(se3.inverse(truth[stamps[0]]) @ truth[stamp]) @ se3.inverse(poses[0]) @ T
            for stamp, T in zip(stamps[1:], poses[1:], strict=True)
        ]
    )
    distance_m, angle_deg = np.linalg.norm(E[:, :3, 3], axis=1), np.degrees(se3.rotation_angle(E[:, :3, :3]))
    return {
        "rmse_m": round(float(np.sqrt(np.mean(distance_m**2))), 4),
        "max_m": round(float(distance_m.max()), 4),
        "last_m": round(float(distance_m[-1]), 4),
        "last_deg": round(float(angle_deg[-1]), 4),
    }


def squared_errors(published: list[tuple[int, Output]], truth: dict[int, FloatArray]) -> dict[str, float]:
    """Return mean and maximum of the NEES (6 expected)."""
    T_first, values = se3.inverse(truth[published[0][0]]), []
    for stamp, output in published[1:]:
        e = pose_error(T_first @ truth[stamp], output.value.transform.matrix)
        values.append(float(e @ np.linalg.solve(output.value.transform.covariance, e)))
    return {"mean": round(float(np.mean(values)), 2), "max": round(float(np.max(values)), 2)}


def mean_time(cpu_s: Any) -> float:
    """Return the mean CPU seconds per sweep without the first two; of two or three sweeps, the last one."""
    return round(float(cpu_s[-1]), 4) if len(cpu_s) < 4 else times(cpu_s)["mean"]


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    return [
        RealRow(
            f"KITTI {name}: error, NEES (6 expected), CPU time",
            "",
            f"{100 * row['lidar_slam']['rmse_m']:.1f} cm, {row['lidar_slam']['squared_error']['mean']}, "
            f"{1e3 * row['lidar_slam']['cpu_s']:.0f} ms",
            f"kiss-icp {100 * row['kiss_icp']['rmse_m']:.1f} cm, {1e3 * row['kiss_icp']['cpu_s']:.0f} ms",
            "≤ 1.2 × kiss-icp",
        )
        for name, row in figures["real"].items()
    ]
