# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The table of messages of ROS and types of CDFF (``mapping.yaml``), which all converters use."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.yaml_file import read_mapping

#: File of the table.
TABLE = Path(__file__).with_name("mapping.yaml")
FunctionName = Annotated[str, Field(pattern=r"^[a-z_]+\.[a-z_]+$")]


class FieldMapping(StrictModel):
    """Fields of a message and of a type that correspond to each other.

    Attributes
    ----------
    message, type : str
        Names, or several names.
    unit : str
        Unit of both, or that of the message, a semicolon, and that of the type.
    frame : str
        Frame in which the values are stated.
    note : str
        Convention, such as an order or a value that means unknown.
    """

    message: str
    type: str
    unit: str = ""
    frame: str = ""
    note: str = ""


class MessageMapping(StrictModel):
    """A message of ROS and a type of CDFF.

    Attributes
    ----------
    message : str
        Such as ``sensor_msgs/msg/Imu``.
    type : str
        Name of the ASN.1 type.
    port : str
        Last part of the names of its streams in logs.
    read, write : str or None
        Functions ``MODULE.NAME`` of this package; None if this direction does not exist.
    split : str or None
        Function that returns the messages with a header of which a message is made.
    has_header : bool
        Whether the message begins with ``std_msgs/Header``.
    is_default : bool
        Whether the type becomes this message if no message is stated, instead of a bitstream.
    gateways : bool
        Whether topics of gateways may have it.
    logs : str
        Why log readers leave the message out; empty if they read it.
    versions : tuple of int
        Versions of ROS that have the message.
    fields : tuple of FieldMapping
    not_read, not_written : tuple of str
        Fields of the message that the type lacks, and the reverse.
    notes : tuple of str
    """

    message: Annotated[str, Field(pattern=r"^[a-z0-9_]+/msg/[A-Za-z0-9]+$")]
    type: str
    port: str = ""
    read: FunctionName | None = None
    write: FunctionName | None = None
    split: FunctionName | None = None
    has_header: bool = True
    is_default: bool = True
    gateways: bool = True
    logs: str = ""
    versions: tuple[int, ...] = (1, 2)
    fields: tuple[FieldMapping, ...]
    not_read: tuple[str, ...] = ()
    not_written: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class MappingTable(StrictModel):
    """The whole table.

    Attributes
    ----------
    conventions : mapping of subject to text
        Conventions of all messages.
    messages : tuple of MessageMapping
    """

    conventions: dict[str, str]
    messages: tuple[MessageMapping, ...]

    def readers(self) -> dict[str, MessageMapping]:
        """Return the default entry for reading each message."""
        found: dict[str, MessageMapping] = {}
        for entry in self.messages:
            if entry.read is not None:
                found.setdefault(entry.message, entry)
        return found

    def writers(self) -> dict[str, list[MessageMapping]]:
        """Return the entries for writing each type."""
        found: dict[str, list[MessageMapping]] = {}
        for entry in self.messages:
            if entry.write is not None:
                found.setdefault(entry.type, []).append(entry)
        return found

    def only_in(self, version: int) -> set[str]:
        """Return the messages that a version of ROS has and another has not."""
        return {
            entry.message for entry in self.messages if version in entry.versions and len(entry.versions) == 1
        }


@cache
def mapping_table() -> MappingTable:
    """Return the table; raises ConfigurationError or ValidationError if it is invalid."""
    return MappingTable.model_validate(read_mapping(TABLE))


def function(name: str) -> Any:
    """Return a function ``MODULE.NAME`` of this package."""
    module, _, attribute = name.partition(".")
    return resolve_name(f"{__package__}.{module}:{attribute}")
