# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Connections of YARP by the carriers tcp and text (https://yarp.it/latest/yarp_protocol.html)."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from typing import NamedTuple

from cdff_common.errors import CodecError, InputError
from services.gateways.tcp_probes import probe

#: First bytes of a connection by tcp with acknowledgements, and without them.
_TCP_ACKS, _TCP = b"YA\xe4\x1e\x00\x00RP", b"YA\x64\x1e\x00\x00RP"
_TEXT = b"CONNECT "
_INDEX, _SIZES_LISTED = b"YA\x0a\x00\x00\x00RP", b"\x01" + b"\xff" * 8
_LENGTH = struct.Struct("<I")
#: Time of a handshake, and of a message that is sent, seconds; longest name or line, bytes; most blocks.
_TIMEOUT_S, _MAX_LINE, _MAX_BLOCKS = 5.0, 1 << 16, 255
_DATA = "dD"


class Received(NamedTuple):
    """A message of a port.

    Attributes
    ----------
    data : bytes
        Binary content, or with ``is_text`` a line of text.
    stamp_ns : int
        Time in its envelope, nanoseconds; 0 without one.
    is_text : bool
    """

    data: bytes
    stamp_ns: int
    is_text: bool


class IncomingConnection:
    """Connection from an output port to a port of this process.

    Parameters
    ----------
    sock : socket.socket
    port : int
        Number of the listening socket.
    """

    def __init__(self, sock: socket.socket, port: int) -> None:
        sock.settimeout(_TIMEOUT_S)
        probe(sock)
        self._socket, self._buffer = sock, b""
        magic = self._exactly(8)
        self._is_text = magic == _TEXT
        self._has_acks = magic == _TCP_ACKS
        if self._is_text:
            self.name = self._line()
            sock.sendall(f"Welcome {self.name}\r\n".encode("utf-8", "replace"))
        elif magic in (_TCP, _TCP_ACKS):
            size = _LENGTH.unpack(self._exactly(4))[0]
            if size > _MAX_LINE:
                raise CodecError(f"name of a port of {size} bytes: expected at most {_MAX_LINE}")
            self.name = self._exactly(size).rstrip(b"\0").decode("utf-8", "replace")
            sock.sendall(b"YA" + struct.pack("<H", port) + b"\0\0RP")
        else:
            raise CodecError(f"connection that begins with {magic!r}: expected the carrier tcp or text")
        sock.settimeout(None)

    def close(self) -> None:
        """Close the connection; a thread that reads ends."""
        with suppress(OSError):  # it is closed by the other side
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def receive(self, max_bytes: int) -> Received | None:
        """Return the next message; None for a command of the port, which is ignored.

        Raises
        ------
        InputError
            If it has more than ``max_bytes``; the connection cannot be used further.
        CodecError
            If it is malformed; the connection cannot be used further.
        EOFError
            If the other side has closed the connection.
        """
        return self._receive_text(max_bytes) if self._is_text else self._receive_binary(max_bytes)

    def _receive_text(self, max_bytes: int) -> Received | None:
        command = self._line()
        if command[:1].lower() != "d":
            if command.startswith("q"):
                raise EOFError("the other side ends the connection")
            return None
        envelope = command.lstrip("dDo").strip()
        line = self._line(max_bytes)
        return Received(line.encode(), _stamp_ns(envelope), True)

    def _receive_binary(self, max_bytes: int) -> Received | None:
        start = self._exactly(8)
        if start[:2] != b"YA" or start[6:] != b"RP":
            raise CodecError(f"message that begins with {start!r}: expected YA, a length, and RP")
        (length,) = _LENGTH.unpack(start[2:6])
        index = self._exactly(length) if length <= _MAX_BLOCKS else b""
        if length != 10 or index[1:] != _SIZES_LISTED:
            raise CodecError(f"message with an index of {length} bytes: expected 10 that announce sizes")
        sizes = struct.unpack(f"<{index[0]}I", self._exactly(4 * index[0]))
        self._exactly(4)  # size of a reply
        if sum(sizes) > max_bytes + 8 + _MAX_LINE:
            raise InputError(f"message of {sum(sizes)} bytes: expected at most {max_bytes}")
        data = self._exactly(sum(sizes))
        if self._has_acks:
            self._socket.sendall(b"YA\0\0\0\0RP")
        return _content(data, max_bytes)

    def _line(self, max_bytes: int = _MAX_LINE) -> str:
        """Return a line without its end."""
        while b"\n" not in self._buffer:
            if len(self._buffer) > max_bytes:
                raise InputError(f"line of more than {max_bytes} bytes: expected at most that")
            data = self._socket.recv(65536)
            if not data:
                raise EOFError("the connection is closed")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.rstrip(b"\r").decode("utf-8", "replace")

    def _exactly(self, size: int) -> bytes:
        data = bytearray(self._buffer[:size])
        self._buffer = self._buffer[size:]
        while len(data) < size:
            part = self._socket.recv(min(size - len(data), 1 << 20))
            if not part:
                raise EOFError("the connection is closed")
            data += part
        return bytes(data)


def _content(data: bytes, max_bytes: int) -> Received | None:
    """Return the content behind the command of a port: data with or without an envelope."""
    if len(data) < 8 or data[4:5] != b"~":
        raise CodecError(f"message of {len(data)} bytes without the command of a port")
    command, content, envelope = data[5:6], data[8:], ""
    if command == b"\0":
        text, separator, content = content.partition(b"\0")
        if not separator:
            raise CodecError("message whose command has no end")
        command, envelope = text[:1], text[1:].decode("utf-8", "replace")
    if command.decode("latin-1") not in _DATA:
        return None
    if len(content) > max_bytes:
        raise InputError(f"message of {len(content)} bytes: expected at most {max_bytes}")
    return Received(content, _stamp_ns(envelope), False)


def _stamp_ns(envelope: str) -> int:
    """Return the time of an envelope ``number seconds``, in whole microseconds; 0 without one."""
    words = envelope.split()
    if len(words) < 2:
        return 0
    try:
        seconds, _, fraction = words[1].partition(".")
        time_ns = int(seconds) * 1_000_000_000 + int(fraction[:6].ljust(6, "0") or "0") * 1000
    except ValueError:
        return 0
    return time_ns if 0 < time_ns < 1 << 62 else 0


class OutgoingConnection:
    """Connection to an input port by tcp with acknowledgements; its messages are sent one by one.

    Parameters
    ----------
    host : str
    port : int
    name : str
        Name of the port of this process.

    Raises
    ------
    OSError, EOFError
        If the port does not accept the connection.
    CodecError
        If it answers with another protocol.
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        self._socket = socket.create_connection((host, port), timeout=_TIMEOUT_S)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            text = name.encode() + b"\0"
            self._socket.sendall(_TCP_ACKS + _LENGTH.pack(len(text)) + text)
            answer = self._exactly(8)
            if answer[:2] != b"YA" or answer[6:] != b"RP":
                raise CodecError(f"{host}:{port} answers {answer!r}: expected a port of YARP")
        except BaseException:
            self._socket.close()
            raise

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def send(self, data: bytes, stamp_ns: int = 0, number: int = 0) -> None:
        """Send a message, with an envelope if it has a time, and wait until it is acknowledged."""
        blocks = [b"\0\0\0\0~D\0\1", data]
        if stamp_ns:
            seconds, rest_ns = divmod(stamp_ns, 1_000_000_000)
            text = f"D {number} {seconds}.{rest_ns // 1000:06d}".encode() + b"\0"
            blocks = [_LENGTH.pack(len(text)) + b"~\0\0\1", text, data]
        sizes = b"".join(_LENGTH.pack(len(block)) for block in blocks)
        index = bytes([len(blocks)]) + _SIZES_LISTED
        self._socket.sendall(_INDEX + index + sizes + bytes(4) + b"".join(blocks))
        answer = self._exactly(8)
        if answer[:2] != b"YA" or answer[6:] != b"RP":
            raise CodecError(f"acknowledgement {answer!r}: expected YA, a length, and RP")
        (size,) = _LENGTH.unpack(answer[2:6])
        if size > _MAX_LINE:
            raise CodecError(f"acknowledgement of {size} bytes: expected at most {_MAX_LINE}")
        self._exactly(size)

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self._socket.recv(size - len(data))
            if not part:
                raise EOFError("the port has closed the connection")
            data += part
        return data


class TextConnection:
    """Connection to a port by the carrier text, for commands and their answers.

    Parameters
    ----------
    host : str
    port : int
    name : str
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        self._socket = socket.create_connection((host, port), timeout=_TIMEOUT_S)
        self._buffer = b""
        try:
            self._socket.sendall(f"CONNECT {name}\n".encode())
            self.line()
        except BaseException:
            self._socket.close()
            raise

    def __enter__(self) -> TextConnection:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def command(self, text: str) -> str:
        """Send a command to the port, and return the first line of its answer."""
        self._socket.sendall(f"{text}\n".encode())
        return self.line()

    def data_line(self, text: str) -> None:
        """Send a line of data to the owner of the port."""
        self._socket.sendall(f"d\n{text}\n".encode())

    def line(self) -> str:
        """Return the next line; raises EOFError if the port ends the connection."""
        while b"\n" not in self._buffer:
            data = self._socket.recv(65536)
            if not data or len(self._buffer) > _MAX_LINE:
                raise EOFError("the port has closed the connection")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.rstrip(b"\r").decode("utf-8", "replace")
