# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/body_motion.asn by cdff generate; do not edit.

"""Types of ``asn1/body_motion.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message
from cdff_common.types.time import Time


class BodyMotionKindT(IntEnum):
    """RESTING: no rotation found. STEADY: about one axis, moments unobservable. TUMBLING: any other."""

    MOTION_RESTING = 0
    MOTION_STEADY = 1
    MOTION_TUMBLING = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BodyMotion(Message):
    """Type ``BodyMotion`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of the newest pose.
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        reference frame, without rotation.
    body_frame_id : str, at most 256 bytes
    kind : BodyMotionKindT
    axis : NDArray[np.float64], shape (3,)
        unit vector along the angular momentum, in the frame; 0 if resting.
    axis_sigma : float
        rad.
    rate : float
        rad/s, about the axis, mean over time.
    rate_sigma : float
        rad/s.
    moment_ratios : NDArray[np.float64], shape (2,)
        smallest and middle moment of inertia by the largest; 0 if unobservable.
    cov_moment_ratios : NDArray[np.float64], shape (2, 2)
    principal_axes : NDArray[np.float64], shape (3, 3)
        principal axes in the body frame as columns, ascending moments; 0 if unobservable.
    centre : NDArray[np.float64], shape (3,)
        m, centre of mass in the body frame.
    cov_centre : NDArray[np.float64], shape (3, 3)
        m^2.
    unobservable : NDArray[np.float64], shape (0..3, 3)
        directions in the body frame in which the centre is unknown.
    """

    ASN1_NAME: ClassVar[str] = "BodyMotion"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    producer_id: str = ""
    frame_id: str = ""
    body_frame_id: str = ""
    kind: BodyMotionKindT = BodyMotionKindT.MOTION_RESTING
    axis: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    axis_sigma: float = 0.0
    rate: float = 0.0
    rate_sigma: float = 0.0
    moment_ratios: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))
    cov_moment_ratios: NDArray[np.float64] = field(default_factory=lambda: np.full((2, 2), np.nan))
    principal_axes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3), np.float64))
    centre: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    cov_centre: NDArray[np.float64] = field(default_factory=lambda: np.full((3, 3), np.nan))
    unobservable: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns
