# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UDP packets of a pcap file (https://www.ietf.org/archive/id/draft-ietf-opsawg-pcap-04.html)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

_ETHERNET_HEADER, _VLAN, _IP_V4, _UDP = 14, b"\x81\x00", b"\x08\x00", 17
_HEADER_BYTES, _MAX_PACKET_BYTES = 24, 1 << 18


def udp_packets(path: Path, report: Callable[[int, str], None]) -> Iterator[tuple[int, bytes]]:
    """Yield time of arrival in nanoseconds and content of each UDP packet over IPv4 and Ethernet.

    ``report`` is called with offset and reason if the file ends in a damaged packet.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
        order = "<" if head[:1] in (b"\xd4", b"\x4d") else ">"
        unit_ns = 1 if b"\x3c" in head[1:3] else 1000
        prefix = struct.Struct(f"{order}IIII")
        while True:
            at = file.tell()
            found = file.read(prefix.size)
            if len(found) < prefix.size:
                if found or len(head) < _HEADER_BYTES:
                    report(at, "the file ends in the header of a packet")
                return
            seconds, fraction, length, _ = prefix.unpack(found)
            data = file.read(length) if length <= _MAX_PACKET_BYTES else b""
            if len(data) < length:
                report(
                    at,
                    f"a packet of {length} bytes, expected at most {_MAX_PACKET_BYTES} and all in the file",
                )
                return
            if (content := _udp_content(data)) is not None:
                yield seconds * 1_000_000_000 + fraction * unit_ns, content


def _udp_content(packet: bytes) -> bytes | None:
    """Return the content of a UDP packet; None for others."""
    at = _ETHERNET_HEADER
    if packet[at - 2 : at] == _VLAN:
        at += 4
    ip = packet[at:]
    if packet[at - 2 : at] != _IP_V4 or len(ip) < 20 or ip[0] >> 4 != 4 or ip[9] != _UDP:
        return None
    udp = ip[4 * (ip[0] & 15) :]
    return udp[8 : int.from_bytes(udp[4:6], "big")]
