# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ports of the gateway: they receive messages of the robot's ports, or send products to them."""

from __future__ import annotations

import logging
import socket
import threading
from collections import deque
from contextlib import suppress
from typing import Any

from cdff_common.bus import Bus
from cdff_common.clock import monotonic_s, wall_ns
from cdff_common.errors import CdffError, CodecError, InputError, UnavailableError
from cdff_common.interfaces.product import Header
from services.gateway_yarp.conversions import TYPES, to_cdff, to_yarp
from services.gateway_yarp.settings import InputPort, OutputPort
from services.gateways.product_link import ProductLink
from services.gateways.sample_link import CONVERSION_ERRORS, SampleLink
from services.yarp.carriers import IncomingConnection, OutgoingConnection, Received, TextConnection
from services.yarp.names import NameServer

logger = logging.getLogger(__name__)

#: Interval of the attempts to connect, seconds; connections of a port; products that wait for a port.
_RETRY_S, _MAX_CONNECTIONS, _MAX_WAITING = 2.0, 8, 16


class YarpInput:
    """A port that receives the messages of a port of the robot.

    Parameters
    ----------
    entry : InputPort
    name : str
        Name of the port of the gateway.
    names : NameServer
    robot, host : str
        Robot id, and address of this machine for the robot.
    bus : Bus
        Bus of the samples.
    """

    def __init__(
        self, entry: InputPort, name: str, names: NameServer, robot: str, host: str, bus: Bus
    ) -> None:
        self.entry, self.name, self.last_error = entry, name, ""
        self.link = SampleLink(entry, entry.port, TYPES[entry.content], robot, bus)
        self._names, self._host = names, host
        self._stop, self._lock = threading.Event(), threading.Lock()
        self._open: set[IncomingConnection] = set()
        self._listener = socket.create_server((host, 0))
        self._port = int(self._listener.getsockname()[1])
        self.threads = [
            threading.Thread(target=work, name=f"{title} {entry.port}", daemon=True)
            for work, title in ((self._accept, "from"), (self._stay_connected, "connects"))
        ]

    @property
    def is_connected(self) -> bool:
        """True if a port of the robot is connected."""
        with self._lock:
            return bool(self._open)

    def start(self) -> None:
        """Start to listen, and ask the port of the robot to connect."""
        for thread in self.threads:
            thread.start()

    def close(self) -> None:
        """End the connections, and withdraw the registration of the port."""
        self._stop.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            connections = list(self._open)
        for connection in connections:
            connection.close()
        with suppress(UnavailableError):
            self._names.unregister(self.name)
        self.link.close()

    def on_message(self, received: Received) -> None:
        """Convert a message and send it as a sample; one with a fault is counted and dropped."""
        start_s = monotonic_s()
        if not self.link.admits(len(received.data), start_s):
            return
        stamp_ns = received.stamp_ns
        if not stamp_ns and self.entry.without_stamp == "arrival":
            stamp_ns = wall_ns() // 1000 * 1000
        try:
            if not stamp_ns:
                raise InputError("no time in the envelope: expected one; see without_stamp in the settings")
            value = to_cdff(received, self.entry, stamp_ns)
            self.link.send(value, (self.entry.frame, self.entry.child), stamp_ns, start_s)
        except CodecError as error:
            self.link.drop("decoding", str(error))
        except (CdffError, *CONVERSION_ERRORS) as error:
            self.link.drop("content", f"{type(error).__name__}: {error}")

    def _accept(self) -> None:
        while not self._stop.is_set():
            try:
                sock, _ = self._listener.accept()
            except OSError:
                self._stop.wait(0.1)  # closed, or out of file descriptors
                continue
            threading.Thread(target=self._receive, args=(sock,), daemon=True).start()

    def _receive(self, sock: socket.socket) -> None:
        """Receive the messages of one connection until it ends."""
        try:
            connection = IncomingConnection(sock, self._port)
        except (OSError, EOFError, InputError) as error:
            sock.close()
            self.link.drop("handshake", f"{type(error).__name__}: {error}")
            return
        with self._lock:
            is_admitted = len(self._open) < _MAX_CONNECTIONS and not self._stop.is_set()
            if is_admitted:
                self._open.add(connection)
        if not is_admitted and not self._stop.is_set():
            self.link.drop("connections", f"more than {_MAX_CONNECTIONS} connections")
        try:
            while is_admitted:
                received = connection.receive(self.entry.max_bytes)
                if received is not None:
                    self.on_message(received)
        except CodecError as error:
            self.link.drop("decoding", str(error))
        except InputError as error:
            self.link.drop("size", str(error))
        except (OSError, EOFError) as error:
            logger.debug("%s: %s", self.entry.port, error)
        finally:
            connection.close()
            with self._lock:
                self._open.discard(connection)

    def _stay_connected(self) -> None:
        """Register the port, and ask the port of the robot to connect to it whenever it is not connected."""
        while not self._stop.is_set():
            if not self.is_connected:
                try:
                    self._names.register(self.name, self._host, self._port)
                    address = self._names.query(self.entry.port)
                    with TextConnection(*address, self.name) as connection:
                        connection.command(self.name)
                    self.last_error = ""
                except (CdffError, OSError, EOFError) as error:
                    if str(error) != self.last_error and not self._stop.is_set():
                        logger.warning("%s: %s", self.entry.port, error)
                    self.last_error = str(error)[:300]
            self._stop.wait(_RETRY_S)


class YarpOutput(ProductLink):
    """A product and the port of the robot that receives it.

    Parameters
    ----------
    entry : OutputPort
    name : str
        Name of the port of the gateway.
    names : NameServer
    """

    def __init__(self, entry: OutputPort, name: str, names: NameServer) -> None:
        super().__init__(entry)
        self.entry, self.name, self._names = entry, name, names
        self.is_connected, self.last_error = False, ""
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._changed = threading.Condition()
        self._is_closed = False
        self.threads = [threading.Thread(target=self._run, name=f"to {entry.port}", daemon=True)]

    def start(self) -> None:
        """Start to send."""
        self.threads[0].start()

    def close(self) -> None:
        """End the thread, and the connection."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def send(self, value: Any, header: Header) -> None:
        """Add a value to those that wait for the port; of too many the oldest is dropped."""
        data = to_yarp(value, self.entry.content)
        with self._changed:
            if len(self._waiting) >= _MAX_WAITING:
                self._waiting.popleft()
                self.drop("queue", f"{_MAX_WAITING} products wait for {self.entry.port}")
            self._waiting.append((data, header.t1_ns))
            self._changed.notify()

    def _run(self) -> None:
        while not self._is_closed:
            try:
                connection = OutgoingConnection(*self._names.query(self.entry.port), self.name)
                self.is_connected, self.last_error = True, ""
                try:
                    self._send_all(connection)
                finally:
                    connection.close()
            except (CdffError, OSError, EOFError) as error:
                if self.is_connected or str(error) != self.last_error:
                    logger.warning("%s: %s", self.entry.port, error)
                self.last_error = str(error)[:300]
            self.is_connected = False
            with self._changed:
                self._changed.wait_for(lambda: self._is_closed, _RETRY_S)

    def _send_all(self, connection: OutgoingConnection) -> None:
        number = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_closed or bool(self._waiting))
                if self._is_closed:
                    return
                data, stamp_ns = self._waiting.popleft()
            try:
                connection.send(data, stamp_ns, number)
            except (CdffError, OSError, EOFError) as error:
                self.drop("connection", f"{type(error).__name__}: {error}")
                raise
            number += 1
