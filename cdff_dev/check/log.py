# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Streams of a log against the sensors of a profile: presence, type, rate, gaps and frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from cdff_common.contract.foreign_names import is_anchor, is_mount
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile, Robot
from cdff_common.interfaces.profile_checks.faults import Severity, nearest_frame, nearest_name, one_of
from cdff_common.interfaces.sensor_profile import Sensor
from cdff_dev.logs.information import StreamReport
from cdff_dev.logs.source import split_stream
from cdff_dev.logs.timing import Timing

#: Largest ratio of the measured rate to that of a mode: the rate is that of the median period, so that jitter
#: and gaps do not change it.
_RATE_RATIO = 1.25
#: Sensor of the true poses of simulated logs, which no profile has.
_TRUTH = "truth"


@dataclass(frozen=True, slots=True)
class StreamFinding:
    """Difference between a stream of a log and a profile, or a fault of the stream.

    Attributes
    ----------
    stream : str
        ``/robot/sensor.stream``.
    problem : str
        Values in the log and in the profile.
    severity : str
        ``error`` if the system does not work with this log, else ``warning``.
    """

    stream: str
    problem: str
    severity: Severity

    def __str__(self) -> str:
        kind = "warning: " if self.severity == "warning" else ""
        return f"{kind}{self.stream}: {self.problem}"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        return asdict(self)


def log_findings(profile: Profile, reports: dict[str, StreamReport]) -> list[StreamFinding]:
    """Return the differences between the streams of a log and a profile, by stream."""
    findings: list[StreamFinding] = []
    in_log = {name: report for name, report in reports.items() if report.info.count}
    robots = {robot for robot, _, _ in _parts(in_log).values()}
    for robot in profile.robots:
        if robot.id not in robots:
            findings.append(
                StreamFinding(
                    f"/{robot.id}", f"robot is not in the log, which has {one_of(sorted(robots))}", "error"
                )
            )
            continue
        findings += _robot_findings(robot, in_log)
    return findings + list(_unknown_streams(profile, in_log))


def stream_line(name: str, report: StreamReport) -> str:
    """Return the measured rate, gaps and frame of a stream in words."""
    times = report.timing
    rate = f"{times.rate_hz:.3g} Hz" if times.rate_hz else "one sample"
    gaps = f"{_gaps(times)}, the longest of {times.longest_gap_s:.3g} s" if times.gaps else "no gaps"
    frame = f", frame {report.frame}" if report.frame else ", no frame"
    return f"{name}: {report.info.type_name}, {report.info.count} samples, {rate}, {gaps}{frame}"


def _gaps(times: Timing) -> str:
    return f"{times.gaps} gap{'' if times.gaps == 1 else 's'}"


def _parts(reports: dict[str, StreamReport]) -> dict[str, tuple[str, str, str]]:
    """Return robot, sensor and stream of the names of this form."""
    parts = {}
    for name in reports:
        try:
            parts[name] = split_stream(name)
        except InputError:  # a stream of no robot
            continue
    return parts


def _robot_findings(robot: Robot, reports: dict[str, StreamReport]) -> Iterator[StreamFinding]:
    """Yield the findings about streams of a robot that the log lacks or that differ from the profile."""
    frames = {*robot.frame_graph().frames, f"{robot.id}/base"}
    of_robot = {name: parts for name, parts in _parts(reports).items() if parts[0] == robot.id}
    wired = {w for entry in robot.dfpcs for text in entry.inputs.values() for w in text.split("|")}
    for sensor_name, sensor in robot.sensors.items():
        for stream, type_name in sensor.streams.items():
            name = f"/{robot.id}/{sensor_name}.{stream}"
            report = reports.get(name)
            if report is None:
                known = [f"/{r}/{s}.{item}" for r, s, item in of_robot.values() if s != _TRUTH]
                nearest = nearest_name(name, known)
                hint = f"; did you mean {nearest}?" if nearest else ""
                is_wired = f"sensor/{sensor_name}/{stream}" in wired
                problem = f"is not in the log{hint}"
                yield StreamFinding(name, problem, "error" if is_wired else "warning")
                continue
            if report.info.type_name != type_name:
                problem = f"has the type {report.info.type_name} in the log, {type_name} in the profile"
                yield StreamFinding(name, problem, "error")
            yield from _frame_findings(name, sensor, report, frames)
            yield from _timing_findings(name, sensor, report)


def _frame_findings(
    name: str, sensor: Sensor, report: StreamReport, frames: set[str]
) -> Iterator[StreamFinding]:
    """Yield a finding if the frame of a stream in the log is not that of the sensor in the profile."""
    frame = report.frame if sensor.kind != "wheels" else report.child
    if not frame or sensor.frame in (frame, report.child):
        return
    if frame not in frames:
        nearest = nearest_frame(frame, frames)
        hint = f"; did you mean {nearest!r}?" if nearest else ""
        problem = f"has the frame {frame!r} in the log, which the profile does not have{hint}"
        yield StreamFinding(name, problem, "error")
    elif sensor.kind not in ("wheels", "other"):
        yield StreamFinding(
            name, f"has the frame {frame!r} in the log, {sensor.frame!r} in the profile", "error"
        )


def _timing_findings(name: str, sensor: Sensor, report: StreamReport) -> Iterator[StreamFinding]:
    """Yield the findings about the rate and the gaps of a stream."""
    times = report.timing
    rate_by_mode = {mode: m.rate_hz for mode, m in sensor.modes.items() if m.on and m.rate_hz}
    if times.rate_hz and rate_by_mode:
        near = [r for r in rate_by_mode.values() if r / _RATE_RATIO < times.rate_hz < r * _RATE_RATIO]
        if not near:
            rates = ", ".join(f"{rate:g} Hz in {mode}" for mode, rate in rate_by_mode.items())
            yield StreamFinding(
                name, f"has {times.rate_hz:.3g} Hz in the log; the profile states {rates}", "warning"
            )
    if times.gaps:
        problem = f"{_gaps(times)}, the longest of {times.longest_gap_s:.3g} s at {times.rate_hz:.3g} Hz"
        yield StreamFinding(name, problem, "warning")
    if times.backwards or times.clock_jumps:
        problem = (
            f"{times.backwards} stamps are before the previous one, {times.clock_jumps} jumps of the clock"
        )
        yield StreamFinding(name, problem, "warning")
    elif times.repeated:
        yield StreamFinding(name, f"{times.repeated} stamps are those of the previous sample", "warning")


def _unknown_streams(profile: Profile, reports: dict[str, StreamReport]) -> Iterator[StreamFinding]:
    """Yield a finding for each stream of sensor data that the profile does not contain."""
    robots = {robot.id: robot for robot in profile.robots}
    for name, (robot_id, sensor, stream) in _parts(reports).items():
        robot = robots.get(robot_id)
        if (
            robot is None
            or sensor == _TRUTH
            or is_anchor(name)
            or is_mount(name)
            or sensor in {entry.name for entry in robot.dfpcs}
        ):
            continue
        if sensor not in robot.sensors or stream not in robot.sensors[sensor].streams:
            yield StreamFinding(name, "is in the log, but not in the profile", "warning")
