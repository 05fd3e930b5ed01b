# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/ground_areas.asn by cdff generate; do not edit.

"""Types of ``asn1/ground_areas.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.ground_areas_ext import GroundAreasDataExt, GroundAreasExt
from cdff_common.types.message import CapturedMessage, Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GroundAreasMetadata(Message):
    """Type ``GroundAreas-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the corners.
    start_time : Time
        t0: start of capture of the source data.
    end_time : Time
        t1: end of capture.
    resolution : float
        m, edge of the cells of the source grid; 0 without a grid.
    tolerance : float
        m, largest displacement of the outlines: safe and passable inwards, all others outwards.
    """

    ASN1_NAME: ClassVar[str] = "GroundAreas-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    start_time: Time = field(default_factory=Time)
    end_time: Time = field(default_factory=Time)
    resolution: float = 0.0
    tolerance: float = 0.0

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.end_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GroundAreasData(GroundAreasDataExt):
    """Columns with one row per area, per ring or per corner. The rings of an area are consecutive, the
    outer ring first, then its holes; so are the corners of a ring.

    Attributes
    ----------
    kinds : NDArray[np.uint8], shape (n,)
        0 unknown, 1 safe, 2 caution, 3 hazard, 4 passable (1 or 2), 5 blocked (0 or 3).
    areas : NDArray[np.float64], shape (n,)
        m2, excluding the holes.
    ring_counts : NDArray[np.uint32], shape (n,)
        rings of each area: 1 + number of holes.
    corner_counts : NDArray[np.uint32], shape (n,)
        corners of each ring, at least 3.
    corners : NDArray[np.float64], shape (n, 2)
        m, x y; counter-clockwise, holes clockwise; the first is not repeated.
    """

    ASN1_NAME: ClassVar[str] = "GroundAreas-Data"
    kinds: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    areas: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0, np.float64))
    ring_counts: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    corner_counts: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    corners: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GroundAreas(GroundAreasExt, CapturedMessage):
    """Areas of the ground, classified by traversability.

    Attributes
    ----------
    metadata : GroundAreasMetadata
    data : GroundAreasData
    """

    ASN1_NAME: ClassVar[str] = "GroundAreas"
    metadata: GroundAreasMetadata = field(default_factory=GroundAreasMetadata)
    data: GroundAreasData = field(default_factory=GroundAreasData)
