# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Telemetry in PUS packets (ECSS-E-ST-70-41C): verification, housekeeping and events.

The time stamp of a packet is in CUC format with 4 octets of seconds and 3 octets of fractions. Its epoch is
1970-01-01 UTC, without leap seconds, which is agency-defined (CCSDS 301.0-B-4, 3.2), with P-field ``0x2F``.
"""

from __future__ import annotations

import struct
import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import astuple, dataclass
from enum import IntEnum

from spacepackets.ecss.req_id import RequestId
from spacepackets.ecss.tc import PusTc
from spacepackets.ecss.tm import PusTm

from cdff_common.clock import NS_PER_S

_P_FIELD = 0x2F
_FRACTIONS = 1 << 24
#: Structure identifier of the housekeeping report.
STRUCTURE = 1
_HOUSEKEEPING = struct.Struct(">BHHHIQIIIII")
_MAX_TEXT_BYTES = 255
#: Events and verification reports that wait for the next contact.
_MAX_HELD = 1000
_SEQUENCE = 1 << 14
_COUNTER = 1 << 16


class Stage(IntEnum):
    """Subtypes of PUS service 1 for success; that of the failure is greater by one."""

    ACCEPTANCE = 1
    START = 3
    COMPLETION = 7


class Failure(IntEnum):
    """Failure codes of PUS service 1."""

    MALFORMED = 1
    DENIED = 2
    OVERLOADED = 3
    EXECUTION = 4


class EventSeverity(IntEnum):
    """Subtype of PUS service 5."""

    INFORMATIVE = 1
    LOW = 2
    MEDIUM = 3
    HIGH = 4


@dataclass(frozen=True, slots=True)
class Housekeeping:
    """Housekeeping report of structure ``STRUCTURE``; its fields are packed in this order.

    Attributes
    ----------
    services : int
        Liveliness tokens under the robot id and ``ground``, 16 bit.
    warnings, criticals : int
        Active alarms, 16 bit.
    waiting_products : int
        Products in the spool, 32 bit.
    waiting_bytes : int
        64 bit.
    delivered_files, repeated_files, commands, refused_commands, position : int
        32 bit; ``position`` is the ordinal of the last event that was read from the DPM.
    """

    services: int
    warnings: int
    criticals: int
    waiting_products: int
    waiting_bytes: int
    delivered_files: int
    repeated_files: int
    commands: int
    refused_commands: int
    position: int

    def pack(self) -> bytes:
        """Return the source data of the packet."""
        return _HOUSEKEEPING.pack(STRUCTURE, *astuple(self))


class Telemetry:
    """Sender of PUS packets; out of contact, events and verification reports wait for the next contact.

    Parameters
    ----------
    apid : int
    send : callable
        Sends a packet.
    now_ns : callable
        Mission time.
    """

    def __init__(self, apid: int, send: Callable[[bytes], None], now_ns: Callable[[], int]) -> None:
        self._apid, self._send, self._now_ns = apid, send, now_ns
        self._lock = threading.Lock()
        self._sequence = 0
        self._messages: Counter[tuple[int, int]] = Counter()
        self._held: deque[bytes] = deque(maxlen=_MAX_HELD)
        self._in_contact = False

    def set_contact(self, in_contact: bool) -> None:
        """Start or end a contact; at its start the waiting packets are sent."""
        with self._lock:
            self._in_contact = in_contact
            while in_contact and self._held:
                self._send(self._held.popleft())

    def housekeeping(self, report: Housekeeping) -> None:
        """Send a housekeeping report (3, 25) in contact; out of contact it is dropped."""
        if self._in_contact:
            self._publish(3, 25, report.pack())

    def event(self, severity: EventSeverity, kind: str, source: str, text: str) -> None:
        """Send an event report (5, severity) with three texts, each after its length in one byte."""
        self._publish(5, severity, b"".join(_short_text(part) for part in (kind, source, text)))

    def verification(self, tc: PusTc, stage: Stage, failure: Failure | None = None, text: str = "") -> None:
        """Send a verification report of a command: its request id and, after a failure, a code and a text."""
        data = RequestId.from_pus_tc(tc).pack()
        if failure is None:
            self._publish(1, stage, data)
        else:
            self._publish(1, stage + 1, data + struct.pack(">H", failure) + _short_text(text))

    def _publish(self, service: int, subtype: int, data: bytes) -> None:
        with self._lock:
            counter = self._messages[service, subtype]
            self._messages[service, subtype] = (counter + 1) % _COUNTER
            packet = PusTm(
                service=service,
                message_subtype=subtype,
                timestamp=timestamp(self._now_ns()),
                source_data=data,
                apid=self._apid,
                seq_count=self._sequence,
                message_counter=counter,
            )
            self._sequence = (self._sequence + 1) % _SEQUENCE
            packed = bytes(packet.pack())
            if self._in_contact:
                self._send(packed)
            else:
                self._held.append(packed)


def timestamp(now_ns: int) -> bytes:
    """Return a mission time in CUC format with P-field, 8 bytes."""
    seconds, rest_ns = divmod(now_ns, NS_PER_S)
    return struct.pack(">BI", _P_FIELD, seconds) + (rest_ns * _FRACTIONS // NS_PER_S).to_bytes(3, "big")


def _short_text(text: str) -> bytes:
    """Return the length of a text in one byte and its UTF-8 bytes, truncated at the end of a character."""
    data = text.encode()[:_MAX_TEXT_BYTES].decode(errors="ignore").encode()
    return bytes([len(data)]) + data
