# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A service of a node of ROS 1."""

from __future__ import annotations

import logging
from collections.abc import Callable

from cdff_common.errors import CdffError, CodecError
from services.gateway_ros1.tcpros import HANDSHAKE_S, SEND_S, Connection

logger = logging.getLogger(__name__)

#: Largest request, bytes, and time between the requests of a persistent connection, seconds.
_MAX_REQUEST, _IDLE_S = 1 << 20, 600.0


class Ros1Service:
    """Answers of a service, in the threads of the connections of its clients.

    Parameters
    ----------
    name, type_name, md5 : str
    handle : callable
        From the bytes of a request to those of the response; its errors are answered as failures.
    """

    def __init__(self, name: str, type_name: str, md5: str, handle: Callable[[bytes], bytes]) -> None:
        self.name, self.type_name, self.md5, self._handle = name, type_name, md5, handle

    def header(self) -> dict[str, str]:
        """Return the fields of the answer to a client."""
        return {
            "type": self.type_name,
            "md5sum": self.md5,
            "request_type": f"{self.type_name}Request",
            "response_type": f"{self.type_name}Response",
        }

    def serve(self, connection: Connection, asked: dict[str, str]) -> None:
        """Answer one request, or of a persistent connection all until it is idle for 10 min."""
        if asked.get("probe") == "1":
            return
        is_persistent = asked.get("persistent") == "1"
        while True:
            connection.wait(_IDLE_S if is_persistent else HANDSHAKE_S)
            try:
                data = connection.receive(_MAX_REQUEST)
            except CodecError as error:
                connection.send(str(error).encode(), prefix=b"\0")
                return
            try:
                answer, prefix = self._handle(data), b"\1"
            except CdffError as error:
                logger.warning("%s: refused: %s", self.name, error)
                answer, prefix = str(error).encode(), b"\0"
            except Exception as error:  # the client receives a failure rather than no answer
                logger.exception("%s failed", self.name)
                answer, prefix = f"{type(error).__name__}: {error}".encode(), b"\0"
            connection.wait(SEND_S)
            connection.send(answer, prefix=prefix)
            if not is_persistent:
                return
