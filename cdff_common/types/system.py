# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/system.asn by cdff generate; do not edit.

"""Types of ``asn1/system.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.time import Time


class IcuStateT(IntEnum):
    """``ICU-state-t``."""

    ICU_STEADY = 0
    ICU_SWITCHING = 1


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class IcuMode(Message):
    """Mode of one sensor of an Instrument Control Unit.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    robot : str, at most 256 octets
    sensor : str, at most 256 octets
    mode : str, at most 256 octets
        confirmed.
    target : str, at most 256 octets
        demanded; equal to mode where steady.
    state : IcuStateT
    is_on : bool
    rate : float
        Hz.
    holder : str, at most 256 octets
        who demanded it.
    """

    ASN1_NAME: ClassVar[str] = "ICU-Mode"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    robot: str = ""
    sensor: str = ""
    mode: str = ""
    target: str = ""
    state: IcuStateT = IcuStateT.ICU_STEADY
    is_on: bool = False
    rate: float = 0.0
    holder: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "IcuMode.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "IcuMode.time_stamp", Time))
        put(self, "robot", check.text(self.robot, "IcuMode.robot", 256))
        put(self, "sensor", check.text(self.sensor, "IcuMode.sensor", 256))
        put(self, "mode", check.text(self.mode, "IcuMode.mode", 256))
        put(self, "target", check.text(self.target, "IcuMode.target", 256))
        put(self, "state", check.enumeration(self.state, "IcuMode.state", IcuStateT))
        put(self, "is_on", check.boolean(self.is_on, "IcuMode.is_on"))
        put(self, "rate", check.real(self.rate, "IcuMode.rate"))
        put(self, "holder", check.text(self.holder, "IcuMode.holder", 256))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


class DfpcStateT(IntEnum):
    """``DFPC-state-t``."""

    DFPC_UNCONFIGURED = 0
    DFPC_INACTIVE = 1
    DFPC_ACTIVE = 2
    DFPC_ERROR = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DfpcStatus(Message):
    """What a DFPC says of itself.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    robot : str, at most 256 octets
    dfpc : str, at most 256 octets
    implementation : str, at most 256 octets
    config_hash : str, at most 256 octets
    state : DfpcStateT
    samples : int, 0..9223372036854775807
        taken since activation.
    outputs : int, 0..9223372036854775807
    degraded : int, 0..9223372036854775807
        outputs of that status.
    failed : int, 0..9223372036854775807
    dropped : int, 0..9223372036854775807
        samples that a full queue lost.
    malformed : int, 0..9223372036854775807
        messages that could not be read.
    mean_step : float
        s of CPU.
    max_step : float
        s.
    last_error : str, at most 256 octets
    """

    ASN1_NAME: ClassVar[str] = "DFPC-Status"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    robot: str = ""
    dfpc: str = ""
    implementation: str = ""
    config_hash: str = ""
    state: DfpcStateT = DfpcStateT.DFPC_UNCONFIGURED
    samples: int = 0
    outputs: int = 0
    degraded: int = 0
    failed: int = 0
    dropped: int = 0
    malformed: int = 0
    mean_step: float = 0.0
    max_step: float = 0.0
    last_error: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "DfpcStatus.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "DfpcStatus.time_stamp", Time))
        put(self, "robot", check.text(self.robot, "DfpcStatus.robot", 256))
        put(self, "dfpc", check.text(self.dfpc, "DfpcStatus.dfpc", 256))
        put(self, "implementation", check.text(self.implementation, "DfpcStatus.implementation", 256))
        put(self, "config_hash", check.text(self.config_hash, "DfpcStatus.config_hash", 256))
        put(self, "state", check.enumeration(self.state, "DfpcStatus.state", DfpcStateT))
        put(self, "samples", check.integer(self.samples, "DfpcStatus.samples", 0, 9223372036854775807))
        put(self, "outputs", check.integer(self.outputs, "DfpcStatus.outputs", 0, 9223372036854775807))
        put(self, "degraded", check.integer(self.degraded, "DfpcStatus.degraded", 0, 9223372036854775807))
        put(self, "failed", check.integer(self.failed, "DfpcStatus.failed", 0, 9223372036854775807))
        put(self, "dropped", check.integer(self.dropped, "DfpcStatus.dropped", 0, 9223372036854775807))
        put(self, "malformed", check.integer(self.malformed, "DfpcStatus.malformed", 0, 9223372036854775807))
        put(self, "mean_step", check.real(self.mean_step, "DfpcStatus.mean_step"))
        put(self, "max_step", check.real(self.max_step, "DfpcStatus.max_step"))
        put(self, "last_error", check.text(self.last_error, "DfpcStatus.last_error", 256))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Event(Message):
    """Something that happened.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    ordinal : int, 0..9223372036854775807
        grows with each event of a store.
    time_stamp : Time
    scope : str, at most 256 octets
        robot id or ground.
    kind : str, at most 256 octets
        inserted, activated, deactivated, reanchored, alarm, ...
    body : NDArray[np.uint8], shape (n,)
        MessagePack map.
    """

    ASN1_NAME: ClassVar[str] = "Event"
    msg_version: int = 1
    ordinal: int = 0
    time_stamp: Time = field(default_factory=Time)
    scope: str = ""
    kind: str = ""
    body: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "Event.msg_version", 0, 4294967295))
        put(self, "ordinal", check.integer(self.ordinal, "Event.ordinal", 0, 9223372036854775807))
        put(self, "time_stamp", check.instance(self.time_stamp, "Event.time_stamp", Time))
        put(self, "scope", check.text(self.scope, "Event.scope", 256))
        put(self, "kind", check.text(self.kind, "Event.kind", 256))
        put(self, "body", check.octets(self.body, "Event.body", 65536))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns
