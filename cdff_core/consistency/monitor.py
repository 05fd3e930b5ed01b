# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Monitor of the sensors that are inputs of one DFPC, the same in its host, in replay and on a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from cdff_common.errors import CdffError
from cdff_common.geometry import FrameGraph, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.description import InputPort
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Status
from cdff_core.consistency.attribution import PairGroups, offset_suspects, rotation_suspects
from cdff_core.consistency.finding import (
    CLOCK,
    FRAME,
    ROTATION,
    Finding,
    roll_pitch_yaw_deg,
    sensor_reasons,
)
from cdff_core.consistency.limits import Limits
from cdff_core.consistency.motion_agreement import MotionAgreement, MotionEstimate, OffsetLikelihood
from cdff_core.consistency.robot_frames import known_frames, nearest_frame
from cdff_core.consistency.sources import InertialSource, PoseSource, Source, SweepSource
from cdff_core.consistency.stream_statistics import StreamStatistics
from cdff_core.consistency.vertical import VerticalEstimate

#: Interval of the tests, and number of tests in a row that start or end a finding.
_PERIOD_NS, _CONFIRMING = 2_000_000_000, 2
#: Time after which a reason of an input no longer applies to the outputs, nanoseconds.
_INHERITED_NS = 5_000_000_000
#: If a sample is older than the newest one by more than this, the mission clock was set back, and the
#: comparison starts again.
_BACK_NS = 10_000_000_000
_SITE = "site"
#: Sample types whose frame must be a frame of the robot, since they come from its sensors.
_SENSOR_TYPES = ("IMUSensors", "LidarScan", "FramePair", "Frame")
#: Number of samples with an unknown frame that are a finding.
_UNKNOWN_SAMPLES = 3


class SensorMonitor:
    """Comparison of the sensors of a DFPC with each other.

    Parameters
    ----------
    context : DfpcContext
        Mounts and sensors of the robot.
    ports : sequence of InputPort
        Ports of the DFPC; those with ``compared`` are compared.
    limits : Limits, optional

    Attributes
    ----------
    findings : tuple of Finding
        Present findings.
    """

    def __init__(
        self, context: DfpcContext, ports: Sequence[InputPort], limits: Limits | None = None
    ) -> None:
        limits = limits or Limits()
        allowed_s = [float(e["max_offset_s"]) for e in context.sensors.values() if "max_offset_s" in e]
        self._context = context
        self.limits = replace(limits, offset_s=max(allowed_s, default=limits.offset_s))
        self._types = {port.attribute: port.type_name for port in ports if port.compared}
        self._all_types = {port.attribute: port.type_name for port in ports}
        self._known = known_frames(context)
        self._history: dict[tuple[str, str], Finding] = {}
        self.reset()

    def reset(self) -> None:
        """Start the comparison again."""
        #: By port and frame; None if it cannot be compared.
        self._sources: dict[str, Source | None] = {}
        self._pairs: dict[tuple[str, str], MotionAgreement] = {}
        self._newest_ns: dict[str, int] = {}
        self._tested_ns: int | None = None
        self._counts: dict[tuple[str, str], int] = {}
        self._inherited: dict[str, int] = {}
        self._streams: dict[str, StreamStatistics] = {}
        self._unknown_frames: Counter[tuple[str, str]] = Counter()
        self.findings: tuple[Finding, ...] = ()

    def add(self, sample: Sample) -> None:
        """Add a sample of any port, in the order of processing."""
        inherited = sensor_reasons(sample.quality.reasons)
        if inherited and (not self._types or getattr(sample.value, "parent_frame", "") == _SITE):
            # Only the fused pose passes its reasons on to a DFPC that compares sensors, so that no reason
            # returns to its origin through other DFPCs.
            self._inherited |= dict.fromkeys(inherited, sample.stamp_ns)
        frame = _frame_of(sample)
        self._count(sample, frame)
        type_name = self._types.get(sample.port)
        if type_name is not None:
            self._compare(sample, frame, type_name, is_inherited=bool(inherited))
        if self._tested_ns is None:
            self._tested_ns = sample.stamp_ns
        if not 0 <= sample.stamp_ns - self._tested_ns < _PERIOD_NS:
            self._tested_ns = sample.stamp_ns
            self._test()

    def add_arrival(self, sample: Sample, now_ns: int) -> None:
        """Add the mission time at which a sample was received; may be called by other threads."""
        stream = self._streams.get(sample.port)
        if stream is not None:
            stream.add_arrival(sample.stamp_ns, now_ns)

    @property
    def unknown_frames(self) -> dict[str, int]:
        """Numbers of samples by frames that the robot does not have."""
        return {frame: count for (_, frame), count in self._unknown_frames.items()}

    def _count(self, sample: Sample, frame: str) -> None:
        """Count a sample of a sensor, and its frame if the robot does not have it."""
        type_name = self._all_types.get(sample.port, "")
        if type_name in _SENSOR_TYPES and frame and self._known and frame not in self._known:
            self._unknown_frames[sample.port, frame] += 1
        stream = self._streams.get(sample.port)
        if stream is None:
            sensors = self._context.sensors
            sensor = _sensor_of(sensors, frame, type_name, strict=True)
            if not sensor:
                return
            stream = StreamStatistics(sensor, sensors[sensor], self.limits)
            self._streams[sample.port] = stream
        stream.add(sample.stamp_ns, sample.seq)

    def _compare(self, sample: Sample, frame: str, type_name: str, *, is_inherited: bool) -> None:
        """Add a sample to the motion source of its port and frame; a step back in time resets the monitor."""
        newest_ns = self._newest_ns.get(sample.port)
        if newest_ns is not None and sample.stamp_ns <= newest_ns:
            if sample.stamp_ns < newest_ns - _BACK_NS:
                self.reset()
            return
        self._newest_ns[sample.port] = sample.stamp_ns
        key = f"{sample.port} {frame}"
        if key not in self._sources:
            self._sources[key] = self._made(sample, frame, type_name)
            self._pairs = {}
        source = self._sources[key]
        if source is None or (source.is_fused and is_inherited):
            return
        source.add(sample.stamp_ns, None if sample.quality.status is Status.FAILED else sample.value)

    def reasons(self, stamp_ns: int) -> tuple[str, ...]:
        """Return the reasons for which an output at a time is DEGRADED: own findings and those of inputs."""
        inherited = [r for r, t_ns in self._inherited.items() if abs(stamp_ns - t_ns) <= _INHERITED_NS]
        return tuple(dict.fromkeys([*(finding.reason for finding in self.findings), *inherited]))

    @property
    def history(self) -> tuple[Finding, ...]:
        """The latest finding of each kind and sensor since the start."""
        return tuple(self._history.values())

    def estimates(self) -> tuple[dict[str, VerticalEstimate], dict[tuple[str, str], MotionEstimate]]:
        """Return the vertical of each sensor and the relation of each pair of sensors so far."""
        for pair in self._agreements().values():
            pair.update()
        verticals = {
            name: estimate
            for name, source in self.sources.items()
            if source.vertical is not None and (estimate := source.vertical.estimate(self.limits)) is not None
        }
        relations = {
            names: relation
            for names, pair in self._pairs.items()
            if (relation := pair.estimate(self.limits)) is not None
        }
        return verticals, relations

    @property
    def sources(self) -> dict[str, Source]:
        """Compared sources of motion by sensor, without those of an unknown mount or without motion."""
        return {source.name: source for source in self._sources.values() if source is not None}

    def _made(self, sample: Sample, frame: str, type_name: str) -> Source | None:
        """Return the source of a sample; None if its mount is unknown or it measures no motion."""
        base = f"{self._context.robot}/base"
        R = _rotation(self._context.frames, base, frame, sample.stamp_ns)
        if R is None:
            return None
        name = _sensor_of(self._context.sensors, frame, type_name) or sample.port
        if type_name == "IMUSensors":
            return InertialSource(name, R, self.limits)
        if type_name == "TransformWithCovariance":
            if _is_position(sample.value):
                return None
            is_fused = getattr(sample.value, "parent_frame", "") == _SITE
            is_planar = frame == base and not is_fused
            return PoseSource(sample.port if is_fused else name, R, is_planar=is_planar, is_fused=is_fused)
        return SweepSource(name, R, self.limits)

    def _agreements(self) -> dict[tuple[str, str], MotionAgreement]:
        """Return the comparisons of each pair of sources that can be compared."""
        if not self._pairs:
            for a, b in combinations(self.sources.values(), 2):
                first, second = (b, a) if b.is_planar else (a, b)
                is_comparable = first.name != second.name and not (first.is_planar and second.is_coarse)
                if is_comparable and not second.is_planar:
                    pair = MotionAgreement(first.motion, second.motion, planar=first.is_planar)
                    self._pairs[first.name, second.name] = pair
        return self._pairs

    def _test(self) -> None:
        """Run all tests and update the confirmed findings and their history."""
        verticals, relations = self.estimates()
        has_rotation = any(estimate.excess > 1.0 for estimate in verticals.values()) or any(
            estimate.rotation_excess > 1.0 for estimate in relations.values()
        )
        has_offset = any(estimate.offset_excess > 1.0 for estimate in relations.values())
        findings_or_none = [self._rotation_finding(verticals, relations)] if has_rotation else []
        findings_or_none += [self._clock_finding(relations)] if has_offset else []
        findings_or_none += [finding for stream in self._streams.values() for finding in stream.findings()]
        findings_or_none += self._frame_findings()
        present = {
            (finding.kind, finding.name): finding for finding in findings_or_none if finding is not None
        }
        self.findings = self._confirm_findings(present)
        self._history |= {(finding.kind, finding.name): finding for finding in self.findings}

    def _confirm_findings(self, present: Mapping[tuple[str, str], Finding]) -> tuple[Finding, ...]:
        """Return the findings of several tests in a row; they end after as many tests without them."""
        last = {(finding.kind, finding.name): finding for finding in self.findings}
        for key in {*present, *last, *self._counts}:
            step = 1 if key in present else -1
            self._counts[key] = min(max(self._counts.get(key, 0) + step, 0), _CONFIRMING)
        self._counts = {key: count for key, count in self._counts.items() if count}
        confirmed = []
        for key, count in sorted(self._counts.items()):
            if count == _CONFIRMING or key in last:
                confirmed.append(present.get(key) or last[key])
        return tuple(confirmed)

    def _frame_findings(self) -> list[Finding]:
        """Return the frames of samples that the robot does not have."""
        findings = []
        for (port, frame), count in self._unknown_frames.items():
            if count < _UNKNOWN_SAMPLES:
                continue
            sensors_of_type = [
                n for n, e in self._context.sensors.items() if self._all_types[port] in _streams_of(e)
            ]
            sensor = sensors_of_type[0] if len(sensors_of_type) == 1 else port
            nearest = nearest_frame(frame, self._known)
            hint = f"; did you mean {nearest}?" if nearest else ""
            description = (
                f"{count} samples of {sensor} have the frame {frame!r}, which the robot does not have; known "
                f"are {', '.join(sorted(self._known))}{hint}"
            )
            remedy = f"correct frame_id in the driver of {sensor}, or add the frame to the profile"
            findings.append(Finding(FRAME, (sensor,), frame, description, remedy))
        return findings

    def _rotation_finding(
        self,
        verticals: Mapping[str, VerticalEstimate],
        relations: Mapping[tuple[str, str], MotionEstimate],
    ) -> Finding | None:
        """Return the finding about the sensors whose mount contradicts the others; None if they agree."""
        sources = self.sources
        candidates = [name for name, source in sources.items() if not (source.is_planar or source.is_fused)]
        pairs = [PairGroups(*names, estimate.groups) for names, estimate in relations.items()]
        moments = {name: sources[name].vertical.moments() for name in verticals}  # type: ignore[union-attr]
        suspects = rotation_suspects(candidates, pairs, moments)
        if suspects is None:
            return None
        sensor = suspects.sensors[0]
        R_base_sensor = sources[sensor].R_base_sensor
        sigma_deg = np.degrees(np.sqrt(np.diag(suspects.covariance)))
        unknown = [axis for axis, s in zip(("x", "y", "z"), sigma_deg, strict=True) if s > 10.0]
        angle_deg = float(np.degrees(np.linalg.norm(se3.log_so3(suspects.rotation))))
        known_deg = ", ".join(f"{s:.1f}" for s in sigma_deg)
        description = (
            f"{' or '.join(suspects.sensors)} disagrees with the other sensors by a rotation of "
            f"{angle_deg:.0f} deg: expected rpy_deg {roll_pitch_yaw_deg(R_base_sensor)} of {sensor} in the "
            f"base, observed {roll_pitch_yaw_deg(suspects.rotation @ R_base_sensor)}, sigma about x, y, z of "
            f"the base [{known_deg}] deg"
        )
        if unknown:
            description += f"; not observable about {', '.join(unknown)} with this motion"
        remedy = (
            f"correct the rotation of the frame of {sensor} in the profile (quaternions are [x, y, z, w], a "
            "positive pitch lowers the x axis), or its driver"
        )
        return Finding(ROTATION, suspects.sensors, f"{angle_deg:.0f}_deg", description, remedy)

    def _clock_finding(self, relations: Mapping[tuple[str, str], MotionEstimate]) -> Finding | None:
        """Return the finding about the streams whose stamps are shifted; None within the limit."""
        likelihoods = [OffsetLikelihood(*names, e.offset_log_likelihood) for names, e in relations.items()]
        streams = [name for name, source in self.sources.items() if not source.is_fused]
        limit_s = self.limits.offset_s
        names, offset_s, sigma_s = offset_suspects(streams, likelihoods, limit_s)
        if abs(offset_s) <= limit_s:
            return None
        side = "ahead of" if offset_s > 0.0 else "behind"
        description = (
            f"stamps of {' or '.join(names)} are {abs(offset_s):.2f} s (sigma {sigma_s:.2f} s) {side} the "
            f"other sensors, expected at most {limit_s:g} s"
        )
        remedy = (
            f"synchronise the clock of {names[0]}, or correct the time that its driver states as capture time"
        )
        return Finding(CLOCK, names, f"{offset_s:+.2f}_s", description, remedy)


def _frame_of(sample: Sample) -> str:
    """Return the frame in which a sample is measured: the child of a pose."""
    value: Any = sample.value
    frame = getattr(value, "child_frame", None) or sample.child or getattr(value, "frame", None)
    return frame or sample.frame


def _rotation(frames: FrameGraph, base: str, frame: str, stamp_ns: int) -> FloatArray | None:
    """Return the rotation (3, 3) of a mount; None if it is unknown."""
    if frame == base:
        return np.eye(3)
    try:
        return frames.lookup(base, frame, stamp_ns).matrix[:3, :3]
    except CdffError:
        return None


def _streams_of(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the types of the streams of a sensor."""
    return tuple(entry.get("streams", {}).values())


def _sensor_of(
    sensors: Mapping[str, Mapping[str, Any]], frame: str, type_name: str, *, strict: bool = False
) -> str:
    """Return the sensor of the profile with a frame, preferably with a stream of a type.

    With ``strict`` a sensor without such a stream does not count.
    """
    names = [name for name, entry in sensors.items() if entry.get("frame") == frame]
    with_type = [name for name in names if type_name in _streams_of(sensors[name])]
    return next(iter(with_type if strict else (*with_type, *names)), "")


def _is_position(value: Any) -> bool:
    """Return whether a pose states that only its position is estimated, as those of satellite navigation."""
    metadata = getattr(value, "metadata", None)
    estimated = np.asarray(getattr(metadata, "data_estimated", ()), dtype=bool)
    return len(estimated) == 7 and bool(estimated[:3].all()) and not estimated[3:].any()
