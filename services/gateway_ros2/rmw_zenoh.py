# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keys, liveliness tokens and attachments of ``rmw_zenoh``.

As published in https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal

import xxhash

from cdff_common.errors import CodecError

#: Encoding of the payloads: CDR with the four bytes of its encapsulation.
ENCODING = "application/cdr"
#: Type hash of ROS 2 Humble, which has none.
NO_HASH = "TypeHashNotSupported"

_ATTACHMENT = struct.Struct("<qqB16s")
#: Bytes of the id of a publisher, the last of an attachment.
GID_BYTES = 16
_NONE = "%"
#: Depth that tokens do not state.
_DEFAULT_DEPTH = 42
_NS_PER_S = 1_000_000_000

Kind = Literal["MP", "MS", "SS", "SC"]


@dataclass(frozen=True, slots=True)
class Quality:
    """Quality of service in tokens.

    Attributes
    ----------
    reliable : bool
    latched : bool
        Transient local: late subscribers receive the last messages.
    keep_all : bool
    depth : int
        Messages that are kept, unless all are.
    deadline_ns : int or None
    """

    reliable: bool = True
    latched: bool = False
    keep_all: bool = False
    depth: int = 10
    deadline_ns: int | None = None

    def __str__(self) -> str:
        """Return the text in a token, in which defaults are empty."""
        depth = "" if self.keep_all or self.depth == _DEFAULT_DEPTH else str(self.depth)
        deadline = (
            "," if self.deadline_ns is None else ",".join(map(str, divmod(self.deadline_ns, _NS_PER_S)))
        )
        first = (
            f"{'' if self.reliable else 2}:{1 if self.latched else ''}:{2 if self.keep_all else ''},{depth}"
        )
        return f"{first}:{deadline}:,:,,"


QOS_DEFAULT, QOS_SENSOR_DATA = Quality(), Quality(reliable=False, depth=5)
QOS_LATCHED = Quality(latched=True, depth=1)


def dds_type(type_name: str) -> str:
    """Return the name of a type in keys: ``std_msgs/msg/String`` is ``std_msgs::msg::dds_::String_``."""
    package, group, name = type_name.split("/")
    return f"{package}::{group}::dds_::{name}_"


def data_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Return the key of a topic or a service; with the hash ``*`` that of any version of its type."""
    return f"{domain}/{topic.strip('/')}/{dds_type(type_name)}/{type_hash}"


@dataclass(frozen=True, slots=True)
class Node:
    """A node of ROS 2 in its liveliness tokens.

    Attributes
    ----------
    domain : int
        ``ROS_DOMAIN_ID``.
    zid : str
        Id of the Zenoh session.
    name : str
    """

    domain: int
    zid: str
    name: str

    @property
    def token(self) -> str:
        """Token of the node."""
        return f"@ros2_lv/{self.domain}/{self.zid}/0/0/NN/{_NONE}/{_NONE}/{self.name}"

    def entity_token(
        self, number: int, kind: Kind, topic: str, type_name: str, type_hash: str, quality: Quality
    ) -> str:
        """Return the token of a publisher (MP), subscriber (MS), service (SS) or client (SC) of the node."""
        start = f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/{kind}/{_NONE}/{_NONE}/{self.name}"
        name = f"/{topic.strip('/')}".replace("/", _NONE)
        return f"{start}/{name}/{dds_type(type_name)}/{type_hash}/{quality}"


def gid_of(token: str) -> bytes:
    """Return the id of a publisher, service or client: XXH3 of its token, its low 64 bits first."""
    value = xxhash.xxh3_128_intdigest(token.encode())
    return value.to_bytes(GID_BYTES, "little")


@dataclass(frozen=True, slots=True)
class Attachment:
    """Attachment of a message: number, time of sending in ns and id of the publisher."""

    seq: int
    stamp_ns: int
    gid: bytes

    def to_bytes(self) -> bytes:
        """Return the 33 bytes of the attachment."""
        return _ATTACHMENT.pack(self.seq, self.stamp_ns, GID_BYTES, self.gid)

    @classmethod
    def from_bytes(cls, data: bytes) -> Attachment:
        """Return the attachment in bytes; raises CodecError on anything else."""
        if len(data) != _ATTACHMENT.size or data[16] != GID_BYTES:
            raise CodecError(
                f"attachment of {len(data)} bytes: expected the {_ATTACHMENT.size} bytes of rmw_zenoh, "
                "as it has them since 2025"
            )
        seq, stamp_ns, _, gid = _ATTACHMENT.unpack(data)
        return cls(seq, stamp_ns, gid)
