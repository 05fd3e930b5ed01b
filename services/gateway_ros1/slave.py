# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""XML-RPC interface of a node of ROS 1 (http://wiki.ros.org/ROS/Slave_API)."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable
from socketserver import ThreadingMixIn
from typing import Any, Protocol
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

logger = logging.getLogger(__name__)


#: Largest request in bytes, number of requests at once, and time for the parts of one, seconds.
_MAX_REQUEST, _MAX_THREADS, _TIMEOUT_S = 1 << 20, 32, 10.0
#: Digits of the largest stated length of a request.
_SIZE_DIGITS = len(str(_MAX_REQUEST))


class NodeState(Protocol):
    """State of a node that it reports to others."""

    master_uri: str

    def publications(self) -> list[list[str]]:
        """Return topics and types."""

    def subscriptions(self) -> list[list[str]]:
        """Return topics and types."""

    def connections(self) -> list[list[Any]]:
        """Return id, other node, direction, transport, topic and True of each connection."""

    def update_publishers(self, topic: str, uris: list[str]) -> None:
        """Take the publishers of a topic."""

    def update_parameter(self, key: str, value: Any) -> None:
        """Take the value of a parameter."""

    def has_topic(self, topic: str) -> bool:
        """Return True if the node publishes a topic."""

    def address(self) -> tuple[str, int]:
        """Return host and port of its TCPROS connections."""


class _Handler(SimpleXMLRPCRequestHandler):
    """Requests to any path, as clients of ROS use several; without log lines."""

    rpc_paths = ()
    timeout = _TIMEOUT_S

    def do_POST(self) -> None:
        """Answer a request, or refuse it by the length that it states."""
        size = self.headers.get("content-length", "")
        if not size.isdecimal() or len(size) > _SIZE_DIGITS or int(size) > _MAX_REQUEST:
            self.send_error(413 if size.isdecimal() else 411, f"expected at most {_MAX_REQUEST} bytes")
            return
        if self.headers.get("content-encoding", "identity").lower() != "identity":
            self.send_error(415, "expected a request that is not compressed")
            return
        super().do_POST()

    def log_message(self, format: str, *arguments: Any) -> None:
        """Write nothing."""


class _Server(ThreadingMixIn, SimpleXMLRPCServer):
    """Server with a limited number of threads; further connections are closed."""

    daemon_threads, request_queue_size = True, _MAX_THREADS
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__(address, _Handler, logRequests=False, allow_none=True)
        self._slots = threading.BoundedSemaphore(_MAX_THREADS)
        self._has_reported = False

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread, if one is free."""
        if self._slots.acquire(blocking=False):
            try:
                super().process_request(request, client_address)
            except RuntimeError:  # the process has too many threads
                self._slots.release()
                raise
            return
        if not self._has_reported:
            logger.warning("a call of %s is refused: %d are open", client_address, _MAX_THREADS)
            self._has_reported = True
        self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer a connection, and free its slot."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._slots.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log the error of a connection, such as a timeout, in one line."""
        logger.debug("a call of %s failed: %r", client_address, sys.exception())


class SlaveApi:
    """XML-RPC server of a node.

    Parameters
    ----------
    state : NodeState
    host : str
        Address on which it listens, and by which others reach it.

    Attributes
    ----------
    uri : str
    thread : threading.Thread
        Thread that accepts the calls.
    """

    def __init__(self, state: NodeState, host: str) -> None:
        self._state = state
        self._server = _Server((host, 0))
        self.uri = f"http://{host}:{self._server.server_address[1]}/"
        answers: dict[str, Callable[..., Any]] = {
            "getBusStats": lambda *_: [[], [], []],
            "getBusInfo": lambda *_: state.connections(),
            "getMasterUri": lambda *_: state.master_uri,
            "getPid": lambda *_: os.getpid(),
            "getSubscriptions": lambda *_: state.subscriptions(),
            "getPublications": lambda *_: state.publications(),
        }
        for name, answer in answers.items():
            self._server.register_function(_answering(answer), name)
        self._server.register_function(_answering(self._publisher_update), "publisherUpdate")
        self._server.register_function(_answering(self._parameter_update), "paramUpdate")
        self._server.register_function(self._request_topic, "requestTopic")
        self._server.register_function(lambda *_: [0, "the supervisor stops the gateway", 0], "shutdown")
        self.thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.2}, name="slave api", daemon=True
        )
        self.thread.start()

    def close(self) -> None:
        """Stop answering."""
        self._server.shutdown()
        self._server.server_close()

    def _publisher_update(self, _: str, topic: str, uris: list[str]) -> int:
        if not isinstance(uris, list):
            raise TypeError(f"publishers of {topic}: expected a list")
        self._state.update_publishers(topic, [str(uri) for uri in uris])
        return 0

    def _parameter_update(self, _: str, key: str, value: Any) -> int:
        self._state.update_parameter(key, value)
        return 0

    def _request_topic(self, *arguments: Any) -> list[Any]:
        _, topic, protocols = arguments
        if not self._state.has_topic(topic):
            return [0, f"{topic} is not published by this node", 0]
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return [0, "expected the protocol TCPROS", 0]
        return [1, "ready", ["TCPROS", *self._state.address()]]


def _answering(answer: Callable[..., Any]) -> Callable[..., list[Any]]:
    def respond(*arguments: Any) -> list[Any]:
        try:
            return [1, "", answer(*arguments)]
        except (TypeError, ValueError) as error:
            return [-1, str(error), 0]

    return respond
