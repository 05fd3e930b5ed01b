# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the position manager with ``lidar_slam`` on simulated sweeps, wired as in ``explorer.yaml``.

``lidar_slam`` uses wheel odometry as prediction. Its pose is a fix in a frame that is located by the first
fix. Each drive is the start of ``lidar_traverse`` on different terrain, with the wheel slip and IMU of the
scenario; anchor and mounts are exact. Seeds 5000 to 5013 were used during development, but no parameter was
chosen with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.simulate.traverse import levelled, simulate
from evaluation.lidar_slam_covariance import short_scenario
from evaluation.runs.lidar_slam import ROBOT
from evaluation.runs.traverse import EXACT_MOUNTS, normalised_error, run

PAGE = "position_manager"
HELD_OUT = range(6000, 6012)
PORTS = {"lidar.scan": "scan", "wheels.odometry": "odometry", "imu.sample": "imu"}
WITH, WITHOUT = "wheels, imu, lidar_slam", "wheels, imu"


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return end errors and NEES, with ``lidar_slam`` and without."""
    results: dict[str, list[tuple[float, float]]] = {WITH: [], WITHOUT: []}
    path_lengths_m = []
    for seed in HELD_OUT:
        progress(f"position manager and lidar slam: seed {seed}")
        context, truth, samples = simulated_inputs(seed)
        path_lengths_m.append(_path_length_m(truth))
        base_samples = [*samples["imu"], *samples["odometry"]]
        for name, fix_samples in ((WITHOUT, []), (WITH, fixes(context, samples))):
            samples_of_all = [*base_samples, *fix_samples]
            last = run("position_manager", context, samples_of_all, parameters=EXACT_MOUNTS)[-1]
            nearest = min(truth, key=lambda t, at=last.header.t1_ns: abs(t - at))  # type: ignore[misc]
            error_m, squared = normalised_error(truth[nearest], last.value.transform)
            results[name].append((100.0 * error_m / path_lengths_m[-1], squared))
    n = len(HELD_OUT)
    return {
        "data": "start of lidar_traverse (simulated), different terrain for each seed",
        "drives": n,
        "seeds": [HELD_OUT.start, HELD_OUT.stop - 1],
        "path_length_m": round(float(np.median(path_lengths_m)), 2),
        "band": [round(float(chi2.ppf(q, 6 * n)) / n, 3) for q in (0.025, 0.975)],
        "sets": {name: _summary(trials) for name, trials in results.items()},
    }


def simulated_inputs(seed: int) -> tuple[DfpcContext, dict[int, FloatArray], dict[str, list[Sample]]]:
    """Return the frames of one drive, the true poses ``T_site_base`` by stamp, and the samples by port."""
    scenario = short_scenario(seed)
    truth: dict[int, FloatArray] = {}
    samples: dict[str, list[Sample]] = {port: [] for port in PORTS.values()}
    for entry, value in simulate(scenario, workers=0):
        stream = entry.stream.rpartition("/")[2]
        if stream == "truth.pose":
            truth[entry.stamp_ns] = value.transform.matrix
        elif stream in PORTS:
            samples[PORTS[stream]].append(Sample(PORTS[stream], entry.stamp_ns, entry.header.seq, value))
    frames, exact = FrameGraph(), np.zeros((6, 6))
    frames.set_static("site", f"{ROBOT}/odom", UncertainTransform(levelled(truth[min(truth)]), exact))
    for name, sensor in (("lidar", scenario.lidar), ("imu", scenario.imu)):
        frames.set_static(
            f"{ROBOT}/base", f"{ROBOT}/{name}", UncertainTransform(sensor.mount.matrix(), exact)
        )
    return DfpcContext(ROBOT, frames), truth, samples


def fixes(context: DfpcContext, samples: dict[str, list[Sample]]) -> list[Sample]:
    """Return the poses of ``lidar_slam`` as samples for the port ``fix``."""
    poses = run("lidar_slam", context, [*samples["scan"], *samples["odometry"]])
    return [Sample("fix", p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in poses]


def _path_length_m(truth: dict[int, FloatArray]) -> float:
    positions = np.array([T[:3, 3] for _, T in sorted(truth.items())])
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


def _summary(trials: Sequence[tuple[float, float]]) -> dict[str, Any]:
    percent, squared = zip(*trials, strict=True)
    return {
        "end_error_percent": error_summary(percent),
        "nees": error_summary(squared),
        "mean_nees": round(float(np.mean(squared)), 3),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each set of sources."""
    low, high = figures["band"]
    lines = [
        f"| {figures['drives']} held-out drives of {figures['path_length_m']:.0f} m, sweeps of 64 × 1800 "
        "through `lidar_slam` | error, median | 95 % | largest | mean NEES (95 % band "
        f"{low:.2f} to {high:.2f}) |",
        "|---|---|---|---|---|",
    ]
    for name, row in figures["sets"].items():
        errors = " | ".join(f"{row['end_error_percent'][key]:.2f} %" for key in ("median", "p95", "max"))
        lines.append(f"| {name} | {errors} | {row['mean_nees']:.2f} |")
    return "\n".join(lines)
