# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bits in and out: the writer and the reader of unaligned PER.

Loading the compiled loops takes a good part of a second. A process that has met only short arrays, as a client that
asks for poses, does without: the plain way gives the same octets.
"""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.real import decode_real, encode_real
from cdff_common.errors import CodecError

_FLUSH_BITS = 1024
_KERNELS = "cdff_common.codecs._kernels"
#: Above these sizes the compiled loops are loaded.
_SHORT_REALS = 64
_SHORT_OCTETS = 4096
#: Octets at odd offsets up to this size go through an integer even where the loops are there.
_TINY_OCTETS = 64
#: Parts from this size on are not copied before the message is whole.
_LONG_OCTETS = 65536


def _kernels(is_short: bool) -> ModuleType | None:
    """The compiled loops; None where they are neither loaded nor worth it."""
    if is_short:
        module = sys.modules.get(_KERNELS)
        # Another thread may be in the middle of loading them.
        return None if module is None or getattr(module.__spec__, "_initializing", False) else module
    from cdff_common.codecs import _kernels as kernels

    return kernels


class BitWriter:
    """Collects bits; scalars in an integer, arrays through compiled loops."""

    __slots__ = ("_count", "_octets", "_parts", "_pending")

    def __init__(self) -> None:
        #: What lies before ``_octets``: long parts are joined once, at the end.
        self._parts: list[bytes | bytearray | memoryview] = []
        self._octets = bytearray()
        self._pending = 0
        self._count = 0

    def put(self, value: int, bits: int) -> None:
        """Append the lower ``bits`` of a non-negative value that they hold."""
        self._pending = (self._pending << bits) | value
        self._count += bits
        if self._count >= _FLUSH_BITS:
            self._flush()

    def _flush(self) -> None:
        """Move whole octets out of the integer."""
        rest = self._count & 7
        whole = self._count >> 3
        self._octets += (self._pending >> rest).to_bytes(whole, "big")
        self._pending &= (1 << rest) - 1
        self._count = rest

    def put_octets(self, octets: bytes | NDArray[np.uint8]) -> None:
        """Append octets."""
        size = len(octets)
        kernels = None if size <= _TINY_OCTETS else _kernels(size <= _SHORT_OCTETS)
        if kernels is None:
            data = octets if isinstance(octets, bytes) else octets.tobytes()
            self.put(int.from_bytes(data, "big"), 8 * size)
            return
        self._flush()
        if self._count == 0:
            self._append(octets if isinstance(octets, bytes) else octets.data)
            return
        source = np.frombuffer(octets, dtype=np.uint8) if isinstance(octets, bytes) else octets
        out = np.empty(size + 1, dtype=np.uint8)
        out[0] = self._pending << (8 - self._count)
        kernels.write_octets(source, out, self._count)
        self._take(out, size)

    def put_reals(self, values: NDArray[np.float64]) -> None:
        """Append REALs ``(n,)``."""
        kernels = _kernels(values.size <= _SHORT_REALS)
        if kernels is None:
            for value in values.tolist():
                contents = encode_real(value)
                self.put(len(contents), 8)
                self.put(int.from_bytes(contents, "big"), 8 * len(contents))
            return
        self._flush()
        out = np.empty(kernels.REAL_MAX_OCTETS * values.size + 16, dtype=np.uint8)
        out[0] = self._pending << (8 - self._count)
        self._take(out, int(kernels.encode_reals(values.view(np.int64), out, self._count)))

    def _take(self, out: NDArray[np.uint8], size: int) -> None:
        """Append ``size`` octets of a loop's output, and keep the bits behind them."""
        self._append(out[:size].data)
        self._pending = int(out[size]) >> (8 - self._count) if self._count else 0

    def _append(self, octets: bytes | memoryview) -> None:
        """Append whole octets."""
        if len(octets) < _LONG_OCTETS:
            self._octets += octets
            return
        self._parts += (self._octets, octets)
        self._octets = bytearray()

    def put_length(self, length: int) -> int:
        """Append a length determinant of X.691 11.9.3.5-8; returns how many of ``length`` it announces."""
        if length < 0x80:
            self.put(length, 8)
            return length
        if length < 0x4000:
            self.put(0x8000 | length, 16)
            return length
        blocks = min(length >> 14, 4)
        self.put(0xC0 | blocks, 8)
        return blocks << 14

    def to_bytes(self) -> bytes:
        """All octets, the last one filled up with zeros; at least one (X.691 11.1.3)."""
        self._flush()
        tail = bytes([self._pending << (8 - self._count)]) if self._count else b""
        return b"".join((*self._parts, self._octets, tail)) or b"\0"


class BitReader:
    """Reads bits of a message; what lies behind its end is refused before anything is allocated for it."""

    __slots__ = ("_array", "_bits", "_data", "_position")

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._bits = 8 * len(data)
        self._position = 0
        self._array: NDArray[np.uint8] | None = None

    @property
    def left(self) -> int:
        """Bits not yet read."""
        return self._bits - self._position

    def get(self, bits: int) -> int:
        """Read an unsigned number."""
        begin = self._position
        end = begin + bits
        if end > self._bits:
            raise CodecError(f"bit {begin}: {bits} bits wanted, {self._bits - begin} left: the message is cut off")
        self._position = end
        last = (end + 7) >> 3
        return (int.from_bytes(self._data[begin >> 3 : last], "big") >> (8 * last - end)) & ((1 << bits) - 1)

    def need(self, bits: int, what: str) -> None:
        """Refuse a claim that the rest of the message cannot hold."""
        if bits > self.left:
            raise CodecError(f"bit {self._position}: {what} needs {bits} bits at least, {self.left} left")

    def get_length(self) -> tuple[int, bool]:
        """Read a length determinant; returns the length, and whether more fragments follow."""
        first = self.get(8)
        if first < 0x80:
            return first, False
        if first < 0xC0:
            return ((first & 0x3F) << 8) | self.get(8), False
        if not 1 <= first & 0x3F <= 4:
            raise CodecError(f"bit {self._position - 8}: fragment of {first & 0x3F} blocks, expected 1 to 4")
        return (first & 0x3F) << 14, True

    def get_octets(self, size: int) -> bytes:
        """Read octets."""
        self.need(8 * size, f"OCTET STRING of {size}")
        shift = self._position & 7
        begin = self._position >> 3
        if shift == 0:
            self._position += 8 * size
            return self._data[begin : begin + size]
        kernels = None if size <= _TINY_OCTETS else _kernels(size <= _SHORT_OCTETS)
        if kernels is None:
            return self.get(8 * size).to_bytes(size, "big")
        self._position += 8 * size
        out = np.empty(size, dtype=np.uint8)
        kernels.read_octets(self._padded(kernels.READ_PADDING), begin, shift, out)
        return out.tobytes()

    def get_octet_array(self, size: int) -> NDArray[np.uint8]:
        """Read octets into an array of their own."""
        self.need(8 * size, f"OCTET STRING of {size}")
        shift = self._position & 7
        out = np.empty(size, dtype=np.uint8)
        begin = self._position >> 3
        kernels = _kernels(size <= _SHORT_OCTETS) if shift else None
        if kernels is None:
            out[:] = np.frombuffer(self.get_octets(size), dtype=np.uint8)
            return out
        kernels.read_octets(self._padded(kernels.READ_PADDING), begin, shift, out)
        self._position += 8 * size
        return out

    def get_reals(self, count: int) -> NDArray[np.float64]:
        """Read ``count`` REALs."""
        self.need(8 * count, f"{count} REALs")
        kernels = _kernels(count <= _SHORT_REALS)
        if kernels is None:
            return np.array([self._real() for _ in range(count)], dtype=np.float64)
        values = np.empty(count, dtype=np.float64)
        done = 0
        while done < count:
            shift = self._position & 7
            # octets that begin at this shift and end within the message
            end = (self._bits - shift) >> 3
            buffer = self._padded(kernels.READ_PADDING)
            read, at = kernels.decode_reals(buffer, self._position >> 3, shift, end, values[done:])
            self._position = 8 * int(at) + shift
            done += int(read)
            if done < count:
                values[done] = self._real()
                done += 1
        return values

    def _real(self) -> float:
        """Read one REAL of any form."""
        length, more = self.get_length()
        if more:
            raise CodecError(f"bit {self._position}: REAL in fragments, expected at most 16383 octets")
        return decode_real(self.get_octets(length))

    def _padded(self, padding: int) -> NDArray[np.uint8]:
        """The message with room behind it for loops that read whole words."""
        if self._array is None:
            array = np.zeros(len(self._data) + padding, dtype=np.uint8)
            array[: len(self._data)] = np.frombuffer(self._data, dtype=np.uint8)
            self._array = array
        return self._array

    def finish(self) -> None:
        """Check that nothing but zeros is left: asn1scc pads messages to their largest size."""
        rest = self.left
        if rest and (self.get(rest & 7) or self._data[self._position >> 3 :].strip(b"\0")):
            raise CodecError(f"{rest} bits that are not zero behind the message")
