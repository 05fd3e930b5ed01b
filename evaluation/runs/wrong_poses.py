# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wrong poses, covariances and time stamps for the DFPCs with an input port for poses.

The fault changes the samples of one port: a part of them (``_FAULTY``) or, for covariances, all. The truth of
the real drive is the output without the fault; the drive on an orbital model is simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import ElevationMap, Pointcloud, TransformWithCovariance
from evaluation.data_sets import husky
from evaluation.runs.wrong_clouds import KITTI, MOTION, halves, map_and_scan, two_scans
from evaluation.runs.wrong_input import Case, field_error_sigmas, last_value, pose_error_sigmas
from evaluation.runs.wrong_maps import drive
from evaluation.scenes.orbital import Ground

HUSKY, SIMULATED = "Husky, first 60 s", "simulated drive"
_GROUND = 750
_HUSKY_NS = 60_000_000_000
#: Samples of the port that are faulty, as fractions of all.
_FAULTY = (0.5, 0.55)
_BACK_NS = 2_000_000_000

#: Changes of a pose message.
Change = Callable[[TransformWithCovariance], TransformWithCovariance]


def _changed(**fields: Any) -> Change:
    """Return a function that replaces fields of the data of a message."""
    return lambda value: replace(value, data=replace(value.data, **fields))


def _scaled_quaternion(value: TransformWithCovariance) -> TransformWithCovariance:
    return replace(value, data=replace(value.data, orientation=1.5 * value.data.orientation))


#: Faults of a part of the samples, and of all samples.
OF_PART: dict[str, Change] = {
    "NaN translation": _changed(translation=np.full(3, np.nan)),
    "NaN quaternion": _changed(orientation=np.full(4, np.nan)),
    "quaternion of length 1.5": _scaled_quaternion,
    "translation of 10⁹ m": _changed(translation=np.full(3, 1e9)),
}
OF_ALL: dict[str, Change] = {
    "none": lambda value: value,
    "NaN covariance": _changed(cov=np.full((6, 6), np.nan)),
    "infinite covariance": _changed(cov=np.diag(np.full(6, np.inf))),
    "zero covariance": _changed(cov=np.zeros((6, 6))),
    "negative covariance": _changed(cov=-np.eye(6)),
}
BACKWARDS = "stamps 2 s backwards"


def cases(data: Path) -> Iterator[Case]:
    """Yield the cases of all DFPCs with poses."""
    for dfpc, make in _SCENES.items():
        name, port, output, samples, context, error_sigmas = make(data)
        for fault in (*OF_ALL, *OF_PART, BACKWARDS):
            yield Case(
                dfpc,
                name,
                f"{port}: {fault}",
                output,
                partial(_faulty, samples, port, fault),
                error_sigmas,
                context,
            )


def _faulty(samples: Sequence[Sample], port: str, fault: str) -> list[Sample]:
    """Return the samples with a fault in those of a port."""
    rows = [i for i, s in enumerate(samples) if s.port == port]
    if fault not in OF_ALL:
        first, last = (int(f * len(rows)) for f in _FAULTY)
        rows = rows[first : max(last, first + 1)]
    results = list(samples)
    for i in rows:
        sample = results[i]
        if fault == BACKWARDS:
            results[i] = replace(sample, stamp_ns=max(sample.stamp_ns - _BACK_NS, 0))
        else:
            results[i] = replace(sample, value=(OF_ALL | OF_PART)[fault](sample.value))
    return results


Scene = tuple[str, str, str, list[Sample], DfpcContext, Callable[[Any], float]]


def _position_manager(data: Path) -> Scene:
    drive = husky.read_drive(data / husky.FILE)
    samples = sorted(
        (s for p in ("odometry", "imu") for s in drive.samples[p]), key=lambda s: (s.stamp_ns, s.port)
    )
    samples = [s for s in samples if s.stamp_ns < samples[0].stamp_ns + _HUSKY_NS]
    T_true = last_value("position_manager", samples, drive.context, "pose").transform.matrix
    return HUSKY, "odometry", "pose", samples, drive.context, pose_error_sigmas(T_true)


def _absolute_localisation(data: Path) -> Scene:
    samples, error_sigmas = drive(Ground.make(_GROUND))
    return SIMULATED, "poses", "pose", samples, DfpcContext("mana"), error_sigmas


def _lidar_slam(data: Path) -> Scene:
    """Return two sweeps with exact odometry around them."""
    street, T = read_kitti_bin(data / "kitti_velodyne" / "000094.bin").points_m.astype(np.float64), MOTION
    poses = [
        _pose("odometry", i, k, "robot/odom", "robot/base", np.eye(4) if k < 50 else T, 1e-4)
        for i, k in enumerate(range(0, 101, 10))
    ]
    samples = sorted([*two_scans(*_moved_halves(street), T), *poses], key=lambda s: (s.stamp_ns, s.port))
    return KITTI, "odometry", "odometry", samples, DfpcContext("robot"), pose_error_sigmas(T)


def _lidar_localisation(data: Path) -> Scene:
    street, T = read_kitti_bin(data / "kitti_velodyne" / "000094.bin").points_m.astype(np.float64), MOTION
    samples = map_and_scan(*_moved_halves(street), T)
    return KITTI, "guess", "pose", samples, DfpcContext("robot"), pose_error_sigmas(T)


def _icp_localisation(data: Path) -> Scene:
    street, T = read_kitti_bin(data / "kitti_velodyne" / "000094.bin").points_m.astype(np.float64), MOTION
    first, _, scan = map_and_scan(*_moved_halves(street), T)
    guess = _pose("guess", 0, 0, "robot/scene", "robot/model", T, 1e-2)
    model = Pointcloud.from_points(scan.value.points_m, frame="robot/model", stamp_ns=0)
    samples = [
        Sample("model", 0, 0, model),
        guess,
        Sample("scene", 0, 0, first.value),
    ]
    return KITTI, "guess", "pose", samples, DfpcContext("robot"), pose_error_sigmas(T)


def _digital_elevation_mapping(data: Path) -> Scene:
    """Return one cloud between poses of a robot at rest; the truth is the map without a fault."""
    street = read_kitti_bin(data / "kitti_velodyne" / "000094.bin").points_m.astype(np.float64)
    cloud = Pointcloud.from_points(street, frame="robot/base", stamp_ns=50_000_000)
    poses = [_pose("poses", i, 10 * i, "site", "robot/base", np.eye(4), 1e-4) for i in range(11)]
    samples = sorted([*poses, Sample("cloud", 50_000_000, 0, cloud)], key=lambda s: (s.stamp_ns, s.port))
    context = DfpcContext("robot")
    truth: ElevationMap = last_value("digital_elevation_mapping", samples, context, "map")

    def error(value: ElevationMap) -> float:
        if value.geometry != truth.geometry:
            return float("inf")
        heights, true_heights, variance = (
            m.layer(name).astype(np.float64)
            for m, name in ((value, "mean"), (truth, "mean"), (value, "variance"))
        )
        return field_error_sigmas(heights - true_heights, np.sqrt(variance))

    return KITTI, "poses", "map", samples, context, error


_SCENES: dict[str, Callable[[Path], Scene]] = {
    "position_manager": _position_manager,
    "absolute_localisation": _absolute_localisation,
    "lidar_slam": _lidar_slam,
    "lidar_localisation": _lidar_localisation,
    "icp_localisation": _icp_localisation,
    "digital_elevation_mapping": _digital_elevation_mapping,
}


def _moved_halves(points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    first, second = halves(points_m)
    return first, se3.transform_points(se3.inverse(MOTION), second)


def _pose(
    port: str, seq: int, milliseconds: int, parent: str, child: str, T: FloatArray, variance: float
) -> Sample:
    stamp_ns = milliseconds * 1_000_000
    uncertain = UncertainTransform(T, variance * np.eye(6))
    value = TransformWithCovariance.from_transform(uncertain, parent=parent, child=child, stamp_ns=stamp_ns)
    return Sample(port, stamp_ns, seq, value)
