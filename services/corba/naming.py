# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Client of the name service of CORBA (CosNaming, OMG formal/2004-10-03)."""

from __future__ import annotations

from functools import partial

from services.corba.cdr import CdrWriter
from services.corba.giop import Connections, Reference, RemoteError, RemoteObject, write_reference

#: Key of the root context, and default port (§2.4.1 of the specification).
_KEY, DEFAULT_PORT = b"NameService", 2809
_ALREADY_BOUND = "IDL:omg.org/CosNaming/NamingContext/AlreadyBound:1.0"


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
        return self._root.object_of(self._root.call("resolve", lambda writer: _write_name(writer, path)))

    def rebind(self, reference: Reference, *path: str) -> None:
        """Register an object under the names of its contexts, which are made, and its own.

        Raises
        ------
        UnavailableError, CodecError
            As ``GiopConnection.call``.
        """

        def marshal(writer: CdrWriter) -> None:
            _write_name(writer, path)
            write_reference(writer, reference)

        for i in range(1, len(path)):
            try:
                self._root.call("bind_new_context", partial(_write_name, path=path[:i]))
            except RemoteError as error:
                if error.exception != _ALREADY_BOUND:
                    raise
        self._root.call("rebind", marshal)

    def unbind(self, *path: str) -> None:
        """Remove a name; raises as ``GiopConnection.call``."""
        self._root.call("unbind", lambda writer: _write_name(writer, path))


def _write_name(writer: CdrWriter, path: tuple[str, ...]) -> None:
    writer.number("ulong", len(path))
    for name in path:
        writer.text(name)
        writer.text("")
