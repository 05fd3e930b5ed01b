# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read the drive of a skid-steered Clearpath Husky: wheels, IMU and GPS in a ROS 1 bag.

The IMU is mounted with its y axis up; ``T_BASE_IMU`` was determined from gravity and from the direction of
motion. GPS positions are converted to metres east and north of the first one.

The driver of the receiver states the square of the horizontal dilution of precision as variance, in square
metres, and calls it approximated: it assumes a standard deviation of 1 m at a dilution of 1, whatever the
kind of fix. ``gps_variance_m2`` has the standard deviation of a receiver with WAAS instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from scipy.stats import chi2

from cdff_common.errors import InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import IMUSensors, Time, TransformWithCovariance

FOLDER, ROBOT = "rosbags", "husky"
FILE = f"{FOLDER}/husky_first_150s.bag"
WHEELS, IMU, GPS = "/husky_velocity_controller/odom", "/imu/data", "/fix"
T_BASE_IMU = se3.transform([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], [0.0, -0.3, 0.52])
#: Semi-major axis (m) and squared eccentricity of WGS 84.
_AXIS_M, _ECCENTRICITY_2 = 6_378_137.0, 6.694_379_990_14e-3
#: Horizontal error of a position corrected by WAAS that 95 % of the errors are below, metres, by the data
#: sheet of a receiver (Garmin GPS 18x, 190-00879-08, 1.5.4.4). The receiver of the Husky is not known.
_WAAS_95_M = 3.0
#: Standard deviation of one coordinate at a dilution of 1 for these errors, metres.
GPS_SIGMA_M = _WAAS_95_M / float(np.sqrt(chi2.ppf(0.95, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Samples of a drive by port, the wheels' speed, and positions by GPS.

    Attributes
    ----------
    wheel_speed_m_s : array, shape (n,)
        Forward speed stated with each sample of port ``odometry``.
    gps_ns : array, shape (m,)
        Times of the positions.
    gps_m, gps_variance_m2 : array, shape (m, 2)
        East and north, and their variances.
    gps_stated_variance_m2 : array, shape (m, 2)
        The variances that the driver of the receiver states.
    """

    context: DfpcContext
    samples: dict[str, list[Sample]]
    wheel_speed_m_s: FloatArray
    gps_ns: np.ndarray
    gps_m: FloatArray
    gps_variance_m2: FloatArray
    gps_stated_variance_m2: FloatArray


def read_drive(path: Path) -> Drive:
    """Read a bag; raises InputError if one of its three topics is missing."""
    messages: dict[str, list[Any]] = {WHEELS: [], IMU: [], GPS: []}
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic in messages]
        if {c.topic for c in connections} != messages.keys():
            raise InputError(f"{path}: expected the topics {', '.join(messages)}")
        for connection, _, raw in reader.messages(connections=connections):
            messages[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    frames = FrameGraph()
    frames.set_static("site", f"{ROBOT}/odom", UncertainTransform.exact(np.eye(4)))
    frames.set_static(f"{ROBOT}/base", f"{ROBOT}/imu", UncertainTransform.exact(T_BASE_IMU))
    wheels, fixes = messages[WHEELS], [m for m in messages[GPS] if m.status.status >= 0]
    samples = {
        "odometry": [_wheel_sample(k, m) for k, m in enumerate(wheels)],
        "imu": [_imu_sample(k, m) for k, m in enumerate(messages[IMU])],
    }
    stated_variance_m2 = np.array([np.asarray(m.position_covariance)[[0, 4]] for m in fixes])
    return Drive(
        DfpcContext(ROBOT, frames),
        samples,
        np.array([m.twist.twist.linear.x for m in wheels]),
        np.array([_stamp_ns(m) for m in fixes]),
        _east_north(np.array([[m.latitude, m.longitude, m.altitude] for m in fixes])),
        GPS_SIGMA_M**2 * stated_variance_m2,
        stated_variance_m2,
    )


def _stamp_ns(message: Any) -> int:
    """Return the time of a message, rounded to microseconds (the resolution of CDFF)."""
    stamp = message.header.stamp
    return round((stamp.sec * 1_000_000_000 + stamp.nanosec) / 1000.0) * 1000


def _wheel_sample(k: int, message: Any) -> Sample:
    stamp_ns, pose = _stamp_ns(message), message.pose.pose
    position, q = pose.position, pose.orientation
    T = se3.transform_from_quaternion_xyzw(
        [position.x, position.y, position.z], np.array([q.x, q.y, q.z, q.w])
    )
    covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent=f"{ROBOT}/odom", child=f"{ROBOT}/base", stamp_ns=stamp_ns
    )
    return Sample("odometry", stamp_ns, k, value)


def _imu_sample(k: int, message: Any) -> Sample:
    stamp_ns = _stamp_ns(message)
    force, rate = message.linear_acceleration, message.angular_velocity
    value = IMUSensors(
        Time.from_ns(stamp_ns),
        np.array([force.x, force.y, force.z]),
        np.array([rate.x, rate.y, rate.z]),
        np.zeros(3),
    )
    return Sample("imu", stamp_ns, k, value)


def _east_north(geodetic: FloatArray) -> FloatArray:
    """Return positions (n, 2) in metres east and north of the first one.

    ``geodetic`` (n, 3) contains latitude and longitude, degrees, and height, metres.
    """
    latitude, longitude = np.radians(geodetic[:, :2]).T
    w2 = 1.0 - _ECCENTRICITY_2 * np.sin(latitude[0]) ** 2
    meridian_m = _AXIS_M * (1.0 - _ECCENTRICITY_2) / w2**1.5 + geodetic[0, 2]
    parallel_m = (_AXIS_M / np.sqrt(w2) + geodetic[0, 2]) * np.cos(latitude[0])
    return np.column_stack([(longitude - longitude[0]) * parallel_m, (latitude - latitude[0]) * meridian_m])
