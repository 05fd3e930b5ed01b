# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A small master of ROS 1 with a parameter server, whose answers a test can replace by faulty ones."""

from __future__ import annotations

import threading
import xmlrpc.client
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any


class Master:
    """XML-RPC server with the calls of http://wiki.ros.org/ROS/Master_API that a node uses.

    Attributes
    ----------
    uri : str
    raw : dict of str to bytes
        Bodies that are sent in place of the answer of a method.
    values : dict of str to Any
        Values that are sent in place of that of a method.
    parameters : dict of str to Any
    calls : list of (str, tuple)
        Methods and arguments of all calls.
    """

    def __init__(self) -> None:
        self.raw: dict[str, bytes] = {}
        self.values: dict[str, Any] = {}
        self.parameters: dict[str, Any] = {}
        self.calls: list[tuple[str, tuple[Any, ...]]] = []
        self._parameter_nodes: dict[str, str] = {}
        master = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                data = self.rfile.read(int(self.headers["content-length"]))
                body = master._answer(data)
                self.send_response(200)
                self.send_header("content-length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *arguments: Any) -> None:
                """Write nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.uri = f"http://127.0.0.1:{self._server.server_address[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    def __enter__(self) -> Master:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()

    def called(self, method: str) -> list[tuple[Any, ...]]:
        """Return the arguments of the calls of a method."""
        return [arguments for name, arguments in self.calls if name == method]

    def set_parameter(self, key: str, value: Any) -> None:
        """Set a parameter, and state it to the node that has subscribed to it."""
        self.parameters[key] = value
        if key in self._parameter_nodes:
            proxy = xmlrpc.client.ServerProxy(self._parameter_nodes[key])
            proxy.paramUpdate("/master", f"{key}/", value)

    def _answer(self, data: bytes) -> bytes:
        arguments, method = xmlrpc.client.loads(data)
        assert method is not None
        self.calls.append((method, arguments))
        if method in self.raw:
            return self.raw[method]
        value = self.values.get(method, self._value(method, arguments))
        return xmlrpc.client.dumps(([1, "", value],), methodresponse=True, allow_none=True).encode()

    def _value(self, method: str, arguments: tuple[Any, ...]) -> Any:
        if method == "registerSubscriber":
            return []
        if method == "setParam":
            self.parameters[str(arguments[1])] = arguments[2]
        if method == "subscribeParam":
            self._parameter_nodes[str(arguments[2])] = str(arguments[1])
            return self.parameters.get(str(arguments[2]), {})
        return 1
