# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A topic to which a node of ROS 1 subscribes: a connection to each of its publishers."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from cdff_common.errors import CodecError, ConfigurationError, UnavailableError
from services.gateway_ros1.master import RemoteApi
from services.gateway_ros1.tcpros import Connection
from services.gateways.inputs import DECODER_ERRORS

logger = logging.getLogger(__name__)

#: Publishers of a topic to which a node connects; further ones are dropped.
_MAX_PUBLISHERS = 64
#: Time before another attempt to connect, doubled with each up to the second value, seconds.
_RETRY_S, _MAX_RETRY_S = 0.5, 10.0


class Ros1Subscription:
    """Connections to the publishers of a topic, each with a thread; made again while these are registered.

    Parameters
    ----------
    node, topic, type_name, md5 : str
    callback : callable
        Receives messages.
    on_fault : callable
        Receives reason and detail of a fault.
    max_bytes : int
        Largest message; one with more ends the connection, since its end is not known.
    """

    def __init__(
        self,
        node: str,
        topic: str,
        type_name: str,
        md5: str,
        callback: Callable[[bytes], None],
        on_fault: Callable[[str, str], None],
        *,
        max_bytes: int,
    ) -> None:
        self.topic, self.type_name = topic, type_name
        self._node, self._md5, self._max_bytes = node, md5, max_bytes
        self._callback, self._on_fault = callback, on_fault
        self._lock, self._callback_lock = threading.Lock(), threading.Lock()
        self._links: dict[str, _Link] = {}

    def peers(self) -> list[str]:
        """Return the addresses of the publishers."""
        with self._lock:
            return list(self._links)

    def threads(self) -> list[threading.Thread]:
        """Return the threads of the connections."""
        with self._lock:
            return [link.thread for link in self._links.values() if not link.stopped.is_set()]

    def update(self, uris: list[str]) -> None:
        """Connect to the publishers of a list, and end the connections to others."""
        uris = list(dict.fromkeys(uris))
        if len(uris) > _MAX_PUBLISHERS:
            self._on_fault("publishers", f"{len(uris)} publishers: expected at most {_MAX_PUBLISHERS}")
            uris = uris[:_MAX_PUBLISHERS]
        with self._lock:
            ended = [self._links.pop(uri) for uri in set(self._links) - set(uris)]
            started = [uri for uri in uris if uri not in self._links]
            for uri in started:
                self._links[uri] = _Link(uri, self._run)
        for link in ended:
            link.close()

    def close(self) -> None:
        """End all connections."""
        self.update([])

    def _run(self, link: _Link) -> None:
        """Receive messages of a publisher until the link is closed."""
        retry_s = _RETRY_S
        while not link.stopped.is_set():
            try:
                connection = self._connect(link)
                retry_s = _RETRY_S
                while not link.stopped.is_set():
                    data = connection.receive(self._max_bytes)
                    with self._callback_lock:
                        self._callback(data)
            except (CodecError, ConfigurationError) as error:
                if not link.stopped.is_set():
                    self._on_fault(_reason(error), f"{link.uri}: {error}")
            except DECODER_ERRORS as error:
                self._on_fault("content", f"{link.uri}: {type(error).__name__}: {error}")
            except (OSError, EOFError, UnavailableError) as error:
                logger.debug("%s: %s: %s", self.topic, link.uri, error)
            finally:
                link.disconnect()
            link.stopped.wait(retry_s)
            retry_s = min(2.0 * retry_s, _MAX_RETRY_S)

    def _connect(self, link: _Link) -> Connection:
        """Return a connection; raises ConfigurationError if the publisher has another type."""
        try:
            publisher = RemoteApi(link.uri, self._node)
        except ConfigurationError as error:
            raise _AddressError(str(error)) from error
        protocol = publisher.call("requestTopic", self.topic, [["TCPROS"]])
        if not (isinstance(protocol, list) and len(protocol) == 3 and protocol[0] == "TCPROS"):
            raise ConfigurationError(f"{protocol!r}: expected TCPROS, host and port")
        connection = link.connected(_open(protocol[1], protocol[2]))
        connection.send_header(
            {
                "callerid": self._node,
                "topic": self.topic,
                "type": self.type_name,
                "md5sum": self._md5,
                "tcp_nodelay": "1",
            }
        )
        found = connection.receive_header()
        if "error" in found:
            raise ConfigurationError(f"the publisher refuses: {found['error'][:200]}")
        if found.get("md5sum") not in (self._md5, "*"):
            other = f"{found.get('type', '')[:80]} with md5sum {found.get('md5sum', '')[:40]}"
            raise ConfigurationError(f"{other}, expected {self.type_name} with {self._md5}")
        connection.wait(None)
        return connection


def _open(host: object, port: object) -> Connection:
    """Connect to the address that a publisher states; raises ConfigurationError if it is no address."""
    try:
        number = int(str(port))
        if not 0 < number < 1 << 16:
            raise ValueError(f"port {number}")
        return Connection.open(str(host), number)
    except ValueError as error:  # also of names that cannot be encoded
        raise _AddressError(
            f"{str(host)[:80]!r}, {str(port)[:80]!r}: {error}; expected a host and a port"
        ) from error


class _AddressError(ConfigurationError):
    """An address that is no host and port."""


def _reason(error: CodecError | ConfigurationError) -> str:
    """Return the reason that is counted for an error of a connection."""
    if isinstance(error, _AddressError):
        return "address"
    return "size" if "message of" in str(error) else "type"


class _Link:
    """A publisher, the thread of its messages, and its connection if there is one."""

    def __init__(self, uri: str, run: Callable[[_Link], None]) -> None:
        self.uri, self.stopped = uri, threading.Event()
        self._connection: Connection | None = None
        self.thread = threading.Thread(target=run, args=(self,), name=f"from {uri}", daemon=True)
        self.thread.start()

    def connected(self, connection: Connection) -> Connection:
        """Keep a connection, to close it from another thread."""
        self._connection = connection
        if self.stopped.is_set():
            connection.close()
        return connection

    def disconnect(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()

    def close(self) -> None:
        """End the thread."""
        self.stopped.set()
        self.disconnect()
