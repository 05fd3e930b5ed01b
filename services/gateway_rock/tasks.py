# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tasks of ROCK and their ports by the interfaces of Orocos RTT 2.9: ``CTaskContext``, ``CDataFlowInterface``
and ``CChannelElement`` (https://docs.orocos.org).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.errors import InputError, UnavailableError
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.giop import RemoteObject
from services.corba.naming import NameService
from services.corba.typecodes import AnyReader, TypeCode, write_any

#: Context of the name service in which tasks register.
_CONTEXT = "TaskContexts"
_INPUT, _OUTPUT = 0, 1
#: ``CFlowStatus``: no sample, the last one again, a new one.
_NO_DATA, _OLD_DATA, NEW_DATA = 0, 1, 2
_WRITTEN, _FAILED, _NOT_CONNECTED = 0, 1, 2
#: ``CConnectionModel``: the last sample, or a buffer that drops the oldest.
_LAST, _CIRCULAR = 0, 2
_LOCK_FREE, _PER_CONNECTION = 2, 1


@dataclass(frozen=True, slots=True)
class Port:
    """A port of a task.

    Attributes
    ----------
    name : str
    type_name : str
        Name in ROCK, such as ``/base/samples/RigidBodyState``.
    is_output : bool
        Whether the task writes it.
    """

    name: str
    type_name: str
    is_output: bool


class Task:
    """A running task.

    Parameters
    ----------
    names : NameService
    name : str

    Raises
    ------
    UnavailableError
        If there is no task of this name, or it does not answer.
    """

    def __init__(self, names: NameService, name: str) -> None:
        self.name = name
        task = names.resolve(_CONTEXT, name)
        self._ports = task.object_of(task.call("ports"))

    def ports(self) -> dict[str, Port]:
        """Return the ports by name."""
        reader = self._ports.call("getPortDescriptions")
        ports = {}
        for _ in range(reader.count(16)):
            is_output = reader.number("ulong") == _OUTPUT
            name, _, type_name = reader.text(), reader.text(), reader.text()
            ports[name] = Port(name, type_name, is_output)
        return ports

    def port(self, name: str, *, is_output: bool) -> Port:
        """Return a port; raises InputError if it does not exist or has the other direction."""
        ports = self.ports()
        found = ports.get(name)
        if found is None:
            raise InputError(f"{self.name}: no port {name!r}; expected one of {', '.join(ports)}")
        if found.is_output != is_output:
            directions = "an output", "an input"
            raise InputError(
                f"{self.name}.{name}: {directions[is_output]} port, expected {directions[not is_output]}"
            )
        return found

    def reader(self, port: str, size: int) -> PortReader:
        """Return a connection from an output port, with a buffer of a number of samples."""
        return PortReader(self._channel("buildChannelInput", port, size))

    def writer(self, port: str) -> PortWriter:
        """Return a connection to an input port, which keeps the last sample."""
        channel = self._channel("buildChannelOutput", port, 0)
        channel.call("channelReady", lambda writer: _write_policy(writer, 0))
        return PortWriter(channel)

    def _channel(self, operation: str, port: str, size: int) -> RemoteObject:
        def marshal(writer: CdrWriter) -> None:
            writer.text(port)
            _write_policy(writer, size)

        return self._ports.object_of(self._ports.call(operation, marshal))


def _write_policy(writer: CdrWriter, size: int) -> None:
    """Add a ``CConnPolicy``: a circular buffer of ``size``, or the last sample for 0, which is pulled."""
    writer.number("ulong", _CIRCULAR if size else _LAST)
    writer.number("long", size)
    writer.number("ulong", _LOCK_FREE)
    writer.number("boolean", 0)  # without the sample from before the connection
    writer.number("boolean", 1)  # samples wait at the task
    writer.number("ulong", _PER_CONNECTION)
    writer.number("long", 0)  # default number of threads
    writer.number("boolean", 0)  # the task may write without us
    writer.number("long", 0)  # transport: that of this interface
    writer.number("long", 0)
    writer.text("")


class PortReader:
    """Connection from an output port of a task."""

    def __init__(self, channel: RemoteObject) -> None:
        self._channel, self._values = channel, AnyReader()

    def read(self) -> tuple[TypeCode, Any, int] | None:
        """Return type, value and bytes of the next sample; None without a new one.

        Raises
        ------
        UnavailableError
            If the task has ended.
        CodecError
            If the sample is malformed.
        """
        reader: CdrReader = self._channel.call("read", lambda writer: writer.number("boolean", 0))
        size = reader.remaining
        if reader.number("ulong") != NEW_DATA:
            return None
        return *self._values.read(reader), size

    def close(self) -> None:
        """End the connection at the task; raises UnavailableError if the task does not answer."""
        self._channel.call("disconnect")


class PortWriter:
    """Connection to an input port of a task."""

    def __init__(self, channel: RemoteObject) -> None:
        self._channel = channel

    def write(self, kind: TypeCode, value: Any) -> None:
        """Write a sample.

        Raises
        ------
        UnavailableError
            If the task has ended, or has cut the connection.
        InputError
            If the task refuses the sample.
        """
        reader = self._channel.call("write", lambda writer: write_any(writer, kind, value))
        status = reader.number("ulong")
        if status == _NOT_CONNECTED:
            raise UnavailableError("the task has cut the connection")
        if status != _WRITTEN:
            raise InputError("the task refuses the sample; expected a sample of the type of its port")

    def close(self) -> None:
        """End the connection at the task; raises UnavailableError if the task does not answer."""
        self._channel.call("disconnect")
