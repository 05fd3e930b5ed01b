# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff check --profile FILE [--log LOG]``: report of a profile, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.profile_checks.check import CheckedProfile, check_profile
from cdff_dev.check.log import StreamFinding, log_findings, stream_line

if TYPE_CHECKING:
    from cdff_dev.logs.information import StreamReport


@dataclass(frozen=True, slots=True)
class ProfileReport:
    """Faults of a profile, and of a log against it.

    Attributes
    ----------
    checked : CheckedProfile
    log : str or None
        Path of the log.
    streams : mapping of str to StreamReport
        Streams of the log.
    findings : tuple of StreamFinding
        Differences between log and profile; empty if the profile has errors.
    comparisons : tuple of str
        Verticals, rotations and clock offsets of the sensors in words.
    """

    checked: CheckedProfile
    log: str | None
    streams: Mapping[str, StreamReport]
    findings: tuple[StreamFinding, ...]
    comparisons: tuple[str, ...] = ()

    @property
    def has_errors(self) -> bool:
        """True if the profile, or the log for this profile, is refused."""
        return bool(self.checked.errors) or any(f.severity == "error" for f in self.findings)

    def to_json(self) -> dict[str, Any]:
        """Return the report for JSON."""
        return {
            "profile": str(self.checked.path),
            "faults": [fault.to_json() for fault in self.checked.faults],
            "streams": {name: stream.to_json() for name, stream in self.streams.items()},
            "comparisons": list(self.comparisons),
            "log_faults": [finding.to_json() for finding in self.findings],
        }

    def lines(self) -> Iterator[str]:
        """Yield the report in words."""
        yield from map(str, self.checked.faults)
        if self.checked.profile is not None and not self.checked.errors:
            yield from _description(self.checked.profile)
        elif self.log is not None:
            yield "the log is not compared until the profile has no errors"
        if self.streams:
            yield f"log {self.log}:"
        for name, stream in self.streams.items():
            yield f"  {stream_line(name, stream)}"
        if self.comparisons:
            yield "sensors compared with each other:"
        yield from (f"  {line}" for line in self.comparisons)
        yield from map(str, self.findings)
        severities = [fault.severity for fault in self.checked.faults]
        severities += [finding.severity for finding in self.findings]
        counts = [_count(severities.count(kind), kind) for kind in ("error", "warning")]
        subject = f"{self.checked.path}{'' if self.log is None else f' with {self.log}'}"
        yield f"{subject}: {', '.join(counts)}"


def report(path: str, log: str | None) -> ProfileReport:
    """Return the report of a profile and of a log against it.

    Raises
    ------
    ConfigurationError, InputError
        If the profile or the log cannot be read.
    """
    checked = check_profile(path)
    streams = {} if log is None else _stream_reports(log)
    findings: tuple[StreamFinding, ...] = ()
    lines: tuple[str, ...] = ()
    if streams and log is not None and checked.profile is not None and not checked.errors:
        compared, lines = _comparison(checked.profile, log)
        findings = (*log_findings(checked.profile, streams), *compared)
    return ProfileReport(checked, log, streams, findings, lines)


def _comparison(profile: Profile, log: str) -> tuple[list[StreamFinding], tuple[str, ...]]:
    """Return the findings of the comparison of the sensors of each robot, and its estimates in words."""
    from cdff_dev.check.mounts import mount_findings
    from cdff_dev.check.sensors import comparison_findings, comparison_lines, sensor_comparison
    from cdff_dev.logs import open_log

    findings: list[StreamFinding] = []
    lines: list[str] = []
    with closing(open_log(log)) as source:
        for robot in profile.robots:
            findings += mount_findings(source, robot)
            monitor = sensor_comparison(source, robot)
            if monitor is not None:
                findings += comparison_findings(monitor, robot.id)
                lines += (f"{robot.id}: {line}" for line in comparison_lines(monitor))
    return findings, tuple(lines)


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _stream_reports(log: str) -> dict[str, StreamReport]:
    from cdff_dev.logs import open_log
    from cdff_dev.logs.information import stream_reports

    with closing(open_log(log)) as source:
        return stream_reports(source)


def _description(profile: Profile) -> Iterator[str]:
    """Yield the robots, sensors and DFPCs of a profile in words."""
    anchors = ", ".join(profile.body.anchors) or "no anchored site"
    yield f"profile {profile.name}: body {profile.body.name}, {anchors}"
    for robot in profile.robots:
        yield f"robot {robot.id}: {len(robot.sensors)} sensors, {len(robot.dfpcs)} DFPCs"
        for name, sensor in robot.sensors.items():
            rates = [f"{mode} {m.rate_hz:g} Hz" for mode, m in sensor.modes.items() if m.on and m.rate_hz]
            streams = ", ".join(f"{stream} ({type_name})" for stream, type_name in sensor.streams.items())
            modes = f"; {', '.join(rates)}" if rates else ""
            yield f"  {name}: {sensor.kind} in {sensor.frame}, {streams}{modes}"
        for entry in robot.dfpcs:
            inputs = ", ".join(f"{port} ← {source}" for port, source in entry.inputs.items())
            yield f"  {entry.name}: {inputs or 'no inputs'}"
