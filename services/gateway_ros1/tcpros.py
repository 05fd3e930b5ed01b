# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Connections of TCPROS: a header of fields on each side, then messages with their length.

As published in http://wiki.ros.org/ROS/TCPROS and http://wiki.ros.org/ROS/Connection%20Header.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Mapping
from contextlib import suppress

from cdff_common.errors import CodecError
from services.gateways.tcp_probes import probe

#: Largest header, bytes; time for one, seconds.
_MAX_HEADER, HANDSHAKE_S = 1 << 20, 5.0
_LENGTH = struct.Struct("<I")
#: Time in which a peer must take some bytes of a message, seconds, as ``struct timeval``.
SEND_S = 30
_SEND_TIMEOUT = struct.pack("ll", SEND_S, 0)


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return the bytes of a connection header with their length."""
    parts = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(body)) + body


def decode_header(body: bytes) -> dict[str, str]:
    """Return the fields of a header without its length; raises CodecError on anything else."""
    fields, position = {}, 0
    while position < len(body):
        if position + _LENGTH.size > len(body):
            raise CodecError(f"connection header of {len(body)} bytes: a length is cut off")
        (size,) = _LENGTH.unpack_from(body, position)
        start = position + _LENGTH.size
        position = start + size
        if position > len(body):
            raise CodecError(f"connection header of {len(body)} bytes: a field states {size} bytes")
        name, is_pair, value = body[start:position].partition(b"=")
        if not is_pair:
            raise CodecError(f"connection header: {name[:40]!r} has no =")
        fields[name.decode("utf-8", "replace")] = value.decode("utf-8", "replace")
    return fields


class Connection:
    """A connection of TCPROS.

    It ends if the other machine does not answer the probes of TCP, or takes no byte of a message in 30 s.

    Parameters
    ----------
    sock : socket.socket
    """

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        probe(sock)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _SEND_TIMEOUT)

    @classmethod
    def open(cls, host: str, port: int) -> Connection:
        """Connect to a node; raises OSError if that is not possible."""
        return cls(socket.create_connection((host, port), timeout=HANDSHAKE_S))

    def close(self) -> None:
        """Close the connection; a thread that reads or sends ends."""
        with suppress(OSError):  # it is closed by the other side
            self._sock.shutdown(socket.SHUT_RDWR)
        self._sock.close()

    def wait(self, timeout_s: float | None) -> None:
        """Limit the time of each of the following operations; None for no limit."""
        self._sock.settimeout(timeout_s)

    def send_header(self, fields: Mapping[str, str]) -> None:
        """Send a header."""
        self._sock.sendall(encode_header(fields))

    def receive_header(self) -> dict[str, str]:
        """Return the header of the other side; raises CodecError if it is malformed, EOFError without one."""
        return decode_header(self.receive(_MAX_HEADER))

    def send(self, data: bytes, prefix: bytes = b"") -> None:
        """Send a message with its length, after a prefix."""
        self._sock.sendall(prefix + _LENGTH.pack(len(data)) + data)

    def receive(self, max_bytes: int) -> bytes:
        """Return the next message.

        Raises
        ------
        CodecError
            If it has more than ``max_bytes``; the connection cannot be used further.
        EOFError
            If the other side has closed the connection.
        """
        (size,) = _LENGTH.unpack(self.receive_exactly(_LENGTH.size))
        if size > max_bytes:
            raise CodecError(f"message of {size} bytes: expected at most {max_bytes}")
        return self.receive_exactly(size)

    def receive_exactly(self, size: int) -> bytes:
        """Return a number of bytes; raises EOFError if there are fewer."""
        data = bytearray(size)
        view, position = memoryview(data), 0
        while position < size:
            count = self._sock.recv_into(view[position:])
            if not count:
                raise EOFError("the connection is closed")
            position += count
        return bytes(data)
