# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run ``lidar_slam`` on simulated drives, and compare its poses with the truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.registry import Registry
from cdff_core.dfpcs.lidar_slam.compound import LidarSlam
from cdff_core.runtime import Runner
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.trajectory.compare import Comparison, compare
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.traverse import simulate

ROBOT = "mana"
#: Traverses of the evaluation; seeds 1 and 2 were used during development.
SEEDS = (20260901, 20260911)
SEGMENTS_M = (10.0, 20.0, 50.0, 100.0, 200.0, 400.0)
#: Parameters of the registration for the simulated lidar, which has no calibration errors.
EXACT_CALIBRATION = {"range_sigma_m": 0.0, "ring_range_sigma_m": 0.0, "ring_elevation_sigma_deg": 0.0}
#: Drives up to this duration are simulated in this process, seconds.
SINGLE_PROCESS_S = 20.0


@dataclass(slots=True)
class Run:
    """Results of one run.

    Attributes
    ----------
    node : LidarSlam
    truth : dict of int to ndarray, shape (4, 4)
        ``T_site_lidar`` by stamp.
    wheels : dict of int to ndarray, shape (4, 4)
        ``T_odom_lidar`` of wheel odometry.
    products : dict of str to list of Product
        Products by port.
    cpu_s, wall_s : list of float
        CPU and wall seconds of each sweep.
    """

    node: LidarSlam
    truth: dict[int, FloatArray] = field(default_factory=dict)
    wheels: dict[int, FloatArray] = field(default_factory=dict)
    products: dict[str, list[Product]] = field(default_factory=dict)
    cpu_s: list[float] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)

    def track(self, port: str) -> Track:
        """Return the poses of a port, without refused ones."""
        result = [p for p in self.products[port] if p.value is not None]
        poses = [p.value.transform for p in result]
        covariances = np.array([p.covariance for p in poses])
        return Track(
            port, np.array([p.header.t1_ns for p in result]), np.array([p.matrix for p in poses]), covariances
        )

    def trajectory(self) -> Track:
        """Return the final trajectory."""
        value = self.products["trajectory"][-1].value
        return Track("trajectory", value.stamps_ns, value.matrices, value.covariances)

    def reference(self, track: Track) -> Track:
        """Return the true poses at the stamps of a track."""
        return Track("truth", track.stamps_ns, np.array([self.truth[int(t)] for t in track.stamps_ns]))


def make_lidar_slam(scenario: Scenario, config: dict[str, Any] | None = None) -> LidarSlam:
    """Return the DFPC with the mount of the lidar; default parameters unless ``config`` is given."""
    frames = FrameGraph()
    mount = UncertainTransform.exact(scenario.lidar.mount.matrix())
    frames.set_static(f"{ROBOT}/base", f"{ROBOT}/lidar", mount)
    node: LidarSlam = Registry.default().make_dfpc("lidar_slam")  # type: ignore[assignment]
    node.configure(config, DfpcContext(ROBOT, frames))
    return node


def drive(
    scenario: Scenario,
    progress: Callable[[str], None],
    *,
    wheels: bool = False,
    slam_config: dict[str, Any] | None = None,
    on_sweep: Callable[[Run], None] | None = None,
) -> Run:
    """Simulate a scenario and run the DFPC on it, without writing a log.

    ``on_sweep`` is called after each sweep.
    """
    run = Run(make_lidar_slam(scenario, slam_config))
    runner = Runner(run.node)
    ports = {f"/{ROBOT}/lidar.scan": "scan"} | ({f"/{ROBOT}/wheels.odometry": "odometry"} if wheels else {})
    for entry, value in simulate(scenario, workers=int(scenario.duration_s > SINGLE_PROCESS_S)):
        if entry.stream == f"/{ROBOT}/wheels.odometry":
            run.wheels[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream == f"/{ROBOT}/truth.pose":
            run.truth[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream not in ports:
            continue
        if ports[entry.stream] == "scan":
            sweep = len(run.cpu_s)  # one time for each finished sweep
            progress(f"lidar slam: {scenario.name}, seed {scenario.seed}, sweep {sweep}")
        runner.push(Sample(ports[entry.stream], entry.stamp_ns, entry.header.seq, value))
        started_s, started_wall_s = time.process_time(), time.perf_counter()
        _append_products(run, runner.drain())
        if ports[entry.stream] == "scan":
            run.cpu_s.append(time.process_time() - started_s)
            run.wall_s.append(time.perf_counter() - started_wall_s)
            if on_sweep is not None:
                on_sweep(run)
    _append_products(run, runner.finish())
    return run


def _append_products(run: Run, products: Any) -> None:
    for product in products:
        run.products.setdefault(product.port, []).append(product)


def errors(track: Track, run: Run) -> dict[str, Any]:
    """Return drift over segments, absolute trajectory error and NEES."""
    comparison = compare(track, run.reference(track), segments_m=SEGMENTS_M)
    results = comparison.results
    drift = results["drift"]
    rmse_m = results["ate"]["translation_m"]["rmse"]
    return {
        "drift_percent": {int(s["length_m"]): round(s["translation_percent"], 4) for s in drift["segments"]},
        "drift_deg_per_m": {int(s["length_m"]): round(s["rotation_deg_per_m"], 6) for s in drift["segments"]},
        "ate_rmse_m": round(rmse_m, 4),
        "ate_percent_of_path": round(results["ate"]["rmse_percent_of_path"], 5),
        "nees": nees(track, run.reference(track)),
        "along": _along(comparison),
    }


def _along(comparison: Comparison) -> dict[str, list[float]]:
    """Return path length, true and estimated position and error at a hundred poses."""
    rows = np.unique(np.linspace(0, len(comparison.reference) - 1, 100).astype(int))
    xy, estimate = comparison.reference.positions_m[rows, :2], comparison.estimate.positions_m[rows, :2]
    columns = {
        "path_length_m": comparison.reference.distances_m[rows],
        "error_m": comparison.position_errors_m[rows],
        "x_m": xy[:, 0],
        "y_m": xy[:, 1],
        "estimated_x_m": estimate[:, 0],
        "estimated_y_m": estimate[:, 1],
    }
    return {name: [round(float(v), 3) for v in column] for name, column in columns.items()}


def nees(track: Track, reference: Track) -> dict[str, float]:
    """Return the NEES of every 20th pose, with both tracks aligned at the first pose (6 expected)."""
    if track.covariances is None:
        return {"count": 0}
    T_first = track.matrices[0] @ se3.inverse(reference.matrices[0])
    values = []
    for T, T_true, C in zip(
        track.matrices[20::20], reference.matrices[20::20], track.covariances[20::20], strict=True
    ):
        e = pose_error(T_first @ T_true, T)
        values.append(float(e @ np.linalg.solve(C + 1e-12 * np.eye(6), e)))
    return error_summary(values) | {"mean": round(float(np.mean(values)), 3)}


def times(seconds: Sequence[float]) -> dict[str, float]:
    """Return statistics of the time of a sweep, without the first two, which include compilation."""
    return error_summary(seconds[2:]) | {"mean": round(float(np.mean(seconds[2:])), 4)}
