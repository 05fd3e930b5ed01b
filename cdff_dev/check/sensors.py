# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensors of a log against each other and against the mounts of a profile."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cdff_common.geometry import se3
from cdff_common.interfaces.description import InputPort
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.profile import Robot
from cdff_core.consistency.finding import CLOCK, ROTATION
from cdff_core.consistency.monitor import SensorMonitor
from cdff_dev.check.log import StreamFinding
from cdff_dev.logs import LogSource

#: Types of the streams that are compared.
_TYPES = ("IMUSensors", "TransformWithCovariance", "LidarScan")


def sensor_comparison(log: LogSource, robot: Robot) -> SensorMonitor | None:
    """Return the comparison of the sensors of a robot after a log; None without streams to compare.

    The streams of the sensors of the profile are used, not those of DFPCs, so that the log needs no products.
    """
    ports = {
        f"/{robot.id}/{name}.{stream}": InputPort(name=f"{name}_{stream}", type=type_name, compared=True)
        for name, sensor in robot.sensors.items()
        for stream, type_name in sensor.streams.items()
        if type_name in _TYPES
    }
    in_log = {stream: info.type_name for stream, info in log.streams.items() if info.count}
    selected = [stream for stream, port in ports.items() if in_log.get(stream) == port.type_name]
    if not selected:
        return None
    sensors = {name: sensor.model_dump() for name, sensor in robot.sensors.items()}
    context = DfpcContext(robot.id, robot.frame_graph(), sensors=sensors, urdf=robot.urdf)
    monitor = SensorMonitor(context, [ports[stream] for stream in selected])
    frames = {f"/{robot.id}/{n}.{stream}": s.frame for n, s in robot.sensors.items() for stream in s.streams}
    for item in log.samples(selected):
        sample = item.to_sample(ports[item.stream].attribute, robot.id)
        monitor.add(replace(sample, frame=sample.frame or frames[item.stream]))
    return monitor


def comparison_findings(monitor: SensorMonitor, robot: str) -> Iterator[StreamFinding]:
    """Yield the sensors whose mount or clock contradicts the others."""
    for finding in monitor.history:
        if finding.kind in (ROTATION, CLOCK):
            yield StreamFinding(f"/{robot}/{finding.name}", f"{finding.what}; {finding.remedy}", "error")


def comparison_lines(monitor: SensorMonitor) -> Iterator[str]:
    """Yield the vertical of each sensor and the relation of each pair of sensors in words."""
    verticals, relations = monitor.estimates()
    for name, vertical in verticals.items():
        angle, sigma = np.degrees([vertical.angle_rad, vertical.sigma_rad])
        yield f"{name}: its vertical is {angle:.1f} deg (sigma {sigma:.1f}) from the z axis of the base"
    for (first, second), relation in relations.items():
        rotation = ", ".join(f"{v:.1f}" for v in np.degrees(se3.log_so3(relation.rotation)))
        sigma_deg = ", ".join(f"{v:.1f}" for v in np.degrees(np.sqrt(np.diag(relation.covariance))))
        unknown = (
            f"; not observable about {', '.join(relation.unobservable)}" if relation.unobservable else ""
        )
        yield (
            f"{second} against {first}: stamps {relation.offset_s:+.2f} s (sigma "
            f"{relation.offset_sigma_s:.2f}), rotation [{rotation}] deg (sigma [{sigma_deg}]){unknown}"
        )
