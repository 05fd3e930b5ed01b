# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drives of a lidar through the simulator and ``lidar_slam``, and how far its poses are from the truth."""

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
from cdff_dev.evaluate.record import spread
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.traverse import simulate
from cdff_dev.trajectory.compare import Comparison, compare
from cdff_dev.trajectory.track import Track

ROBOT = "mana"
#: Traverses that judge; seeds 1 and 2 were used while the DFPC was made.
SEEDS = (20260901, 20260911)
SEGMENTS_M = (10.0, 20.0, 50.0, 100.0, 200.0, 400.0)
#: Drives up to this long are simulated without a process of their own.
BRIEF_S = 20.0


@dataclass(slots=True)
class Run:
    """What came out of one drive.

    Attributes
    ----------
    node : LidarSlam
    truth : dict of int to ndarray, shape (4, 4)
        ``T_site_lidar`` by stamp.
    wheels : dict of int to ndarray, shape (4, 4)
        ``T_odom_lidar`` by the wheels alone.
    products : dict of str to list of Product
        By port.
    cpu_s, wall_s : list of float
        Of each sweep.
    """

    node: LidarSlam
    truth: dict[int, FloatArray] = field(default_factory=dict)
    wheels: dict[int, FloatArray] = field(default_factory=dict)
    products: dict[str, list[Product]] = field(default_factory=dict)
    cpu_s: list[float] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)

    def track(self, port: str) -> Track:
        """Poses of a port, those that were refused left out."""
        found = [p for p in self.products[port] if p.value is not None]
        poses = [p.value.transform for p in found]
        covariances = np.array([p.covariance for p in poses])
        return Track(port, np.array([p.header.t1_ns for p in found]), np.array([p.matrix for p in poses]), covariances)

    def trajectory(self) -> Track:
        """The trajectory as known at the end."""
        value = self.products["trajectory"][-1].value
        return Track("trajectory", value.stamps_ns, value.matrices, value.covariances)

    def reference(self, track: Track) -> Track:
        """The truth at the stamps of a track."""
        return Track("truth", track.stamps_ns, np.array([self.truth[int(t)] for t in track.stamps_ns]))


def slam(scenario: Scenario, config: dict[str, Any] | None = None) -> LidarSlam:
    """The DFPC, by default with its defaults, and the lidar's mount."""
    frames = FrameGraph()
    mount = UncertainTransform(scenario.lidar.mount.matrix(), np.zeros((6, 6)))
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
    each: Callable[[Run], None] | None = None,
) -> Run:
    """Run the DFPC over a scenario as it is simulated; nothing is stored. ``each`` is called after every sweep."""
    run = Run(slam(scenario, slam_config))
    runner = Runner(run.node)
    ports = {f"/{ROBOT}/lidar.scan": "scan"} | ({f"/{ROBOT}/wheels.odometry": "odometry"} if wheels else {})
    for entry, value in simulate(scenario, workers=int(scenario.duration_s > BRIEF_S)):
        if entry.stream == f"/{ROBOT}/wheels.odometry":
            run.wheels[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream == f"/{ROBOT}/truth.pose":
            run.truth[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream not in ports:
            continue
        if ports[entry.stream] == "scan":
            progress(f"lidar slam: {scenario.name}, seed {scenario.seed}, sweep {len(run.cpu_s)}")
        runner.push(Sample(ports[entry.stream], entry.stamp_ns, entry.header.seq, value))
        began_s, began_wall_s = time.process_time(), time.perf_counter()
        _sort(run, runner.drain())
        if ports[entry.stream] == "scan":
            run.cpu_s.append(time.process_time() - began_s)
            run.wall_s.append(time.perf_counter() - began_wall_s)
            if each is not None:
                each(run)
    _sort(run, runner.finish())
    return run


def _sort(run: Run, products: Any) -> None:
    for product in products:
        run.products.setdefault(product.port, []).append(product)


def errors(track: Track, run: Run) -> dict[str, Any]:
    """Drift over segments, absolute error and normalised squared error."""
    found = compare(track, run.reference(track), segments_m=SEGMENTS_M)
    figures = found.figures
    drift = figures["drift"]
    rmse_m = figures["ate"]["translation_m"]["rmse"]
    return {
        "drift_percent": {int(s["length_m"]): round(s["translation_percent"], 4) for s in drift["segments"]},
        "drift_deg_per_m": {int(s["length_m"]): round(s["rotation_deg_per_m"], 6) for s in drift["segments"]},
        "ate_rmse_m": round(rmse_m, 4),
        "ate_percent_of_way": round(figures["ate"]["rmse_percent_of_way"], 5),
        "nees": nees(track, run.reference(track)),
        "along": _along(found),
    }


def _along(found: Comparison) -> dict[str, list[float]]:
    """A hundred poses of the way: its length, where the lidar was and was thought to be, the distance between both."""
    rows = np.unique(np.linspace(0, len(found.reference) - 1, 100).astype(int))
    xy, estimate = found.reference.positions_m[rows, :2], found.estimate.positions_m[rows, :2]
    columns = {
        "way_m": found.reference.distances_m[rows], "error_m": found.position_errors_m[rows],
        "x_m": xy[:, 0], "y_m": xy[:, 1], "estimated_x_m": estimate[:, 0], "estimated_y_m": estimate[:, 1],
    }  # fmt: skip
    return {name: [round(float(v), 3) for v in column] for name, column in columns.items()}


def nees(track: Track, reference: Track) -> dict[str, float]:
    """Squared error by the stated covariance, both tracks begun at the same pose; 6 are expected."""
    if track.covariances is None:
        return {"count": 0}
    T_first = track.matrices[0] @ se3.inverse(reference.matrices[0])
    values = []
    for T, T_true, C in zip(track.matrices[20::20], reference.matrices[20::20], track.covariances[20::20], strict=True):
        e = pose_error(T_first @ T_true, T)
        values.append(float(e @ np.linalg.solve(C + 1e-12 * np.eye(6), e)))
    return spread(values) | {"mean": round(float(np.mean(values)), 3)}


def times(seconds: Sequence[float]) -> dict[str, float]:
    """Of a sweep, the two at which code is compiled left out."""
    return spread(seconds[2:]) | {"mean": round(float(np.mean(seconds[2:])), 4)}
