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

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.product import ProductMetadata
from cdff_common.types.time import Time


class Og2RegionKindT(IntEnum):
    """What the numbers of a region are."""

    REGION_ANY = 0
    REGION_BBOX = 1
    REGION_BOX = 2
    REGION_CIRCLE = 3
    REGION_POLYGON = 4
    REGION_NEAR = 5


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Og2Region(Message):
    """BBOX xmin ymin xmax ymax, BOX xmin ymin zmin xmax ymax zmax, CIRCLE x y r, POLYGON x1 y1 x2 y2 ..., NEAR r
    around the origin of the frame.

    Attributes
    ----------
    kind : Og2RegionKindT
    frame_id : str, at most 256 octets
        frame of the numbers.
    numbers : NDArray[np.float64], shape (0..100,)
        m.
    """

    ASN1_NAME: ClassVar[str] = "OG2-Region"
    kind: Og2RegionKindT = Og2RegionKindT.REGION_ANY
    frame_id: str = ""
    numbers: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "kind", check.enumeration(self.kind, "Og2Region.kind", Og2RegionKindT))
        put(self, "frame_id", check.text(self.frame_id, "Og2Region.frame_id", 256))
        put(self, "numbers", check.real_array(self.numbers, "Og2Region.numbers", ((0, 100),)))


class Og2DeliverT(IntEnum):
    """How the product is to come."""

    DELIVER_AUTO = 0
    DELIVER_INLINE = 1
    DELIVER_REFERENCE = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Og2Request(Message):
    """A product as it is asked for.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    request_id : str, at most 256 octets
        UUID of who asks.
    robot : str, at most 256 octets
        id, or any.
    product : str, at most 256 octets
        pose, trajectory, dem, ...
    as_type : str, at most 256 octets
        ASN.1 type; empty for the product's own.
    format : str, at most 256 octets
        uper, ber, xer, msgpack or a file format.
    frame_id : str, at most 256 octets
        frame to have it in.
    child_frame_id : str, at most 256 octets
        of a pose; else empty.
    has_time : bool
        whether one time is asked for, else the newest.
    time : Time
    region : Og2Region
    max_age : float
        s, mission time less end of capture; 0 any.
    resolution : float
        m; 0 as made.
    min_coverage : float
        0 to 1, part of the region that must hold data.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "Og2Request.msg_version", 0, 4294967295))
        put(self, "request_id", check.text(self.request_id, "Og2Request.request_id", 256))
        put(self, "robot", check.text(self.robot, "Og2Request.robot", 256))
        put(self, "product", check.text(self.product, "Og2Request.product", 256))
        put(self, "as_type", check.text(self.as_type, "Og2Request.as_type", 256))
        put(self, "format", check.text(self.format, "Og2Request.format", 256))
        put(self, "frame_id", check.text(self.frame_id, "Og2Request.frame_id", 256))
        put(self, "child_frame_id", check.text(self.child_frame_id, "Og2Request.child_frame_id", 256))
        put(self, "has_time", check.boolean(self.has_time, "Og2Request.has_time"))
        put(self, "time", check.instance(self.time, "Og2Request.time", Time))
        put(self, "region", check.instance(self.region, "Og2Request.region", Og2Region))
        put(self, "max_age", check.real(self.max_age, "Og2Request.max_age"))
        put(self, "resolution", check.real(self.resolution, "Og2Request.resolution"))
        put(self, "min_coverage", check.real(self.min_coverage, "Og2Request.min_coverage"))
        put(self, "deliver", check.enumeration(self.deliver, "Og2Request.deliver", Og2DeliverT))
        put(self, "deadline", check.integer(self.deadline, "Og2Request.deadline", 0, 4294967295))


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
    """What became of a request so far.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of this state.
    job_id : str, at most 256 octets
    request_id : str, at most 256 octets
    robot : str, at most 256 octets
    product : str, at most 256 octets
    state : Og2JobStateT
    reason : str, at most 256 octets
    remaining : float
        s to the deadline.
    plan : tuple[str, ...]
        DFPCs in the order of use.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "Og2Job.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "Og2Job.time_stamp", Time))
        put(self, "job_id", check.text(self.job_id, "Og2Job.job_id", 256))
        put(self, "request_id", check.text(self.request_id, "Og2Job.request_id", 256))
        put(self, "robot", check.text(self.robot, "Og2Job.robot", 256))
        put(self, "product", check.text(self.product, "Og2Job.product", 256))
        put(self, "state", check.enumeration(self.state, "Og2Job.state", Og2JobStateT))
        put(self, "reason", check.text(self.reason, "Og2Job.reason", 256))
        put(self, "remaining", check.real(self.remaining, "Og2Job.remaining"))
        put(self, "plan", check.items(self.plan, "Og2Job.plan", 0, 256, lambda v, w: check.text(v, w, 256)))

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
    """An answer to a request: progress, a product, its id, or an error.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    request_id : str, at most 256 octets
    job_id : str, at most 256 octets
    kind : Og2ReplyKindT
    is_final : bool
        exactly one reply to a request is.
    error_code : Og2ErrorCodeT
    retriable : bool
    detail : str, at most 256 octets
    metadata : ProductMetadata
        of the product, also where it goes by reference.
    coverage : float
        0 to 1, part of the region that holds data.
    age : float
        s, of the newest data.
    oldest_age : float
        s, of the oldest data.
    differences : tuple[str, ...]
        from what was asked; none where all is as asked.
    payload : NDArray[np.uint8], shape (n,)
        the product in metadata.encoding; none by reference.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "Og2Reply.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "Og2Reply.time_stamp", Time))
        put(self, "request_id", check.text(self.request_id, "Og2Reply.request_id", 256))
        put(self, "job_id", check.text(self.job_id, "Og2Reply.job_id", 256))
        put(self, "kind", check.enumeration(self.kind, "Og2Reply.kind", Og2ReplyKindT))
        put(self, "is_final", check.boolean(self.is_final, "Og2Reply.is_final"))
        put(self, "error_code", check.enumeration(self.error_code, "Og2Reply.error_code", Og2ErrorCodeT))
        put(self, "retriable", check.boolean(self.retriable, "Og2Reply.retriable"))
        put(self, "detail", check.text(self.detail, "Og2Reply.detail", 256))
        put(self, "metadata", check.instance(self.metadata, "Og2Reply.metadata", ProductMetadata))
        put(self, "coverage", check.real(self.coverage, "Og2Reply.coverage"))
        put(self, "age", check.real(self.age, "Og2Reply.age"))
        put(self, "oldest_age", check.real(self.oldest_age, "Og2Reply.oldest_age"))
        put(
            self,
            "differences",
            check.items(self.differences, "Og2Reply.differences", 0, 256, lambda v, w: check.text(v, w, 256)),
        )
        put(self, "payload", check.octets(self.payload, "Og2Reply.payload", 1073741824))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns
