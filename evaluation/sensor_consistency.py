# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the comparison of sensors: false alarms in good drives, detection time of faults, and CPU time.

Each drive is rover ``mana`` of ``rover_traverse`` on other terrain, with slip, IMU and lidar of the scenario,
on a coarser grid and without images. Increments of visual odometry, and the fused pose that a map is made
with, are the true ones with normal errors. A fault is a wrong mount in the profile or shifted stamps, with
unchanged data. Seeds 0 to 9 and 1000 to 1049 were used during development.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.consistency.monitor import SensorMonitor
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.traverse import simulate

ROBOT = "mana"
GOOD_SEEDS, FAULT_SEEDS = range(2000, 2050), range(2000, 2010)
#: Standard deviations of an increment of visual odometry, and of the fused pose: m, rad.
_VISUAL_SIGMA = np.array([1e-3] * 3 + [2e-4] * 3)
_FUSED_SIGMA = np.array([1e-3] * 3 + [5e-4] * 3)
#: Every n-th true pose (20 Hz) is a pose of visual odometry, and a fused pose.
_VISUAL_STEP, _FUSED_STEP = 6, 6
_POSITION, _MAPPING = "position_manager", "digital_elevation_mapping"
_PORTS = {"imu.sample": "imu", "wheels.odometry": "odometry", "lidar.scan": "scan"}
_PORTS_OF = {_POSITION: ("imu", "odometry", "visual_odometry"), _MAPPING: ("scan", "poses")}
_FRAMES = {"imu": "imu", "scan": "lidar", "visual_odometry": "navcam_left"}
_SENSORS = {
    "imu": {"frame": f"{ROBOT}/imu", "streams": {"sample": "IMUSensors"}},
    "wheels": {"frame": f"{ROBOT}/base", "streams": {"odometry": "TransformWithCovariance"}},
    "navcam": {"frame": f"{ROBOT}/navcam_left", "streams": {"pair": "FramePair"}},
    "lidar": {"frame": f"{ROBOT}/lidar", "streams": {"scan": "LidarScan"}},
}


@dataclass(frozen=True)
class Fault:
    """A mistake of the integrator.

    Attributes
    ----------
    name : str
    dfpc : str
        DFPC whose inputs are compared.
    sensor : str
        Sensor that is to be named.
    kind : str
        Kind of the finding.
    frame : str
        Frame whose mount is wrong.
    rpy_deg : tuple of float
        Rotation by which the stated mount differs from the true one, applied first.
    form : str
        ``rotated``, ``body`` (axes of the base instead of those of a camera) or ``inverse``.
    port, offset_s
        Port whose stamps are shifted.
    """

    name: str
    dfpc: str
    sensor: str
    kind: str = "sensor_rotation"
    frame: str = ""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    form: str = "rotated"
    port: str = ""
    offset_s: float = 0.0


FAULTS = (
    Fault("lidar upside down", _MAPPING, "lidar", frame="lidar", rpy_deg=(180.0, 0.0, 0.0)),
    Fault(
        "lidar tilt of 15° with the wrong sign", _MAPPING, "lidar", frame="lidar", rpy_deg=(0.0, 30.0, 0.0)
    ),
    Fault("IMU turned by 90°", _POSITION, "imu", frame="imu", rpy_deg=(0.0, 0.0, 90.0)),
    Fault("IMU upside down", _POSITION, "imu", frame="imu", rpy_deg=(180.0, 0.0, 0.0)),
    Fault("camera axes forward-left-up", _POSITION, "navcam", frame="navcam_left", form="body"),
    Fault("camera pose inverted", _POSITION, "navcam", frame="navcam_left", form="inverse"),
    Fault("clock of the IMU 1 s ahead", _POSITION, "imu", "sensor_clock", port="imu", offset_s=1.0),
    Fault(
        "clock of the wheels 1 s ahead", _POSITION, "wheels", "sensor_clock", port="odometry", offset_s=1.0
    ),
    Fault("clock of the lidar 1 s ahead", _MAPPING, "lidar", "sensor_clock", port="scan", offset_s=1.0),
    Fault("clock of the lidar 1 s behind", _MAPPING, "lidar", "sensor_clock", port="scan", offset_s=-1.0),
)


@dataclass(frozen=True)
class Drive:
    """Samples of one drive by port, true mounts, and the time of the first motion."""

    samples: Mapping[str, list[Sample]]
    mounts: Mapping[str, FloatArray]
    start_ns: int
    moving_ns: int
    end_ns: int


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return false alarms, detection times and CPU time."""
    false_alarms: dict[str, list[str]] = {_POSITION: [], _MAPPING: []}
    cpu: dict[str, list[float]] = {_POSITION: [], _MAPPING: []}
    times: dict[str, list[float | None]] = {fault.name: [] for fault in FAULTS}
    named: dict[str, int] = {fault.name: 0 for fault in FAULTS}
    for seed in GOOD_SEEDS:
        progress(f"sensor consistency: seed {seed}")
        drive = drive_of(seed)
        for dfpc in _PORTS_OF:
            first_findings, cpu_s = monitored(drive, dfpc)
            false_alarms[dfpc] += [f"{seed}: {reason}" for _, reason in first_findings.values()]
            cpu[dfpc].append(cpu_s / ((drive.end_ns - drive.start_ns) * 1e-9))
        for fault in FAULTS if seed in FAULT_SEEDS else ():
            first_findings, _ = monitored(drive, fault.dfpc, fault)
            after_s, reason = first_findings.get(fault.kind, (None, ""))
            times[fault.name].append(after_s)
            named[fault.name] += reason.startswith(f"{fault.kind}:{fault.sensor}_")
    return {
        "good_drives": len(GOOD_SEEDS),
        "drive_s": round((drive.end_ns - drive.start_ns) * 1e-9, 1),
        "false_alarms": false_alarms,
        "cpu_percent": {dfpc: round(100.0 * float(np.mean(v)), 2) for dfpc, v in cpu.items()},
        "cpu_percent_largest": {dfpc: round(100.0 * max(v), 2) for dfpc, v in cpu.items()},
        "faults": {fault.name: _summary(times[fault.name], named[fault.name]) for fault in FAULTS},
    }


def drive_of(seed: int) -> Drive:
    """Return the samples of the drive of a seed."""
    scenario = _scenario(seed)
    rng = np.random.default_rng(seed)
    samples: dict[str, list[Sample]] = {port: [] for ports in _PORTS_OF.values() for port in ports}
    truth: list[tuple[int, FloatArray]] = []
    for entry, value in simulate(scenario, workers=0):
        robot, _, stream = entry.stream.strip("/").partition("/")
        if robot != ROBOT:
            continue
        if stream == "truth.pose":
            truth.append((entry.stamp_ns, value.transform.matrix))
        elif stream in _PORTS:
            port = _PORTS[stream]
            frame = f"{ROBOT}/{_FRAMES.get(port, 'base')}"
            samples[port].append(Sample(port, entry.stamp_ns, entry.header.seq, value, frame=frame))
    navcam = load_scenario("rover_traverse").navcam
    assert navcam is not None
    mounts = {
        "lidar": scenario.lidar.mount.matrix(),
        "imu": scenario.imu.mount.matrix(),
        "navcam_left": navcam.T_base_left,
    }
    camera = mounts["navcam_left"]
    visual, measured = truth[::_VISUAL_STEP], np.eye(4)
    for k, (stamp_ns, T) in enumerate(visual):
        if k:
            step = se3.inverse(visual[k - 1][1] @ camera) @ T @ camera
            measured = measured @ step @ se3.exp_se3(rng.normal(0.0, _VISUAL_SIGMA))
        pose = _pose(measured, "vo", f"{ROBOT}/navcam_left", stamp_ns)
        samples["visual_odometry"].append(Sample("visual_odometry", stamp_ns, k, pose))
    for k, (stamp_ns, T) in enumerate(truth[::_FUSED_STEP]):
        pose = _pose(T @ se3.exp_se3(rng.normal(0.0, _FUSED_SIGMA)), "site", f"{ROBOT}/base", stamp_ns)
        samples["poses"].append(Sample("poses", stamp_ns, k, pose))
    origin = truth[0][1][:3, 3]
    moving_ns = next(t for t, T in truth if np.linalg.norm(T[:3, 3] - origin) > 0.02)
    return Drive(samples, mounts, truth[0][0], moving_ns, truth[-1][0])


def monitored(
    drive: Drive, dfpc: str, fault: Fault | None = None
) -> tuple[dict[str, tuple[float, str]], float]:
    """Return the first finding of each kind, with its time after the first motion, and the CPU seconds."""
    graph = FrameGraph()
    for name, T in drive.mounts.items():
        T_stated = _stated(T, fault) if fault is not None and fault.frame == name else T
        graph.set_static(f"{ROBOT}/base", f"{ROBOT}/{name}", UncertainTransform.exact(T_stated))
    context = DfpcContext(ROBOT, graph, sensors=_SENSORS)
    monitor = SensorMonitor(context, Registry.default().dfpc(dfpc).input_ports)
    samples = []
    for port in _PORTS_OF[dfpc]:
        shift_ns = round(fault.offset_s * 1e9) if fault is not None and fault.port == port else 0
        samples += [replace(s, stamp_ns=s.stamp_ns + shift_ns) for s in drive.samples[port]]
    samples.sort(key=lambda s: (s.stamp_ns, s.port))
    first_findings: dict[str, tuple[float, str]] = {}
    start_s = time.thread_time()
    for sample in samples:
        monitor.add(sample)
        for finding in monitor.findings:
            first_findings.setdefault(
                finding.kind, ((sample.stamp_ns - drive.moving_ns) * 1e-9, finding.reason)
            )
    return first_findings, time.thread_time() - start_s


def _scenario(seed: int) -> Scenario:
    """Return the scenario on a coarser grid, without images and with one rover."""
    full = load_scenario("rover_traverse", seed).model_dump()
    full["navcam"] = None
    full["terrain"] |= {"resolution_m": 0.1, "fine_half_width_m": 20.0, "far_half_width_m": 60.0}
    full["terrain"]["surface"] = None
    full["robots"] = {ROBOT: full["robots"][ROBOT]}
    return Scenario.model_validate(full)


def _stated(T: FloatArray, fault: Fault) -> FloatArray:
    """Return the wrong mount of a fault."""
    if fault.form == "inverse":
        return se3.inverse(T)
    if fault.form == "body":
        return se3.transform(np.eye(3), T[:3, 3])
    roll, pitch, yaw = np.radians(fault.rpy_deg)
    R = se3.exp_so3([0.0, 0.0, yaw]) @ se3.exp_so3([0.0, pitch, 0.0]) @ se3.exp_so3([roll, 0.0, 0.0])
    return T @ se3.transform(R, [0.0, 0.0, 0.0])


def _pose(T: FloatArray, parent: str, child: str, stamp_ns: int) -> TransformWithCovariance:
    return TransformWithCovariance.from_transform(
        UncertainTransform(T, 1e-6 * np.eye(6)), parent=parent, child=child, stamp_ns=stamp_ns
    )


def _summary(times: Sequence[float | None], named: int) -> dict[str, Any]:
    delays_s = sorted(max(t, 0.0) for t in times if t is not None)
    return {
        "drives": len(times),
        "found": len(delays_s),
        "named": named,
        "median_s": round(float(np.median(delays_s)), 1) if delays_s else None,
        "largest_s": round(delays_s[-1], 1) if delays_s else None,
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of the faults, and that of false alarms and CPU time."""
    lines = [
        "| fault | drives | found | sensor named | after driving, median | longest |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in figures["faults"].items():
        after = " | ".join("–" if row[k] is None else f"{row[k]:.1f} s" for k in ("median_s", "largest_s"))
        lines.append(f"| {name} | {row['drives']} | {row['found']} | {row['named']} | {after} |")
    lines += [
        "",
        "| sensors compared by | good drives | false alarms | CPU time of one core, mean | largest |",
    ]
    lines += ["|---|---|---|---|---|"]
    for dfpc, alarms in figures["false_alarms"].items():
        cpu = f"{figures['cpu_percent'][dfpc]:.2f} % | {figures['cpu_percent_largest'][dfpc]:.2f} %"
        lines.append(f"| `{dfpc}` | {figures['good_drives']} | {len(alarms)} | {cpu} |")
    return "\n".join(lines)
