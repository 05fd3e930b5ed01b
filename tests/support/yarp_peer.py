# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A name server and ports of YARP from the documentation of its protocol, without code of the gateway."""

from __future__ import annotations

import re
import socket
import struct
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Any

TCP = bytes([0x59, 0x41, 0xE4, 0x1E, 0, 0, 0x52, 0x50])


class _Server(ABC):
    """A listening socket; each client is served by ``serve`` in a thread of its own."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._clients: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for client in self._clients:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            client.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._clients.append(client)
            threading.Thread(target=self._serve_one, args=(client,), daemon=True).start()

    def _serve_one(self, client: socket.socket) -> None:
        with suppress(OSError, EOFError), client, client.makefile("rb") as stream:
            self.serve(client, stream)

    @abstractmethod
    def serve(self, client: socket.socket, stream: Any) -> None:
        """Answer one client until the connection ends."""


class YarpNames(_Server):
    """A name server."""

    def __init__(self) -> None:
        self.records: dict[str, tuple[str, int]] = {}
        super().__init__()

    def serve(self, client: socket.socket, stream: Any) -> None:
        client.sendall(b"Welcome " + stream.readline().removeprefix(b"CONNECT "))
        while line := stream.readline():
            if line.strip() != b"d":
                continue
            verb, name, *rest = stream.readline().decode().split()
            if verb == "register":
                self.records[name] = (rest[1], int(rest[2]))
            if verb == "unregister":
                self.records.pop(name, None)
            if name in self.records:
                host, port = self.records[name]
                client.sendall(f"registration name {name} ip {host} port {port} type tcp\n".encode())
            client.sendall(b"*** end of message\n")


class YarpOutputPort(_Server):
    """An output port: another port's name as a command connects it to that port."""

    def __init__(self, names: YarpNames, name: str) -> None:
        self.targets: list[socket.socket] = []
        self._names, self._name = names, name
        super().__init__()
        names.records[name] = ("127.0.0.1", self.port)

    def serve(self, client: socket.socket, stream: Any) -> None:
        client.sendall(b"Welcome " + stream.readline().removeprefix(b"CONNECT "))
        while line := stream.readline():
            target = line.strip().decode()
            if not target.startswith("/"):
                continue
            sock = socket.create_connection(self._names.records[target], timeout=5.0)
            name = self._name.encode() + b"\0"
            sock.sendall(TCP + struct.pack("<I", len(name)) + name)
            reply = sock.recv(8, socket.MSG_WAITALL)
            assert (reply[:2], reply[6:]) == (b"YA", b"RP")
            self.targets.append(sock)
            client.sendall(f"Added connection from {self._name} to {target}\n".encode())

    def send(self, data: bytes, stamp_s: str = "") -> None:
        """Send data to all targets, with the envelope of a stamp, and read the acknowledgements."""
        blocks = [b"\0\0\0\0~d\0\1", data]
        if stamp_s:
            text = f"d 7 {stamp_s}\0".encode()
            blocks = [struct.pack("<I", len(text)) + b"~\0\0\1", text, data]
        message = b"YA\x0a\0\0\0RP" + bytes([len(blocks), 1]) + b"\xff" * 8
        message += b"".join(struct.pack("<I", len(block)) for block in blocks) + bytes(4) + b"".join(blocks)
        for sock in self.targets:
            sock.sendall(message)
            assert re.fullmatch(rb"YA\0\0\0\0RP", sock.recv(8, socket.MSG_WAITALL))

    def close(self) -> None:
        super().close()
        for sock in self.targets:
            sock.close()


class YarpInputPort(_Server):
    """An input port that collects messages: their envelope and data."""

    def __init__(self, names: YarpNames, name: str) -> None:
        self.received: list[tuple[str, bytes]] = []
        super().__init__()
        names.records[name] = ("127.0.0.1", self.port)

    def serve(self, client: socket.socket, stream: Any) -> None:
        assert stream.read(8) == TCP
        stream.read(struct.unpack("<I", stream.read(4))[0])
        client.sendall(b"YA" + struct.pack("<H", self.port) + b"\0\0RP")
        while header := stream.read(8):
            assert header == b"YA\x0a\0\0\0RP"
            count = stream.read(10)[0]
            sizes = struct.unpack(f"<{count}I", stream.read(4 * count))
            stream.read(4)
            blocks = [stream.read(size) for size in sizes]
            client.sendall(b"YA\0\0\0\0RP")
            self.received.append((b"".join(blocks[1:-1]).rstrip(b"\0").decode(), blocks[-1]))
