# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bit writer and bit reader of unaligned PER.

Loading the compiled loops takes a large part of a second. They are not loaded for short arrays, e.g. in a
client that requests poses; the Python code produces the same bytes.
"""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.real import decode_real, encode_real
from cdff_common.codecs.warm import has_numba
from cdff_common.errors import CodecError

#: Bits that are collected in one integer before they become bytes.
_FLUSH_BITS = 1024
_KERNELS = "cdff_common.codecs._kernels"
#: Above these sizes the compiled loops are loaded.
_SHORT_REALS = 64
_SHORT_OCTETS = 4096
#: Bytes at odd offsets up to this size are shifted as an integer even if the loops are loaded.
_TINY_OCTETS = 64
#: Parts of at least this size are not copied until the message is complete.
_LONG_BYTES = 65536


def _kernels(is_short: bool) -> ModuleType | None:
    """Return the compiled loops; None if they are not worth loading, or numba is not installed."""
    if is_short:
        module = sys.modules.get(_KERNELS)
        # Another thread may be loading them.
        return None if module is None or getattr(module.__spec__, "_initializing", False) else module
    if not has_numba():
        return None
    from cdff_common.codecs import _kernels as kernels

    return kernels


class BitWriter:
    """Writer that collects bits: scalars in an integer, arrays by compiled loops."""

    __slots__ = ("_count", "_octets", "_parts", "_pending")

    def __init__(self) -> None:
        #: Parts before ``_octets``; long parts are joined once, at the end.
        self._parts: list[bytes | bytearray | memoryview] = []
        self._octets = bytearray()
        self._pending = 0
        self._count = 0

    def put(self, value: int, bits: int) -> None:
        """Append a non-negative value of at most ``bits`` bits."""
        self._pending = (self._pending << bits) | value
        self._count += bits
        if self._count >= _FLUSH_BITS:
            self._flush()

    def _flush(self) -> None:
        """Move complete bytes out of the integer."""
        rest = self._count & 7
        complete_bytes = self._count >> 3
        self._octets += (self._pending >> rest).to_bytes(complete_bytes, "big")
        self._pending &= (1 << rest) - 1
        self._count = rest

    def put_bytes(self, octets: bytes | NDArray[np.uint8]) -> None:
        """Append bytes."""
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
        kernels.write_bytes(source, out, self._count)
        self._append_output(out, size)

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
        self._append_output(out, int(kernels.encode_reals(values.view(np.int64), out, self._count)))

    def _append_output(self, out: NDArray[np.uint8], size: int) -> None:
        """Append ``size`` bytes of a loop's output and keep the following bits."""
        self._append(out[:size].data)
        self._pending = int(out[size]) >> (8 - self._count) if self._count else 0

    def _append(self, octets: bytes | memoryview) -> None:
        """Append complete bytes."""
        if len(octets) < _LONG_BYTES:
            self._octets += octets
            return
        self._parts += (self._octets, octets)
        self._octets = bytearray()

    def put_length(self, length: int) -> int:
        """Append a length determinant (X.691 11.9.3.5-8); return the part of ``length`` that it covers."""
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
        """Return all bytes, the last one padded with zeros; at least one (X.691 11.1.3)."""
        self._flush()
        tail = bytes([self._pending << (8 - self._count)]) if self._count else b""
        return b"".join((*self._parts, self._octets, tail)) or b"\0"


class BitReader:
    """Reader of the bits of a message; sizes beyond its end are refused before any allocation."""

    __slots__ = ("_array", "_bits", "_data", "_position")

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._bits = 8 * len(data)
        self._position = 0
        self._array: NDArray[np.uint8] | None = None

    @property
    def remaining_bits(self) -> int:
        """Return the number of unread bits."""
        return self._bits - self._position

    def get(self, bits: int) -> int:
        """Read an unsigned number."""
        begin = self._position
        end = begin + bits
        if end > self._bits:
            raise CodecError(
                f"bit {begin}: {bits} bits expected, {self._bits - begin} left: the message is truncated"
            )
        self._position = end
        last = (end + 7) >> 3
        return (int.from_bytes(self._data[begin >> 3 : last], "big") >> (8 * last - end)) & ((1 << bits) - 1)

    def require(self, bits: int, element: str) -> None:
        """Raise CodecError if the rest of the message is shorter than ``bits``."""
        if bits > self.remaining_bits:
            raise CodecError(
                f"bit {self._position}: {element} needs {bits} bits at least, {self.remaining_bits} left"
            )

    def get_length(self) -> tuple[int, bool]:
        """Read a length determinant; return the length, and whether more fragments follow."""
        first = self.get(8)
        if first < 0x80:
            return first, False
        if first < 0xC0:
            return ((first & 0x3F) << 8) | self.get(8), False
        if not 1 <= first & 0x3F <= 4:
            raise CodecError(f"bit {self._position - 8}: fragment of {first & 0x3F} blocks, expected 1 to 4")
        return (first & 0x3F) << 14, True

    def get_bytes(self, size: int) -> bytes:
        """Read bytes."""
        self.require(8 * size, f"OCTET STRING of {size}")
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
        kernels.read_bytes(self._pad_message(kernels.READ_PADDING), begin, shift, out)
        return out.tobytes()

    def get_byte_array(self, size: int) -> NDArray[np.uint8]:
        """Read bytes into a new array."""
        self.require(8 * size, f"OCTET STRING of {size}")
        shift = self._position & 7
        out = np.empty(size, dtype=np.uint8)
        begin = self._position >> 3
        kernels = _kernels(size <= _SHORT_OCTETS) if shift else None
        if kernels is None:
            out[:] = np.frombuffer(self.get_bytes(size), dtype=np.uint8)
            return out
        if self._array is None and size < len(self._data) // 2:
            # A padded copy of the whole message would double the memory of decoding it.
            part = np.frombuffer(self._data, dtype=np.uint8, count=size + 1, offset=begin).copy()
            kernels.read_bytes(part, 0, shift, out)
        else:
            kernels.read_bytes(self._pad_message(kernels.READ_PADDING), begin, shift, out)
        self._position += 8 * size
        return out

    def get_reals(self, count: int) -> NDArray[np.float64]:
        """Read ``count`` REALs."""
        self.require(8 * count, f"{count} REALs")
        kernels = _kernels(count <= _SHORT_REALS)
        if kernels is None:
            return np.array([self._real() for _ in range(count)], dtype=np.float64)
        values = np.empty(count, dtype=np.float64)
        count_read = 0
        while count_read < count:
            shift = self._position & 7
            # bytes that start at this shift and end within the message
            end = (self._bits - shift) >> 3
            buffer = self._pad_message(kernels.READ_PADDING)
            read, at = kernels.decode_reals(buffer, self._position >> 3, shift, end, values[count_read:])
            self._position = 8 * int(at) + shift
            count_read += int(read)
            if count_read < count:
                values[count_read] = self._real()
                count_read += 1
        return values

    def _real(self) -> float:
        """Read one REAL of any form."""
        length, more = self.get_length()
        if more:
            raise CodecError(f"bit {self._position}: REAL in fragments, expected at most 16383 octets")
        return decode_real(self.get_bytes(length))

    def _pad_message(self, padding: int) -> NDArray[np.uint8]:
        """Return the message with padding for loops that read whole words."""
        if self._array is None:
            array = np.zeros(len(self._data) + padding, dtype=np.uint8)
            array[: len(self._data)] = np.frombuffer(self._data, dtype=np.uint8)
            self._array = array
        return self._array

    def finish(self) -> None:
        """Check that only zeros are left: asn1scc pads messages to their largest size."""
        rest = self.remaining_bits
        if rest and (self.get(rest & 7) or self._data[self._position >> 3 :].strip(b"\0")):
            raise CodecError(f"{rest} nonzero bits behind the message")
