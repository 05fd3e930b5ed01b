# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Client of the name service of CORBA (CosNaming, OMG formal/2004-10-03)."""

from __future__ import annotations

from services.corba.cdr import CdrWriter
from services.corba.giop import Connections, Reference, RemoteObject

#: Key of the root context, and default port (§2.4.1 of the specification).
_KEY, DEFAULT_PORT = b"NameService", 2809


class NameService:
    """Root context of the name service of a host.

    Parameters
    ----------
    host : str
    port : int
    connections : Connections
    """

    def __init__(self, host: str, port: int, connections: Connections) -> None:
        reference = Reference("IDL:omg.org/CosNaming/NamingContext:1.0", host, port, _KEY)
        self._root = RemoteObject(reference, connections)

    def resolve(self, *path: str) -> RemoteObject:
        """Return an object by the names of its contexts and its own; raises as ``GiopConnection.call``."""

        def marshal(writer: CdrWriter) -> None:
            writer.number("ulong", len(path))
            for name in path:
                writer.text(name)
                writer.text("")

        return self._root.object_of(self._root.call("resolve", marshal))
