# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The history of pre-processed sensor data: samples from the bus become products, by the policy of the profile.

A sample keeps its id, so that the provenance of what was made from it leads to it. Its product has the sensor as
``dfpc`` and the stream as ``port``. Inertial samples are kept as spans, made from the samples whose ids they name.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string, parse_encoding
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import History, Profile
from dpm_store import Rule
from services.dpm.operations import Dpm

logger = logging.getLogger(__name__)

#: ASN.1 type of a sample -> what it is to a requester; of others ``sample``.
PRODUCTS = {
    "LidarScan": "scan", "FramePair": "image_pair", "Frame": "image", "Pointcloud": "pointcloud",
    "IMUSensors": "imu_span",
}  # fmt: skip
_SPANNED = "IMUSensors"
_PRODUCER = "dpm/history/1"
#: Deep enough that a store that waits for its disk loses no sample of a fast stream; what is lost is counted.
_DEPTH = 512
#: Mission seconds between two looks at what was kept long enough.
_LOOK_S = 10.0


@dataclass(slots=True)
class _Stream:
    """One stream under a policy, and where it stands."""

    robot: str
    policy: History
    type_name: str
    seen: int = 0
    last_ns: int | None = None
    span: list[tuple[Header, Any]] = field(default_factory=list)
    spans: int = 0

    @property
    def product(self) -> str:
        return PRODUCTS.get(self.type_name, "sample")

    def takes(self, stamp_ns: int) -> bool:
        """Whether the policy keeps the next sample."""
        wanted = self.seen % self.policy.every_n == 0
        self.seen += 1
        if self.last_ns is not None and 0 <= stamp_ns - self.last_ns < self.policy.every_s * 1e9:
            return False
        if wanted:
            self.last_ns = stamp_ns
        return wanted


class Recorder:
    """Keeps what the profile's ``history`` says.

    Attributes
    ----------
    counters : mapping of str to int
        ``kept`` products, ``skipped`` samples by policy, ``refused`` ones that could not be stored, ``dropped`` ones
        that came faster than they were stored, ``retired`` products that were kept long enough.
    """

    def __init__(self, bus: Bus, dpm: Dpm, profile: Profile) -> None:
        self._dpm = dpm
        self._lock = threading.Lock()
        self._counters = {"kept": 0, "skipped": 0, "refused": 0, "retired": 0}
        self._rules = rules_of_history(profile)
        self._looked_ns = dpm.clock.now_ns()
        dpm.counted["history"] = lambda: self.counters
        self._streams = {(s.robot, s.policy.sensor, s.policy.stream): s for s in streams_of(profile)}
        self._subscriptions = [
            bus.subscribe(keys.sensor(*names), self.take, depth=_DEPTH) for names in self._streams
        ]  # fmt: skip

    @property
    def counters(self) -> dict[str, int]:
        """Counts since the start."""
        with self._lock:
            return self._counters | {"dropped": sum(s.dropped for s in self._subscriptions)}

    def take(self, message: Message) -> None:
        """Keep a sample, or not."""
        _, _, robot, _, sensor, stream_name = message.key.split("/")
        stream = self._streams[(robot, sensor, stream_name)]
        try:
            header = Header.from_attachment(message.attachment)
            with self._lock:
                taken = stream.takes(header.t1_ns)
            if not taken:
                self._count("skipped")
            elif stream.type_name == _SPANNED:
                self._extend(stream, header, message)
            else:
                self._put(stream, header, message.payload, message.encoding)
        except CdffError as error:
            self._count("refused")
            logger.warning("sample on %s not kept: %s", message.key, error)

    def flush(self) -> None:
        """Store the spans that are open."""
        for stream in self._streams.values():
            if stream.span:
                self._close_span(stream)

    def _extend(self, stream: _Stream, header: Header, message: Message) -> None:
        """Add a sample to the open span; one that would outgrow it begins the next."""
        value = decode(*_named(message))
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
            last, id=product_id(stream.robot, policy.sensor, policy.stream, t1_ns, seq, last.config_hash), seq=seq,
            t0_ns=min(h.t0_ns for h in headers), t1_ns=t1_ns, producer=_PRODUCER, inputs=tuple(h.id for h in headers),
            sha256=None,
        )  # fmt: skip
        try:
            self._put(stream, header, encode(span, "uper"), encoding_string("ImuSpan", "uper"))
        except CdffError as error:
            self._count("refused")
            logger.warning("span of %s/%s of %s not kept: %s", policy.sensor, policy.stream, stream.robot, error)

    def _put(self, stream: _Stream, header: Header, payload: bytes, encoding: str) -> None:
        policy = stream.policy
        names = {
            "robot": stream.robot, "dfpc": policy.sensor, "port": policy.stream, "product": stream.product,
        }  # fmt: skip
        self._dpm.put(names, payload, encoding, header.to_attachment())
        self._count("kept")
        self._retire()

    def _retire(self) -> None:
        """Let go what was kept long enough, now and then; what a kept product was made from stays."""
        now_ns = self._dpm.clock.now_ns()
        with self._lock:
            if not self._rules or 0 <= now_ns - self._looked_ns < _LOOK_S * 1e9:
                return
            self._looked_ns = now_ns
        self._count("retired", self._dpm.retire(self._rules, apply=True).going)

    def _count(self, what: str, times: int = 1) -> None:
        with self._lock:
            self._counters[what] += times


def streams_of(profile: Profile) -> Iterable[_Stream]:
    """Streams that a policy of the profile holds for; the first policy of a stream counts."""
    found: dict[tuple[str, str, str], _Stream] = {}
    for policy in profile.history:
        for robot in profile.robots:
            sensor = robot.sensors.get(policy.sensor)
            if policy.robot in (None, robot.id) and sensor is not None and policy.stream in sensor.streams:
                key = (robot.id, policy.sensor, policy.stream)
                found.setdefault(key, _Stream(robot.id, policy, sensor.streams[policy.stream]))
    return found.values()


def rules_of_history(profile: Profile | None) -> tuple[Rule, ...]:
    """How long what is recorded stays, as rules of retention."""
    if profile is None:
        return ()
    return tuple(
        Rule(
            product=s.product, robot=s.robot, dfpc=s.policy.sensor, port=s.policy.stream, max_age_s=s.policy.keep_s
        )
        for s in streams_of(profile)
        if s.policy.keep_s is not None
    )  # fmt: skip


def _named(message: Message) -> tuple[str, bytes, str]:
    type_name, codec = parse_encoding(message.encoding)
    return type_name, message.payload, codec
