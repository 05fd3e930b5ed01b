# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/og2.asn by cdff generate; do not edit.

"""Types of ``asn1/og2.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message
from cdff_common.types.product import ProductMetadata
from cdff_common.types.time import Time


class Og2RegionKindT(IntEnum):
    """Shape of a region, i.e. the meaning of its numbers."""

    REGION_ANY = 0
    REGION_BBOX = 1
    REGION_BOX = 2
    REGION_CIRCLE = 3
    REGION_POLYGON = 4
    REGION_NEAR = 5


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Og2Region(Message):
    """BBOX xmin ymin xmax ymax, BOX xmin ymin zmin xmax ymax zmax, CIRCLE x y r, POLYGON x1 y1 x2 y2 ...,
    NEAR r around the origin of the frame.

    Attributes
    ----------
    kind : Og2RegionKindT
    frame_id : str, at most 256 bytes
        frame of the numbers.
    numbers : NDArray[np.float64], shape (0..100,)
        m.
    """

    ASN1_NAME: ClassVar[str] = "OG2-Region"
    kind: Og2RegionKindT = Og2RegionKindT.REGION_ANY
    frame_id: str = ""
    numbers: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))


class Og2DeliverT(IntEnum):
    """Delivery of the product."""

    DELIVER_AUTO = 0
    DELIVER_INLINE = 1
    DELIVER_REFERENCE = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Og2Request(Message):
    """Request for a product.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    request_id : str, at most 256 bytes
        UUID of the request.
    robot : str, at most 256 bytes
        robot id, or any.
    product : str, at most 256 bytes
        pose, trajectory, dem, ...
    as_type : str, at most 256 bytes
        ASN.1 type; empty for the default of the product.
    format : str, at most 256 bytes
        uper, ber, xer, msgpack or a file format.
    frame_id : str, at most 256 bytes
        requested frame.
    child_frame_id : str, at most 256 bytes
        of a pose, else empty.
    has_time : bool
        true for a product of one time, false for the newest.
    time : Time
    region : Og2Region
    max_age : float
        s, mission time minus end of capture; 0 for any.
    resolution : float
        m; 0 for the original.
    min_coverage : float
        0 to 1, required fraction of the region with data.
    deliver : Og2DeliverT
    deadline : int, 0..4294967295
        ms until the final answer.
    """

    ASN1_NAME: ClassVar[str] = "OG2-Request"
    msg_version: int = 1
    request_id: str = ""
    robot: str = ""
    product: str = ""
    as_type: str = ""
    format: str = ""
    frame_id: str = ""
    child_frame_id: str = ""
    has_time: bool = False
    time: Time = field(default_factory=Time)
    region: Og2Region = field(default_factory=Og2Region)
    max_age: float = 0.0
    resolution: float = 0.0
    min_coverage: float = 0.0
    deliver: Og2DeliverT = Og2DeliverT.DELIVER_AUTO
    deadline: int = 0


class Og2JobStateT(IntEnum):
    """``OG2-jobState-t``."""

    JOB_RECEIVED = 0
    JOB_LOOKING = 1
    JOB_PLANNING = 2
    JOB_PREPARING = 3
    JOB_WAITING = 4
    JOB_DELIVERING = 5
    JOB_DONE = 6
    JOB_FAILED = 7
    JOB_CANCELLED = 8


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Og2Job(Message):
    """State of a request.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of this state.
    job_id : str, at most 256 bytes
    request_id : str, at most 256 bytes
    robot : str, at most 256 bytes
    product : str, at most 256 bytes
    state : Og2JobStateT
    reason : str, at most 256 bytes
    remaining : float
        s until the deadline.
    plan : tuple[str, ...]
        DFPCs in order of execution.
    """

    ASN1_NAME: ClassVar[str] = "OG2-Job"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    job_id: str = ""
    request_id: str = ""
    robot: str = ""
    product: str = ""
    state: Og2JobStateT = Og2JobStateT.JOB_RECEIVED
    reason: str = ""
    remaining: float = 0.0
    plan: tuple[str, ...] = ()

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


class Og2ReplyKindT(IntEnum):
    """``OG2-replyKind-t``."""

    REPLY_PROGRESS = 0
    REPLY_PRODUCT = 1
    REPLY_REFERENCE = 2
    REPLY_ERROR = 3


class Og2ErrorCodeT(IntEnum):
    """``OG2-errorCode-t``."""

    ERROR_NONE = 0
    ERROR_INVALID_ARGUMENT = 1
    ERROR_NOT_FOUND = 2
    ERROR_NOT_ACTIVE = 3
    ERROR_UNAVAILABLE = 4
    ERROR_DEADLINE = 5
    ERROR_OVERLOADED = 6
    ERROR_DENIED = 7
    ERROR_INTERNAL = 8


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Og2Reply(Message):
    """Reply to a request: progress, a product, its id, or an error.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    request_id : str, at most 256 bytes
    job_id : str, at most 256 bytes
    kind : Og2ReplyKindT
    is_final : bool
        true for exactly one reply to a request.
    error_code : Og2ErrorCodeT
    retriable : bool
    detail : str, at most 256 bytes
    metadata : ProductMetadata
        of the product, also for delivery by reference.
    coverage : float
        0 to 1, fraction of the region with data.
    age : float
        s, of the newest data.
    oldest_age : float
        s, of the oldest data.
    differences : tuple[str, ...]
        deviations from the request; none if it is fulfilled exactly.
    payload : NDArray[np.uint8], shape (n,)
        the product in metadata.encoding; empty for delivery by reference.
    """

    ASN1_NAME: ClassVar[str] = "OG2-Reply"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    request_id: str = ""
    job_id: str = ""
    kind: Og2ReplyKindT = Og2ReplyKindT.REPLY_PROGRESS
    is_final: bool = False
    error_code: Og2ErrorCodeT = Og2ErrorCodeT.ERROR_NONE
    retriable: bool = False
    detail: str = ""
    metadata: ProductMetadata = field(default_factory=ProductMetadata)
    coverage: float = 0.0
    age: float = 0.0
    oldest_age: float = 0.0
    differences: tuple[str, ...] = ()
    payload: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns
