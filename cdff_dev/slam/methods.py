# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compounds of the one-command estimations, by the name of the command."""

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
    """

    name: str
    dfpc: str
    port: str
    type_name: str
    unit: str
    hint: str


METHODS = {
    method.name: method
    for method in (
        Method("slam", "lidar_slam", "scan", "LidarScan", "sweeps", "for stereo pairs use cdff vo"),
        Method(
            "vo", "visual_odometry_sparse", "stereo", "FramePair", "pairs", "for lidar scans use cdff slam"
        ),
    )
}


def method_for(log: LogSource) -> Method:
    """Return the method of the sensor that a log has: the lidar if it has one, otherwise stereo."""
    types = {info.type_name for info in log.streams.values()}
    slam, vo = METHODS["slam"], METHODS["vo"]
    return vo if vo.type_name in types and slam.type_name not in types else slam
