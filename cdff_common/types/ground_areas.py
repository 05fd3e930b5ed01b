# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/ground_areas.asn by cdff generate; do not edit.

"""Types of ``asn1/ground_areas.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.ground_areas_ext import GroundAreasDataExt, GroundAreasExt
from cdff_common.types.message import Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GroundAreasMetadata(Message):
    """What a ``GroundAreas-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of the corners.
    start_time : Time
        t0: begin of capture of what the areas are made from.
    end_time : Time
        t1: end of it.
    resolution : float
        m, side of the cells that the areas were made of; 0 where there were none.
    tolerance : float
        m, how far outlines may have moved: safe and passable inwards, all others outwards.
    """

    ASN1_NAME: ClassVar[str] = "GroundAreas-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    start_time: Time = field(default_factory=Time)
    end_time: Time = field(default_factory=Time)
    resolution: float = 0.0
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "GroundAreasMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "GroundAreasMetadata.producer_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "GroundAreasMetadata.frame_id", 256))
        put(self, "start_time", check.instance(self.start_time, "GroundAreasMetadata.start_time", Time))
        put(self, "end_time", check.instance(self.end_time, "GroundAreasMetadata.end_time", Time))
        put(self, "resolution", check.real(self.resolution, "GroundAreasMetadata.resolution"))
        put(self, "tolerance", check.real(self.tolerance, "GroundAreasMetadata.tolerance"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GroundAreasData(GroundAreasDataExt):
    """Columns: one row for each area, for each ring, for each corner. The rings of an area follow one another, the
    outer one first, then its holes; so do the corners of a ring.

    Attributes
    ----------
    kinds : NDArray[np.uint8], shape (n,)
        0 unknown, 1 safe, 2 caution, 3 hazard, 4 passable (1 or 2), 5 blocked (0 or 3).
    areas : NDArray[np.float64], shape (n,)
        m2, without the holes.
    ring_counts : NDArray[np.uint32], shape (n,)
        rings of each area: 1 and its holes.
    corner_counts : NDArray[np.uint32], shape (n,)
        corners of each ring, 3 at least.
    corners : NDArray[np.float64], shape (n, 2)
        m, x y; counter-clockwise, holes clockwise; the first is not repeated.
    """

    ASN1_NAME: ClassVar[str] = "GroundAreas-Data"
    kinds: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    areas: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0, np.float64))
    ring_counts: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    corner_counts: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    corners: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "kinds", check.typed_octets(self.kinds, "GroundAreasData.kinds", 1073741824, "<u1", 0))
        put(self, "areas", check.typed_octets(self.areas, "GroundAreasData.areas", 1073741824, "<f8", 0))
        put(
            self,
            "ring_counts",
            check.typed_octets(self.ring_counts, "GroundAreasData.ring_counts", 1073741824, "<u4", 0),
        )
        put(
            self,
            "corner_counts",
            check.typed_octets(self.corner_counts, "GroundAreasData.corner_counts", 1073741824, "<u4", 0),
        )
        put(self, "corners", check.typed_octets(self.corners, "GroundAreasData.corners", 1073741824, "<f8", 2))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GroundAreas(GroundAreasExt):
    """Areas of the ground by what a rover may do there.

    Attributes
    ----------
    metadata : GroundAreasMetadata
    data : GroundAreasData
    """

    ASN1_NAME: ClassVar[str] = "GroundAreas"
    metadata: GroundAreasMetadata = field(default_factory=GroundAreasMetadata)
    data: GroundAreasData = field(default_factory=GroundAreasData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "GroundAreas.metadata", GroundAreasMetadata))
        put(self, "data", check.instance(self.data, "GroundAreas.data", GroundAreasData))
        self._check_together()
