# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motions in a log: the wheels' poses, readings of IMUs, and trajectories of lidars and stereo cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.foreign_names import is_anchor, is_fix, is_mount
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.registry import Registry
from cdff_common.progress import Progress
from cdff_core.runtime import Runner
from cdff_dev.logs.source import LogSample, LogSource, split_stream
from cdff_dev.replay.engine import samples_of
from cdff_dev.slam.methods import LIDAR_SLAM, STEREO_ODOMETRY

#: Type of a stream with a trajectory to be estimated -> method that estimates it.
ODOMETRIES = {method.type_name: method for method in (LIDAR_SLAM, STEREO_ODOMETRY)}


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses ``(n, 4, 4)`` of a frame at ascending stamps ``(n,)`` in a fixed frame of its own."""

    frame: str
    stamps_ns: NDArray[np.int64]
    poses: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Inertial:
    """Readings of an IMU: stamps ``(n,)``, specific force ``(n, 3)``, m/s², and angular rate, rad/s."""

    frame: str
    stamps_ns: NDArray[np.int64]
    force_m_s2: FloatArray
    rate_rad_s: FloatArray


def wheel_stream(log: LogSource, robot: str, chosen: str | None = None) -> str:
    """Return the stream of wheel odometry: ``chosen``, or else the only stream of estimated poses.

    Raises
    ------
    InputError
        If there is none, or several.
    """
    names = [
        name
        for name, info in log.streams.items()
        if info.type_name == "TransformWithCovariance"
        and info.count
        and _is_of(name, robot)
        and "/truth." not in name
        and not is_fix(name)
        and not is_anchor(name)
        and not is_mount(name)
    ]
    if chosen is not None:
        if chosen not in names:
            raise InputError(f"--wheels {chosen}: expected one of {', '.join(names) or 'no stream of poses'}")
        return chosen
    if len(names) != 1:
        listed_streams = ", ".join(names) or "none"
        raise InputError(
            f"streams of poses of {robot}: {listed_streams}; expected one of wheel odometry, see --wheels"
        )
    return names[0]


def sensor_streams(log: LogSource, robot: str) -> list[str]:
    """Return the streams of the IMUs, lidars and stereo cameras of a robot."""
    types = {"IMUSensors", *ODOMETRIES}
    return [
        n for n, info in log.streams.items() if info.type_name in types and info.count and _is_of(n, robot)
    ]


def recorded_poses(log: LogSource, stream: str) -> Trajectory:
    """Return the poses of a stream, in the order of their stamps, without repeated stamps."""
    stamps, samples = _ordered(log, stream)
    poses = np.array([sample.value.transform.matrix for sample in samples])
    return Trajectory(samples[0].value.child_frame, stamps, poses)


def inertial(log: LogSource, stream: str) -> Inertial:
    """Return the readings of an IMU."""
    stamps, samples = _ordered(log, stream)
    force, rates = (np.array([getattr(s.value, name) for s in samples]) for name in ("acc", "gyro"))
    return Inertial(frame_of(log, stream), stamps, force, rates)


def _ordered(log: LogSource, stream: str) -> tuple[NDArray[np.int64], list[LogSample]]:
    """Return the stamps and samples of a stream in the order of time, the first one of each stamp."""
    samples = list(log.samples([stream]))
    stamps, index = np.unique(np.array([s.stamp_ns for s in samples], dtype=np.int64), return_index=True)
    return stamps, [samples[i] for i in index]


def estimated_trajectory(log: LogSource, stream: str) -> Trajectory:
    """Return the trajectory of a lidar or stereo camera by its own odometry, without other sensors.

    Raises
    ------
    InputError
        If no sample could be used.
    """
    robot, _, _ = split_stream(stream)
    info = log.streams[stream]
    method = ODOMETRIES[info.type_name]
    dfpc = Registry.default().make_dfpc(method.dfpc)
    dfpc.configure({}, DfpcContext(robot))
    runner, poses = Runner(dfpc), {}
    progress = Progress(info.count, method.unit)
    for sample in samples_of(log, {method.port: stream}, robot):
        runner.push(sample)
        for product in runner.drain():
            if product.port == "pose" and product.value is not None:
                poses[product.header.t1_ns] = product.value.transform.matrix
        progress.advance()
    progress.close()
    if len(poses) < 2:
        raise InputError(f"{stream}: {method.dfpc} located {len(poses)} of {info.count} {method.unit}")
    stamps = np.array(sorted(poses), dtype=np.int64)
    return Trajectory(frame_of(log, stream), stamps, np.array([poses[int(t)] for t in stamps]))


def frame_of(log: LogSource, stream: str) -> str:
    """Return the frame of the samples of a stream: that of the first one."""
    robot, sensor, _ = split_stream(stream)
    first = next(iter(log.samples([stream])))
    return first.to_sample("", robot).frame or getattr(first.value, "frame", "") or f"{robot}/{sensor}"


def _is_of(stream: str, robot: str) -> bool:
    """Return whether a stream belongs to a robot; False for names that are no stream."""
    try:
        return split_stream(stream)[0] == robot
    except InputError:
        return False
