# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run DFPCs on the simulated traverse, with exact frames, and compare with its true poses."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.registry import Registry
from cdff_core.runtime import Runner
from cdff_dev.logs import LogReader, open_log
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import SIDECAR, simulated_log

SCENARIO = "rover_traverse"
#: Parameters of visual odometry for simulated images, whose calibration is exact.
SIMULATED_CAMERA: dict[str, Any] = {
    "motion": {
        "sigma_common_px": 0.003,
        "calibration": {
            "focal_length_ratio": 0.0,
            "baseline_ratio": 0.0,
            "principal_point_px": 0.0,
            "rotation_deg": 0.0,
            "distortion_px": 0.0,
        },
    }
}

#: Parameters of the position manager for simulated drives without errors of the mounts.
EXACT_MOUNTS = {"mounts": {"imu_sigma_deg": 0.0, "sensor_sigma_deg": 0.0, "sensor_sigma_m": 0.0}}


@dataclass(frozen=True, slots=True)
class TraverseRun:
    """The drive of one rover.

    Attributes
    ----------
    context : DfpcContext
        The frames of the rover; anchor and mounts are exact.
    truth : dict of int to array, shape (4, 4)
        ``T_site_base`` by stamp, nanoseconds.
    """

    robot: str
    context: DfpcContext
    log: LogReader
    truth: dict[int, se3.FloatArray]

    @property
    def path_length_m(self) -> float:
        """Length of the driven path."""
        steps = itertools.pairwise(T[:3, 3] for _, T in sorted(self.truth.items()))
        return float(sum(np.linalg.norm(b - a) for a, b in steps))

    def true_pose(self, stamp_ns: int) -> se3.FloatArray:
        """Return the true pose nearest to a time."""
        return self.truth[min(self.truth, key=lambda t: abs(t - stamp_ns))]

    def samples(self, streams: Mapping[str, str]) -> list[Sample]:
        """Return the samples of streams for ports; ``streams`` maps ``wheels.odometry`` to ``odometry``."""
        ports = {f"/{self.robot}/{stream}": port for stream, port in streams.items()}
        return [Sample(ports[s.stream], s.stamp_ns, s.seq, s.value) for s in self.log.samples(list(ports))]


def traverse_runs(name: str = SCENARIO, seed: int | None = None) -> tuple[int, list[TraverseRun]]:
    """Return the seed of a scenario and the drives of its rovers; simulated now if not in the cache."""
    scenario = load_scenario(name, seed)
    folder: Path = simulated_log(scenario)
    described: dict[str, Any] = json.loads((folder / SIDECAR).read_text(encoding="utf-8"))["robots"]
    results = []
    for robot, entry in described.items():
        frames = FrameGraph()
        for edge in entry["frames"]:
            T = se3.transform_from_quaternion_xyzw(edge["translation_m"], edge["quaternion_xyzw"])
            frames.set_static(edge["parent"], edge["child"], UncertainTransform.exact(T))
        log = open_log(folder)
        truth = {s.stamp_ns: s.value.transform.matrix for s in log.samples([f"/{robot}/truth.pose"])}
        results.append(TraverseRun(robot, DfpcContext(robot, frames), log, truth))
    return scenario.seed, results


def run(
    dfpc: str,
    context: DfpcContext,
    samples: Sequence[Sample],
    port: str = "pose",
    *,
    parameters: Mapping[str, Any] | None = None,
) -> list[Product]:
    """Return the products of a DFPC on a port, default parameters unless given."""
    node = Registry.default().make_dfpc(dfpc)
    node.configure(parameters, context)
    runner = Runner(node)
    products: list[Product] = []
    for sample in sorted(samples, key=lambda s: (s.stamp_ns, s.port)):
        runner.push(sample)
        products += runner.drain()
    products += runner.finish()
    return [p for p in products if p.port == port and p.value is not None]


def visual_odometry(drive: TraverseRun, seed: int) -> list[Product]:
    """Return the poses ``T_vo_left`` of visual odometry on the image pairs of a drive."""
    context = replace(drive.context, seed=seed)
    pairs = drive.samples({"navcam.pair": "stereo"})
    return run("visual_odometry_sparse", context, pairs, parameters=SIMULATED_CAMERA)


def lidar_slam(drive: TraverseRun, port: str) -> list[Product]:
    """Return the poses of ``lidar_slam`` on the sweeps of a drive with wheel odometry: port ``pose`` or
    ``odometry``.
    """
    return run(
        "lidar_slam",
        drive.context,
        drive.samples({"lidar.scan": "scan", "wheels.odometry": "odometry"}),
        port,
    )


def normalised_error(T_true: se3.FloatArray, estimate: UncertainTransform) -> tuple[float, float]:
    """Return the position error, metres, and the NEES of the pose (6 degrees of freedom)."""
    error = pose_error(T_true, estimate.matrix)
    return float(np.linalg.norm(error[:3])), float(error @ np.linalg.solve(estimate.covariance, error))
