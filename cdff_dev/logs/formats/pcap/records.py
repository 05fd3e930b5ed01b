# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Records of network captures in the formats pcap and pcapng.

Harris, G., Richardson, M. PCAP Capture File Format. draft-ietf-opsawg-pcap-04.
Tuexen, M. et al. PCAP Now Generic (pcapng) Capture File Format. draft-ietf-opsawg-pcapng-02.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from cdff_common.errors import CodecError

PCAPNG_MAGIC = b"\x0a\x0d\x0d\x0a"
#: Size of the header of a PCAP file, and largest record, which is the largest snapshot length of tcpdump.
_HEADER_BYTES, _MAX_RECORD_BYTES = 24, 1 << 18
#: PCAPNG: types of the blocks with an interface and with a packet, and the number that shows the byte order.
_INTERFACE, _PACKET = 1, 6
_ORDER_MAGIC = 0x1A2B3C4D
#: PCAPNG: codes of options of an interface.
_END_OF_OPTIONS, _TIME_RESOLUTION = 0, 9


class Record(NamedTuple):
    """A captured packet: its offsets in the file, its arrival, the type of its link, its content."""

    start: int
    end: int
    arrival_ns: int
    link: int
    data: bytes


class DamagedRecordError(CodecError):
    """A capture whose remaining records cannot be found; ``offset`` is the end of the readable part."""

    def __init__(self, path: Path, offset: int, reason: str) -> None:
        super().__init__(f"{path}: byte {offset}: {reason}; the remainder is lost")
        self.offset = offset
        self.reason = reason


@dataclass(slots=True)
class _Section:
    """Section of a pcapng file: byte order, and link and time units per second by offset of the interface."""

    order: str
    interfaces: dict[int, tuple[int, int]] = field(default_factory=dict)


@dataclass(slots=True)
class RecordReader:
    """Reader of the records of a capture.

    A later call of ``records`` may begin at the start of any record that an earlier one yielded.
    """

    path: Path
    _sections: dict[int, _Section] = field(default_factory=dict)

    def records(self, start: int = 0) -> Iterator[Record]:
        """Yield the records from an offset on; 0 is the first one.

        Raises DamagedRecordError where a record is truncated or has an impossible length.
        """
        with self.path.open("rb") as file:
            if file.read(4) == PCAPNG_MAGIC:
                yield from self._blocks(file, start)
            else:
                yield from self._pcap(file, start)

    def _pcap(self, file: BinaryIO, start: int) -> Iterator[Record]:
        """Yield the records of a PCAP file that start at or after an offset; raises DamagedRecordError."""
        file.seek(0)
        head = file.read(_HEADER_BYTES)
        if len(head) < _HEADER_BYTES:
            raise DamagedRecordError(self.path, 0, f"{len(head)} bytes, expected a header of {_HEADER_BYTES}")
        order = "<" if head[:1] in (b"\xd4", b"\x4d") else ">"
        unit_ns = 1 if b"\x3c" in head[1:3] else 1000
        link = struct.unpack_from(f"{order}I", head, 20)[0] & 0xFFFF
        prefix = struct.Struct(f"{order}IIII")
        at = max(start, _HEADER_BYTES)
        file.seek(at)
        while record_header := file.read(prefix.size):
            if len(record_header) < prefix.size:
                raise DamagedRecordError(self.path, at, "the file ends in the header of a packet")
            seconds, fraction, length, _ = prefix.unpack(record_header)
            data = file.read(length) if length <= _MAX_RECORD_BYTES else b""
            if len(data) < length:
                raise DamagedRecordError(self.path, at, _wrong_length(length))
            end = at + prefix.size + length
            yield Record(at, end, seconds * 1_000_000_000 + fraction * unit_ns, link, data)
            at = end

    def _blocks(self, file: BinaryIO, start: int) -> Iterator[Record]:
        """Yield the packets of a PCAPNG file that start at or after an offset; raises DamagedRecordError."""
        file.seek(start)
        at = start
        section = self._sections[max(known for known in self._sections if known <= start)] if start else None
        while block_header := file.read(8):
            if len(block_header) == 8 and block_header[:4] == PCAPNG_MAGIC:
                section = self._sections.setdefault(at, _Section(self._byte_order(file, at)))
            order = section.order if section else "<"
            kind, length = struct.unpack(f"{order}II", block_header) if len(block_header) == 8 else (0, 0)
            if section is None or length % 4 or not 12 <= length <= _MAX_RECORD_BYTES:
                raise DamagedRecordError(self.path, at, _wrong_length(length))
            body = file.read(length - 8)
            if len(body) < length - 8:
                raise DamagedRecordError(self.path, at, _wrong_length(length))
            if kind == _INTERFACE:
                section.interfaces[at] = _interface(body, order)
            if kind == _PACKET:
                yield self._packet(at, length, body, section)
            at += length

    def _byte_order(self, file: BinaryIO, at: int) -> str:
        magic = file.read(4)
        file.seek(at + 8)
        for sign in "<>":
            if magic == struct.pack(f"{sign}I", _ORDER_MAGIC):
                return sign
        raise DamagedRecordError(self.path, at, f"byte-order magic {magic.hex()}, expected 1a2b3c4d")

    def _packet(self, at: int, length: int, body: bytes, section: _Section) -> Record:
        """Return the packet of an enhanced packet block."""
        if len(body) < 24:
            raise DamagedRecordError(self.path, at, _wrong_length(length))
        number, high, low, size, _ = struct.unpack_from(f"{section.order}IIIII", body)
        if number >= len(section.interfaces) or size > len(body) - 24:
            raise DamagedRecordError(self.path, at, f"interface {number} or packet of {size} bytes")
        link, units_per_s = list(section.interfaces.values())[number]
        arrival_ns = ((high << 32) + low) * 1_000_000_000 // units_per_s
        return Record(at, at + length, arrival_ns, link, body[20 : 20 + size])


def _interface(body: bytes, order: str) -> tuple[int, int]:
    """Return type of the link and time units per second of an interface."""
    at, units_per_s = 8, 1_000_000
    link = struct.unpack_from(f"{order}H", body)[0] if len(body) >= 2 else 0
    while at + 4 <= len(body):
        code, size = struct.unpack_from(f"{order}HH", body, at)
        if code == _END_OF_OPTIONS:
            break
        if code == _TIME_RESOLUTION and size == 1 and at + 5 <= len(body):
            exponent = body[at + 4]
            units_per_s = 1 << (exponent & 0x3F) if exponent & 0x80 else 10 ** min(exponent, 18)
        at += 4 + (size + 3) // 4 * 4
    return link, units_per_s


def _wrong_length(length: int) -> str:
    return f"a packet of {length} bytes, expected at most {_MAX_RECORD_BYTES} and all in the file"
