# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Client of the name server of YARP (https://yarp.it/latest/name_server.html)."""

from __future__ import annotations

import re

from cdff_common.errors import UnavailableError
from services.yarp.carriers import TextConnection

#: Default port of the name server.
DEFAULT_PORT = 10000
_END = "*** end of message"
_REGISTRATION = re.compile(r"registration name (\S+) ip (\S+) port (\d+) type (\S+)")
_MAX_LINES = 1000


class NameServer:
    """Client of the name server of a YARP network.

    Parameters
    ----------
    host : str
    port : int
    caller : str
        Name that this process states when it connects to the name server.
    """

    def __init__(self, host: str, port: int, caller: str) -> None:
        self.host, self.port, self._caller = host, port, caller

    def query(self, name: str) -> tuple[str, int]:
        """Return the host and the TCP port number of a registered YARP port.

        Raises
        ------
        UnavailableError
            If the name server does not answer, or no port with this name is registered.
        """
        for line in self._ask("query", name):
            match = _REGISTRATION.search(line)
            if match is not None and match[1] == name:
                return match[2], int(match[3])
        raise UnavailableError(f"{name}: not registered at the name server {self.host}:{self.port}")

    def register(self, name: str, host: str, port: int) -> None:
        """Register a port of this process with its host and TCP port number.

        Raises
        ------
        UnavailableError
            If the name server does not answer, or refuses the registration.
        """
        if not any(_REGISTRATION.search(line) for line in self._ask("register", name, "tcp", host, port)):
            raise UnavailableError(f"{name}: the name server {self.host}:{self.port} does not register it")

    def unregister(self, name: str) -> None:
        """Remove the registration of a port; raises UnavailableError if the server does not answer."""
        self._ask("unregister", name)

    def _ask(self, *words: object) -> list[str]:
        lines: list[str] = []
        try:
            with TextConnection(self.host, self.port, self._caller) as connection:
                connection.data_line(" ".join(map(str, words)))
                while len(lines) < _MAX_LINES:
                    line = connection.line()
                    if line.strip() == _END:
                        return lines
                    lines.append(line)
        except (OSError, EOFError) as error:
            raise UnavailableError(f"name server {self.host}:{self.port}: {error}") from error
        raise UnavailableError(f"name server {self.host}:{self.port}: more than {_MAX_LINES} lines")
