# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulate the hard scenarios with or without faults, run DFPCs, and compare with the truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ElevationMap
from cdff_core.runtime import Runner
from cdff_dev.compare.elevation import compare
from cdff_dev.logs import open_log
from cdff_dev.simulate.faults.camera import CameraFaults
from cdff_dev.simulate.faults.lidar import LidarFaults
from cdff_dev.simulate.faults.model import Faults
from cdff_dev.simulate.faults.spinning_lidar import draw_mount
from cdff_dev.simulate.faults.stereo_camera import draw_eyes
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.store import describe, simulated_log
from cdff_dev.simulate.traverse import levelled
from cdff_dev.simulate.world import generator

ROBOT = "mana"
#: Scenarios by use; their grounds differ in spectrum, slope, craters, rocks and seed.
SCENARIOS = {
    "training": ("hard_training_slope", "hard_training_gravel"),
    "test": ("hard_test_dunes", "hard_test_boulders"),
}
#: Streams of the log, by name of a sensor.
_STREAMS = {
    "scan": "lidar.scan",
    "stereo": "navcam.pair",
    "odometry": "wheels.odometry",
    "imu": "imu.sample",
}


@dataclass(frozen=True, slots=True, eq=False)
class HardDrive:
    """A simulated drive.

    Attributes
    ----------
    context : DfpcContext
        The frames as stated in the log.
    samples : dict of str to list of Sample
        Samples by port: scan, stereo, odometry, imu.
    stamps_ns : NDArray[np.int64], shape (n,)
    truth : NDArray[np.float64], shape (n, 4, 4)
        ``T_site_base`` at the stamps.
    terrain : ElevationMap
        True terrain with rocks.
    """

    scenario: Scenario
    context: DfpcContext
    samples: dict[str, list[Sample]]
    stamps_ns: np.ndarray
    truth: FloatArray
    terrain: ElevationMap

    @property
    def path_length_m(self) -> float:
        """Length of the driven path."""
        return float(np.linalg.norm(np.diff(self.truth[:, :3, 3], axis=0), axis=1).sum())

    def true_pose(self, stamp_ns: int) -> FloatArray:
        """Return ``T_site_base`` at a time, interpolated; the first or last one outside the drive."""
        t = int(np.clip(stamp_ns, self.stamps_ns[0], self.stamps_ns[-1]))
        k = int(np.clip(np.searchsorted(self.stamps_ns, t, side="right") - 1, 0, len(self.truth) - 2))
        fraction = (t - int(self.stamps_ns[k])) / int(self.stamps_ns[k + 1] - self.stamps_ns[k])
        return se3.interpolate_transform(self.truth[k], self.truth[k + 1], fraction)


def simulate_drive(name: str, *, with_faults: bool) -> HardDrive:
    """Return the drive of a scenario, or the same drive of sensors without faults."""
    data = load_scenario(name).model_dump()
    scenario = Scenario.model_validate(data if with_faults else data | {"faults": None})
    log = open_log(simulated_log(scenario, workers=0))
    poses = list(log.samples([f"/{ROBOT}/truth.pose"]))
    truth = np.array([s.value.transform.matrix for s in poses])
    frames = FrameGraph()
    for edge in describe(scenario, {ROBOT: levelled(truth[0])})["robots"][ROBOT]["frames"]:
        T = se3.transform_from_quaternion_xyzw(edge["translation_m"], edge["quaternion_xyzw"])
        frames.set_static(edge["parent"], edge["child"], UncertainTransform.exact(T))
    samples = {
        port: [Sample(port, s.stamp_ns, s.seq, s.value) for s in log.samples([f"/{ROBOT}/{stream}"])]
        for port, stream in _STREAMS.items()
    }
    terrain = next(iter(log.samples(["/site/truth.terrain"]))).value
    log.close()
    stamps_ns = np.array([s.stamp_ns for s in poses])
    return HardDrive(scenario, DfpcContext(ROBOT, frames), samples, stamps_ns, truth, terrain)


def products(
    dfpc: str,
    drive: HardDrive,
    samples: Sequence[Sample],
    port: str,
    *,
    variant: str | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> list[Product]:
    """Return all products on a port, also those without a value; default parameters unless given."""
    node = Registry.default().make_dfpc(dfpc)
    node.configure(parameters, drive.context, variant)
    runner = Runner(node)
    result: list[Product] = []
    for sample in sorted(samples, key=lambda s: (s.stamp_ns, s.port)):
        runner.push(sample)
        result += runner.drain()
    result += runner.finish()
    return [p for p in result if p.port == port]


def as_samples(results: Sequence[Product], port: str) -> list[Sample]:
    """Return products with a value as samples for a port of another DFPC."""
    return [
        Sample(port, p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality)
        for p in results
        if p.value is not None
    ]


def pose_scores(drive: HardDrive, results: Sequence[Product], sensor: str | None) -> dict[str, Any]:
    """Return errors of poses, NEES (6 expected), and the counts by status.

    Parameters
    ----------
    sensor : str or None
        Sensor, navcam_left or lidar, whose motion since the first pose is estimated; None: the poses are
        ``T_site_base``.

    Notes
    -----
    ``ok_beyond_3_sigma`` is the fraction of the OK poses with one of six errors above three stated sigmas.
    """
    located = [p for p in results if p.value is not None]
    row: dict[str, Any] = status_scores(results)
    if len(located) < 2:
        return row
    expected = _expected_poses(drive, located, sensor)
    errors = np.array(
        [pose_error(T, p.value.transform.matrix) for T, p in zip(expected, located, strict=True)]
    )
    covariances = np.array([p.value.transform.covariance for p in located])
    usable = np.linalg.eigvalsh(covariances)[:, 0] > 0.0
    squared = np.array(
        [e @ np.linalg.solve(C, e) for e, C in zip(errors[usable], covariances[usable], strict=True)]
    )
    sigmas = np.sqrt(np.einsum("nii->ni", covariances[usable]))
    beyond = (np.abs(errors[usable]) > 3.0 * sigmas).any(axis=1)
    ok = np.array([p.header.quality.status.value == "OK" for p in located])[usable]
    distance_m = np.linalg.norm(errors[:, :3], axis=1)
    return row | {
        "end_error_m": round(float(distance_m[-1]), 4),
        "end_error_percent": round(100.0 * float(distance_m[-1]) / drive.path_length_m, 3),
        "rms_error_m": round(float(np.sqrt(np.mean(distance_m**2))), 4),
        "end_rotation_deg": round(float(np.degrees(np.linalg.norm(errors[-1, 3:]))), 3),
        "squared_error_end": round(float(squared[-1]), 1) if usable[-1] else None,
        "squared_error_median": round(float(np.median(squared)), 1) if len(squared) else None,
        "ok_beyond_3_sigma": round(float(beyond[ok].mean()), 3) if ok.any() else None,
    }


def status_scores(results: Sequence[Product]) -> dict[str, Any]:
    """Return the number of products, the fractions DEGRADED and FAILED, and the reasons."""
    counts = Counter(p.header.quality.status.value for p in results)
    reasons = Counter(reason.split(":")[0] for p in results for reason in p.header.quality.reasons)
    total = max(len(results), 1)
    return {
        "products": len(results),
        "degraded": round(counts["DEGRADED"] / total, 3),
        "failed": round(counts["FAILED"] / total, 3),
        "reasons": dict(reasons.most_common(5)),
    }


def elevation_scores(drive: HardDrive, results: Sequence[Product]) -> dict[str, Any]:
    """Return the errors of the last elevation map, if it overlaps the truth, and the counts by status."""
    row = status_scores(results)
    maps = [p.value for p in results if p.value is not None]
    if not maps:
        return row
    try:
        comparison = compare(maps[-1], drive.terrain)
    except InputError:
        return row  # the estimated position is outside the true terrain, and with it the map
    aligned = compare(maps[-1], drive.terrain, remove_shift=True)
    names = ("bias_m", "rmse_m", "nmad_m", "within_90_percent")
    return row | {
        **{name: round(float(comparison[name]), 4) for name in names},
        "rmse_without_shift_and_tilt_m": round(float(aligned["rmse_m"]), 4),
    }


def _expected_poses(drive: HardDrive, located: Sequence[Product], sensor: str | None) -> list[FloatArray]:
    """Return the true poses in the frame of the estimate, which the first estimate defines."""
    true = [drive.true_pose(p.header.t1_ns) for p in located]
    if sensor is None:
        return true
    mount = _true_mount(drive.scenario, sensor)
    T_frame_site = located[0].value.transform.matrix @ se3.inverse(true[0] @ mount)
    return [T_frame_site @ T @ mount for T in true]


def _true_mount(scenario: Scenario, sensor: str) -> FloatArray:
    """Return the true ``T_base_sensor``: the estimated motion of a sensor has no errors of its mount."""
    faults = scenario.faults or Faults()
    if sensor == "lidar":
        rng = generator(scenario, "fault_lidar_rig", 0)
        return draw_mount(scenario.lidar, faults.lidar or LidarFaults(), rng)
    assert scenario.navcam is not None  # all hard scenarios have a camera
    rng = generator(scenario, "fault_camera_rig", 0)
    return draw_eyes(scenario.navcam, faults.camera or CameraFaults(), rng)[0].T_base_camera
