# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UDP sockets of the gateway, which accept datagrams of the ground segment only."""

from __future__ import annotations

import socket
import threading
from collections import Counter
from collections.abc import Callable

from cdff_common.errors import ConfigurationError, UnavailableError

_MAX_BYTES = 65535
_RECEIVE_BUFFER_BYTES = 4 << 20
#: Interval at which a receiver checks whether it is stopped, seconds.
_POLL_S = 0.2

Address = tuple[str, int]


def parse_address(text: str) -> Address:
    """Return host and port of ``HOST:PORT``; raises ConfigurationError."""
    host, _, port = text.rpartition(":")
    if not host or not 0 < int(port) < 1 << 16:
        raise ConfigurationError(f"{text!r}: expected HOST:PORT, with a port of 1 to 65535")
    return host, int(port)


class DatagramPort:
    """A UDP socket with a thread that receives.

    Datagrams of hosts other than the peer are counted (``foreign``) and dropped.

    Parameters
    ----------
    listen, peer : tuple of str and int

    Raises
    ------
    ConfigurationError
        If the name of the peer cannot be resolved.
    UnavailableError
        If the address ``listen`` cannot be used.
    """

    def __init__(self, listen: Address, peer: Address) -> None:
        self.counters: Counter[str] = Counter()
        try:
            self._peer = (socket.gethostbyname(peer[0]), peer[1])
        except OSError as error:
            raise ConfigurationError(f"{peer[0]}: {error}; expected a host that can be resolved") from error
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        self._socket.settimeout(_POLL_S)
        try:
            self._socket.bind(listen)
        except OSError as error:
            self._socket.close()
            raise UnavailableError(f"UDP {listen[0]}:{listen[1]}: {error}; choose another address") from error
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def send(self, data: bytes) -> None:
        """Send a datagram to the peer; a failure is counted (``failed``)."""
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            self.counters["failed"] += 1
            return
        self.counters["sent"] += 1
        self.counters["sent_bytes"] += len(data)

    def start(self, on_receive: Callable[[bytes], object]) -> None:
        """Start the receiving thread; it calls ``on_receive`` with each datagram of the peer."""
        self._thread = threading.Thread(target=self._run, args=(on_receive,), name="datagrams", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and close the socket."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5 * _POLL_S)
        self._socket.close()

    @property
    def is_healthy(self) -> bool:
        """False if the thread has ended although it was not stopped."""
        return self._thread is None or self._thread.is_alive() or self._stop.is_set()

    def _run(self, on_receive: Callable[[bytes], object]) -> None:
        while not self._stop.is_set():
            try:
                data, (host, _) = self._socket.recvfrom(_MAX_BYTES)
            except TimeoutError:
                continue
            except OSError:  # an ICMP error of an earlier datagram
                self.counters["failed"] += 1
                continue
            if host != self._peer[0]:
                self.counters["foreign"] += 1
                continue
            self.counters["received"] += 1
            on_receive(data)
