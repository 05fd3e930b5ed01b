# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compounds of the one-command estimations, by command and sensor."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_dev.logs.source import LogSource


@dataclass(frozen=True, slots=True)
class Method:
    """Compound of a command.

    Attributes
    ----------
    name : str
        Name of the command.
    dfpc : str
        Compound; its output port ``pose`` is the trajectory.
    port : str
        Input port of the sensor.
    type_name : str
        ASN.1 type of this port.
    unit : str
        Name of the samples, for the progress.
    hint : str
        What to do with a log without this sensor.
    merges_parts : bool
        FAILED poses do not end the path: later images connect its parts, up to the end.
    """

    name: str
    dfpc: str
    port: str
    type_name: str
    unit: str
    hint: str
    merges_parts: bool = False


LIDAR_SLAM = Method(
    "slam", "lidar_slam", "scan", "LidarScan", "sweeps", "expected lidar scans, stereo pairs or RGB-D images"
)
STEREO_SLAM = Method("slam", "visual_slam", "pair", "FramePair", "pairs", LIDAR_SLAM.hint, True)
RGBD_SLAM = Method("slam", "visual_slam", "image", "Frame", "images", LIDAR_SLAM.hint, True)
STEREO_ODOMETRY = Method(
    "vo", "visual_odometry_sparse", "stereo", "FramePair", "pairs", "for other sensors use cdff slam"
)


def method_for(name: str, log: LogSource, stream: str | None = None) -> Method:
    """Return the method of a command for a log.

    ``cdff slam`` uses the lidar if there is one, else stereo pairs, else images with depth images; ``cdff
    dem`` the lidar or else stereo pairs. If ``stream`` is given, its type decides.
    """
    types = {info.type_name for info in log.streams.values()}
    if stream in log.streams:
        types &= {log.streams[stream].type_name, "DistanceImage"}
    if name == STEREO_ODOMETRY.name:
        return STEREO_ODOMETRY
    if LIDAR_SLAM.type_name in types:
        return LIDAR_SLAM
    if STEREO_SLAM.type_name in types:
        return STEREO_SLAM if name == "slam" else STEREO_ODOMETRY
    is_rgbd = name == "slam" and {RGBD_SLAM.type_name, "DistanceImage"} <= types
    return RGBD_SLAM if is_rgbd else LIDAR_SLAM
