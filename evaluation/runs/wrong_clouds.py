# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Degenerate and wrong point clouds for the DFPCs that register clouds.

Two disjoint halves of a measured cloud are the two inputs, one of them moved by a known transform, so that
the truth is exact. A fault is applied to one half or to both before the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from evaluation.data_sets.clouds import devon_island
from evaluation.runs.wrong_input import Case, pose_error_sigmas

KITTI, DEVON = "KITTI 94, halves", "Devon Island, halves"
#: Motion between the two inputs: 0.36 m, and 2 degrees about z.
MOTION = se3.transform(se3.exp_so3(np.radians([0.0, 0.0, 2.0])), np.array([0.3, -0.2, 0.05]))
_FAR_M = 1e9
_PERIOD_NS = 100_000_000

Fault = Callable[[FloatArray], FloatArray]


def _with_values(value: float, fraction: float) -> Fault:
    def change(points_m: FloatArray) -> FloatArray:
        changed = points_m.copy()
        changed[np.random.default_rng(0).random(len(points_m)) < fraction] = value
        return changed

    return change


FAR = "offset of 10⁹ m"
#: Faults of one cloud, or of both.
FAULTS: dict[str, Fault] = {
    "none": lambda p: p,
    "empty": lambda p: p[:0],
    "one point": lambda p: p[:1],
    "identical points": lambda p: np.tile(p[:1], (len(p), 1)),
    "line": lambda p: p * [1.0, 0.0, 0.0],
    "plane": lambda p: p * [1.0, 1.0, 0.0],
    "1 % NaN": _with_values(np.nan, 0.01),
    "all NaN": _with_values(np.nan, 2.0),
    "1 % infinite": _with_values(np.inf, 0.01),
    "1 % at 10⁹ m": _with_values(_FAR_M, 0.01),
    FAR: lambda p: p + _FAR_M,
}
#: Faults that are also applied to both clouds.
OF_BOTH = ("line", "plane", FAR)


def cases(data: Path) -> Iterator[Case]:
    """Yield the cases of all DFPCs that register clouds."""
    T = MOTION
    street = read_kitti_bin(data / "kitti_velodyne" / "000094.bin").points_m.astype(np.float64)
    road = devon_island(data)[0]
    makers = {
        "icp_localisation": (KITTI, street, _scene_and_model),
        "point_cloud_matching": (DEVON, road, _target_and_source),
        "shot_localisation": (DEVON, road, _scene_and_model),
        "lidar_localisation": (KITTI, street, map_and_scan),
        "lidar_slam": (KITTI, street, two_scans),
    }
    for dfpc, (name, points_m, make) in makers.items():
        first, second = halves(points_m)
        for fault, change in FAULTS.items():
            yield _case(dfpc, name, fault, (first, change(second)), T, make)
            if fault in OF_BOTH:
                yield _case(dfpc, name, f"{fault}, both", (change(first), change(second)), T, make)


def halves(points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two disjoint random halves of a cloud."""
    rows, count = np.random.default_rng(1).permutation(len(points_m)), len(points_m) // 2
    return points_m[rows[:count]], points_m[rows[count : 2 * count]]


def _case(
    dfpc: str,
    data: str,
    fault: str,
    clouds: tuple[FloatArray, FloatArray],
    T: FloatArray,
    make: Callable[[FloatArray, FloatArray, FloatArray], list[Sample]],
) -> Case:
    """Return the case of two clouds in one frame; the second one is moved to its own frame by the inverse of
    ``T``.
    """
    first, second = clouds
    with np.errstate(invalid="ignore"):
        moved_points = se3.transform_points(se3.inverse(T), second)
    T_true = T
    if fault == FAR:  # of the second cloud only: it coincides with the first one after the offset
        T_true = se3.transform(T[:3, :3], T[:3, 3] - _FAR_M)
    port = "odometry" if dfpc == "lidar_slam" else "pose" if dfpc != "point_cloud_matching" else "transform"
    return Case(dfpc, data, fault, port, lambda: make(first, moved_points, T), pose_error_sigmas(T_true))


def _scene_and_model(scene: FloatArray, model: FloatArray, T: FloatArray) -> list[Sample]:
    return [_cloud("model", model), _cloud("scene", scene)]


def _target_and_source(target: FloatArray, source: FloatArray, T: FloatArray) -> list[Sample]:
    return [_cloud("target", target), _cloud("source", source)]


def _cloud(port: str, points_m: FloatArray) -> Sample:
    return Sample(port, 0, 0, Pointcloud.from_points(points_m, frame=f"robot/{port}", stamp_ns=0), id=port)


def map_and_scan(local_map: FloatArray, sweep: FloatArray, T: FloatArray) -> list[Sample]:
    """Return map, guess (0.2 m and 1 degree off, as stated) and sweep."""
    off = se3.transform(se3.exp_so3(np.radians([0.0, 0.0, 1.0])), np.array([0.2, 0.0, 0.0]))
    sigmas = np.repeat([0.2, np.radians(1.0)], 3)
    guess = TransformWithCovariance.from_transform(
        UncertainTransform(T @ off, np.diag(sigmas**2)), parent="map", child="robot/lidar", stamp_ns=0
    )
    cloud = Pointcloud.from_points(local_map, frame="map", stamp_ns=0)
    return [Sample("map", 0, 0, cloud), Sample("guess", 0, 0, guess), _scan(sweep, 0)]


def two_scans(first: FloatArray, second: FloatArray, T: FloatArray) -> list[Sample]:
    """Return two sweeps."""
    return [_scan(first, 0), _scan(second, 1)]


def _scan(points_m: FloatArray, index: int) -> Sample:
    stamp_ns = index * _PERIOD_NS
    with np.errstate(over="ignore"):
        scan = LidarScan.from_arrays(
            points_m.astype(np.float32),
            np.zeros(len(points_m), np.uint32),
            frame="robot/lidar",
            t0_ns=stamp_ns,
            t1_ns=stamp_ns,
        )
    return Sample("scan", stamp_ns, index, scan)
