# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls to the master of ROS 1 and to other nodes by XML-RPC (http://wiki.ros.org/ROS/Master_API)."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from cdff_common.errors import ConfigurationError, UnavailableError

_TIMEOUT_S = 5.0
#: Failures of a call: no connection, an answer that is not XML-RPC, or values that XML-RPC cannot express.
_ERRORS = (
    ArithmeticError,
    AttributeError,
    ExpatError,
    LookupError,
    OSError,
    TypeError,
    ValueError,
    http.client.HTTPException,
    xmlrpc.client.Error,
)


class _Transport(xmlrpc.client.Transport):
    """Transport with a timeout, as the default has none."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = _TIMEOUT_S
        return connection


class RemoteApi:
    """XML-RPC interface of the master or of a node.

    Parameters
    ----------
    uri : str
        Such as ``http://127.0.0.1:11311``.
    caller : str
        Name of this node.
    """

    def __init__(self, uri: str, caller: str) -> None:
        self.uri, self._caller = uri, caller
        try:
            is_valid = urlsplit(uri).scheme == "http"
        except ValueError:
            is_valid = False
        if not is_valid:
            raise ConfigurationError(f"{uri}: expected http://HOST:PORT")

    def call(self, method: str, *arguments: Any) -> Any:
        """Return the value of a call; raises UnavailableError with the reason if it fails."""
        try:
            # A proxy is not safe for several threads.
            proxy = xmlrpc.client.ServerProxy(self.uri, transport=_Transport(), allow_none=True)
            code, message, value = getattr(proxy, method)(self._caller, *arguments)
        except _ERRORS as error:
            raise UnavailableError(f"{self.uri}: {method}: {error}") from error
        if code != 1:
            raise UnavailableError(f"{self.uri}: {method}: {message}")
        return value
