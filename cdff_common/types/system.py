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
    robot : str, at most 256 bytes
    sensor : str, at most 256 bytes
    mode : str, at most 256 bytes
        confirmed.
    target : str, at most 256 bytes
        requested; equal to mode in a steady state.
    state : IcuStateT
    is_on : bool
    rate : float
        Hz.
    holder : str, at most 256 bytes
        client that requested it.
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
    """Status of a DFPC.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    robot : str, at most 256 bytes
    dfpc : str, at most 256 bytes
    implementation : str, at most 256 bytes
    config_hash : str, at most 256 bytes
    state : DfpcStateT
    samples : int, 0..9223372036854775807
        processed since activation.
    outputs : int, 0..9223372036854775807
    degraded : int, 0..9223372036854775807
        outputs of that status.
    failed : int, 0..9223372036854775807
    dropped : int, 0..9223372036854775807
        samples dropped by a full queue.
    malformed : int, 0..9223372036854775807
        messages that could not be decoded.
    mean_step : float
        s of CPU.
    max_step : float
        s.
    last_error : str, at most 256 bytes
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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Event(Message):
    """Event of the system.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    ordinal : int, 0..9223372036854775807
        increases with each event of a store.
    time_stamp : Time
    scope : str, at most 256 bytes
        robot id or ground.
    kind : str, at most 256 bytes
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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns
