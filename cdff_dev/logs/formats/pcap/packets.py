# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UDP datagrams of a network capture, assembled from their IPv4 fragments (RFC 791, RFC 768)."""

from __future__ import annotations

import logging
from collections import Counter, OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from cdff_common.errors import InputError
from cdff_dev.logs.formats.pcap.records import DamagedRecordError, RecordReader
from cdff_dev.logs.source import Unconverted

_log = logging.getLogger(__name__)
#: EtherType of IPv4 and protocol number of UDP in an IPv4 header.
_IP_V4, _UDP = b"\x08\x00", 17
_VLAN_TAGS = (b"\x81\x00", b"\x88\xa8")
#: Length of the header of each type of link (https://www.tcpdump.org/linktypes.html), and the position of
#: the two bytes that name the protocol in it: Ethernet, Linux "any" in both versions; loopback and raw IP
#: have none.
_LINKS: dict[int, tuple[int, int | None]] = {
    1: (14, 12),
    113: (16, 14),
    276: (20, 0),
    0: (4, None),
    12: (0, None),
    101: (0, None),
    228: (0, None),
}
#: Largest number of datagrams with missing fragments; the oldest is given up.
_MAX_PENDING = 64
_NOT_UDP, _INCOMPLETE = "packets other than UDP over IPv4", "datagrams with lost fragments"


class Datagram(NamedTuple):
    """A UDP datagram: offsets of its records in the file, arrival, destination port, content."""

    start: int
    end: int
    arrival_ns: int
    port: int
    data: bytes


@dataclass(slots=True)
class _Fragments:
    """Fragments of a datagram by their offset; ``size`` is 0 until the last one has arrived."""

    start: int
    parts: dict[int, bytes] = field(default_factory=dict)
    size: int = 0

    def content(self) -> bytes | None:
        """Return the datagram if all of it has arrived."""
        if not self.size or sum(map(len, self.parts.values())) < self.size:
            return None
        return b"".join(part for _, part in sorted(self.parts.items()))


class Capture:
    """A capture of UDP datagrams.

    Raises
    ------
    InputError
        If its packets have a type of link that is not supported.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reader = RecordReader(path)
        self._lost: Counter[str] = Counter()
        self._damage: DamagedRecordError | None = None

    @property
    def unconverted(self) -> dict[str, Unconverted]:
        """Counts of packets without a datagram, and the end of a damaged file; ``datagrams`` fills both."""
        contents = {
            name: Unconverted("packet", count, "no data of a lidar") for name, count in self._lost.items()
        }
        if self._damage is not None:
            contents[f"byte {self._damage.offset}"] = Unconverted("damaged part", 1, self._damage.reason)
        return contents

    def description(self, sizes: Mapping[int, int]) -> str:
        """Return numbers of datagrams by size, and where a damaged file ends, for an error message."""
        largest = sorted(sizes.items(), key=lambda item: -item[1])[:3]
        counts = ", ".join(f"{count} of {size} bytes" for size, count in largest) or "none"
        return (
            counts
            if self._damage is None
            else f"{counts} (byte {self._damage.offset}: {self._damage.reason})"
        )

    def datagrams(self, start: int = 0, end: int | None = None) -> Iterator[Datagram]:
        """Yield the datagrams, or those whose records lie between two offsets of an earlier call."""
        pending: OrderedDict[bytes, _Fragments] = OrderedDict()
        lost_packets: Counter[str] = Counter()
        try:
            for record in self._reader.records(start):
                if end is not None and record.start >= end:
                    return
                ip = self._ip(record.link, record.data)
                if ip is None or len(ip) < 20 or ip[0] >> 4 != 4 or ip[9] != _UDP:
                    lost_packets[_NOT_UDP] += 1
                    continue
                first, udp = record.start, ip[4 * (ip[0] & 15) : int.from_bytes(ip[2:4], "big") or None]
                if ip[6] & 0x3F or ip[7]:
                    first, datagram = _assemble(pending, ip, udp, record.start)
                    if len(pending) > _MAX_PENDING:
                        pending.popitem(last=False)
                        lost_packets[_INCOMPLETE] += 1
                    if datagram is None:
                        continue
                    udp = datagram
                port, size = int.from_bytes(udp[2:4], "big"), int.from_bytes(udp[4:6], "big")
                yield Datagram(first, record.end, record.arrival_ns, port, udp[8:size])
        except DamagedRecordError as error:
            if self._damage is None:
                _log.warning("%s", error)
                self._damage = error
        if start == 0 and end is None:
            lost_packets[_INCOMPLETE] += len(pending)
            self._lost = +lost_packets

    def _ip(self, link: int, packet: bytes) -> bytes | None:
        """Return the IPv4 packet in a frame of a link; None for other protocols."""
        if link not in _LINKS:
            raise InputError(
                f"{self.path}: link type {link}, expected one of {', '.join(map(str, sorted(_LINKS)))} "
                "(Ethernet, Linux any, loopback, raw IP): capture on the Ethernet interface of the lidar"
            )
        at, protocol = _LINKS[link]
        if protocol is None:
            return packet[at:]
        while link == 1 and packet[at - 2 : at] in _VLAN_TAGS:
            at, protocol = at + 4, protocol + 4
        return packet[at:] if packet[protocol : protocol + 2] == _IP_V4 else None


def _assemble(
    pending: OrderedDict[bytes, _Fragments], ip: bytes, part: bytes, start: int
) -> tuple[int, bytes | None]:
    """Add a fragment; return the start of its datagram, and its content once it is complete."""
    key = ip[4:6] + ip[12:20]
    known = pending.setdefault(key, _Fragments(start))
    offset = 8 * (int.from_bytes(ip[6:8], "big") & 0x1FFF)
    known.parts[offset] = part
    if not ip[6] & 0x20:
        known.size = offset + len(part)
    if (datagram := known.content()) is not None:
        del pending[key]
    return known.start, datagram
