# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recording of sensor samples as products, by the ``history`` policies of the profile.

A product has the id of its sample, so that provenance leads to it, the sensor as ``dfpc`` and the stream as
``port``. Inertial samples are recorded as spans that name the ids of their samples.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from cdff_common.bus import Bus, Message, Subscription, keys
from cdff_common.clock import NS_PER_S, monotonic_s
from cdff_common.codecs import decode, encode, encoding_string, parse_encoding
from cdff_common.contract.products import product_of_sample
from cdff_common.errors import CdffError, ClockSkewError, StorageError, UnavailableError
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import History, Profile
from dpm_store import Rule
from services.dpm.bus.waiting_samples import CAPACITY_BYTES, FOLDER, RecordedSample, WaitingSamples
from services.dpm.operations.dpm import Dpm

logger = logging.getLogger(__name__)

_SPANNED = "IMUSensors"
_PRODUCER = "dpm/history/1"
#: Largest number of queued samples while the store waits for its disk; dropped samples are counted.
_DEPTH = 512
#: Mission seconds between two applications of the retention rules, and largest share of the time for them.
_RETIRE_EVERY_S, _RETIRE_SHARE = 10.0, 0.05


#: Names of robot, sensor and stream.
_StreamKey = tuple[str, str, str]


@dataclass(slots=True)
class _Stream:
    """State of a stream under a policy."""

    robot: str
    policy: History
    type_name: str
    sample_count: int = 0
    last_ns: int | None = None
    span: list[tuple[Header, Any]] = field(default_factory=list)
    spans: int = 0

    @property
    def product(self) -> str:
        return product_of_sample(self.type_name)

    def accepts(self, stamp_ns: int) -> bool:
        """Return True if the policy records the next sample."""
        is_selected = self.sample_count % self.policy.every_n == 0
        self.sample_count += 1
        if self.last_ns is not None and 0 <= stamp_ns - self.last_ns < self.policy.every_s * 1e9:
            return False
        if is_selected:
            self.last_ns = stamp_ns
        return is_selected


class Recorder:
    """Records the streams of the profile's ``history``.

    Attributes
    ----------
    counters : mapping of str to int
        ``kept`` products, samples ``skipped`` by policy, ``refused`` by the store, and ``dropped`` from a
        full queue, ``retired`` products, and samples ``waiting`` for the mission clock.
    """

    def __init__(self, bus: Bus, dpm: Dpm, profile: Profile) -> None:
        self._dpm = dpm
        self._lock = threading.Lock()
        self._counters = {"kept": 0, "skipped": 0, "refused": 0, "retired": 0}
        self._rules = rules_of_history(profile)
        self._retired_ns = dpm.clock.now_ns()
        self._retirement, self._next_retirement_s = threading.Lock(), 0.0
        self._storing = threading.Lock()
        self._waiting = WaitingSamples(dpm.store.directory / FOLDER, dpm.store.disk_space, CAPACITY_BYTES)
        dpm.events.other_counters["history"] = lambda: self.counters
        self._bus, self._dropped = bus, 0
        self._streams: dict[_StreamKey, _Stream] = {}
        self._subscriptions: dict[_StreamKey, Subscription] = {}
        self._subscribe(streams_of(profile))

    def _subscribe(self, streams: Iterable[_Stream]) -> None:
        for stream in streams:
            names = (stream.robot, stream.policy.sensor, stream.policy.stream)
            self._streams[names] = stream
            self._subscriptions[names] = self._bus.subscribe(keys.sensor(*names), self.record, depth=_DEPTH)

    def set_robot(self, profile: Profile) -> None:
        """Record the streams of the robot of a one-robot profile, in place of its earlier ones."""
        self.remove_robot(profile.robots[0].id)
        self._rules = tuple(dict.fromkeys((*self._rules, *rules_of_history(profile))))
        self._subscribe(streams_of(profile))

    def remove_robot(self, robot: str) -> None:
        """Stop the recording of a robot, and store its open spans; its retention rules stay."""
        for names in [n for n in self._streams if n[0] == robot]:
            subscription = self._subscriptions.pop(names)
            subscription.close()
            self._dropped += subscription.dropped
            stream = self._streams.pop(names)
            if stream.span:
                self._close_span(stream)

    @property
    def counters(self) -> dict[str, int]:
        """Counts since the start."""
        with self._lock:
            dropped = self._dropped + sum(s.dropped for s in tuple(self._subscriptions.values()))
            return self._counters | {"dropped": dropped, "waiting": len(self._waiting)}

    def record(self, message: Message) -> None:
        """Record a sample if its policy selects it."""
        _, _, robot, _, sensor, stream_name = message.key.split("/")
        stream = self._streams.get((robot, sensor, stream_name))
        if stream is None:  # its robot has just left
            return
        try:
            header = Header.from_attachment(message.attachment)
            with self._lock:
                is_accepted = stream.accepts(header.t1_ns)
            if not is_accepted:
                self._count("skipped")
            elif stream.type_name == _SPANNED:
                self._extend(stream, header, message)
            else:
                self._put(stream, header, message.payload, message.encoding)
        except CdffError as error:
            self._count("refused")
            logger.warning("sample on %s not stored: %s", message.key, error)

    def flush(self) -> None:
        """Store the open spans and the samples for which the mission clock has come."""
        for stream in self._streams.values():
            if stream.span:
                self._close_span(stream)
        self.store_waiting()

    def _extend(self, stream: _Stream, header: Header, message: Message) -> None:
        """Add a sample to the open span, or start the next span with it."""
        type_name, codec = parse_encoding(message.encoding)
        value = decode(type_name, message.payload, codec)
        first = stream.span[0][0].t0_ns if stream.span else header.t0_ns
        if not 0 <= header.t1_ns - first < stream.policy.span_s * 1e9:
            self._close_span(stream)
        stream.span.append((header, value))

    def _close_span(self, stream: _Stream) -> None:
        from cdff_common.types import ImuSpan

        headers, values = [h for h, _ in stream.span], [v for _, v in stream.span]
        stream.span = []
        policy, last = stream.policy, headers[-1]
        span = ImuSpan.from_samples(values, frame=last.frame)
        t1_ns = max(h.t1_ns for h in headers)
        seq = headers[0].seq
        header = replace(
            last,
            id=product_id(stream.robot, policy.sensor, policy.stream, t1_ns, seq, last.config_hash),
            seq=seq,
            t0_ns=min(h.t0_ns for h in headers),
            t1_ns=t1_ns,
            producer=_PRODUCER,
            inputs=tuple(h.id for h in headers),
            sha256=None,
        )
        try:
            self._put(stream, header, encode(span, "uper"), encoding_string("ImuSpan", "uper"))
        except CdffError as error:
            self._count("refused")
            logger.warning(
                "span of %s/%s of %s not stored: %s", policy.sensor, policy.stream, stream.robot, error
            )

    def _put(self, stream: _Stream, header: Header, payload: bytes, encoding: str) -> None:
        policy = stream.policy
        names = {
            "robot": stream.robot,
            "dfpc": policy.sensor,
            "port": policy.stream,
            "product": stream.product,
        }
        sample = RecordedSample(names, payload, encoding, header.to_attachment())
        try:
            self._dpm.writer.put(*sample)
        except ClockSkewError:
            with self._storing:
                self._count("refused", self._waiting.add(sample))
            return
        self._count("kept")
        self.store_waiting()
        self._retire()

    def store_waiting(self) -> None:
        """Store the samples that the mission clock has reached, the oldest first."""
        with self._storing:
            while self._waiting:
                try:
                    sample = self._waiting.first()
                    self._dpm.writer.put(*sample)
                    self._count("kept")
                except (UnavailableError, StorageError):  # ahead of the clock, or no space now
                    return
                except (CdffError, OSError) as error:
                    self._count("refused")
                    logger.warning("a sample that waited for the mission clock is not stored: %s", error)
                self._waiting.remove_first()

    def _retire(self) -> None:
        """Apply the retention rules at intervals, in one thread; the inputs of kept products stay."""
        if self._rules and self._retirement.acquire(blocking=False):
            try:
                self._retire_if_due()
            finally:
                self._retirement.release()

    def _retire_if_due(self) -> None:
        now_ns, start_s = self._dpm.clock.now_ns(), monotonic_s()
        is_early = 0 <= now_ns - self._retired_ns < _RETIRE_EVERY_S * NS_PER_S
        if is_early or start_s < self._next_retirement_s:
            return
        self._retired_ns = now_ns
        try:
            self._count("retired", self._dpm.writer.retire(self._rules, apply=True).to_delete)
        except (UnavailableError, StorageError) as error:  # an alarm reports it; the sample is stored
            logger.debug("retention waits: %s", error)
        end_s = monotonic_s()
        self._next_retirement_s = end_s + (end_s - start_s) / _RETIRE_SHARE

    def _count(self, what: str, times: int = 1) -> None:
        with self._lock:
            self._counters[what] += times


def streams_of(profile: Profile) -> Iterable[_Stream]:
    """Return the streams that the profile records; the first policy of a stream applies."""
    streams: dict[tuple[str, str, str], _Stream] = {}
    for policy in profile.history:
        for robot in profile.robots:
            sensor = robot.sensors.get(policy.sensor)
            if policy.robot in (None, robot.id) and sensor is not None and policy.stream in sensor.streams:
                key = (robot.id, policy.sensor, policy.stream)
                streams.setdefault(key, _Stream(robot.id, policy, sensor.streams[policy.stream]))
    return streams.values()


def rules_of_history(profile: Profile | None) -> tuple[Rule, ...]:
    """Return the retention rules of recorded streams."""
    if profile is None:
        return ()
    return tuple(
        Rule(
            product=s.product,
            robot=s.robot,
            dfpc=s.policy.sensor,
            port=s.policy.stream,
            max_age_s=s.policy.keep_s,
        )
        for s in streams_of(profile)
        if s.policy.keep_s is not None
    )
