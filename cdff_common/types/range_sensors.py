# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/range_sensors.asn by cdff generate; do not edit.

"""Types of ``asn1/range_sensors.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.eigen import Angle
from cdff_common.types.message import Message
from cdff_common.types.time import Time


class ProjectionType(IntEnum):
    """``PROJECTION-TYPE``."""

    POLAR = 0
    PLANAR = 1


class LaserRangeErrors(IntEnum):
    """Error codes: values of ranges below end-laser-range-errors."""

    TOO_FAR = 0
    TOO_NEAR = 1
    MEASUREMENT_ERROR = 2
    OTHER_RANGE_ERRORS = 3
    MAX_RANGE_ERROR = 4
    END_LASER_RANGE_ERRORS = 5


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LaserScan(Message):
    """Ranges along one line.

    Attributes
    ----------
    ref_time : Time
    start_angle : float
        rad.
    angular_resolution : float
        rad between two ranges.
    speed : float
        rad/s of the mirror.
    ranges : NDArray[np.int32], shape (1..16777216,)
        mm.
    min_range : int, 0..4294967295
        mm.
    max_range : int, 0..4294967295
        mm.
    remission : NDArray[np.float64], shape (1..16777216,)
    """

    ASN1_NAME: ClassVar[str] = "LaserScan"
    ref_time: Time = field(default_factory=Time)
    start_angle: float = 0.0
    angular_resolution: float = 0.0
    speed: float = 0.0
    ranges: NDArray[np.int32] = field(default_factory=lambda: np.zeros((1,), np.int32))
    min_range: int = 0
    max_range: int = 0
    remission: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


class UnitAxis(IntEnum):
    """``UNIT-AXIS``."""

    UNIT_X = 0
    UNIT_Y = 1
    UNIT_Z = 2


class DepthMeasurementState(IntEnum):
    """``DEPTH-MEASUREMENT-STATE``."""

    VALID_MEASUREMENT = 0
    TOO_FAR = 1
    TOO_NEAR = 2
    MEASUREMENT_ERROR = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DepthMap(Message):
    """Ranges over two angles.

    Attributes
    ----------
    ref_time : Time
    timestamps : tuple[Time, ...]
    vertical_projection : ProjectionType
    horizontal_projection : ProjectionType
    vertical_interval : NDArray[np.float64], shape (1..16777216,)
        rad, or m on a plane at 1 m.
    horizontal_interval : NDArray[np.float64], shape (1..16777216,)
    vertical_size : int, 0..4294967295
    horizontal_size : int, 0..4294967295
    distances : NDArray[np.float64], shape (1..16777216,)
        m, row-major.
    remissions : NDArray[np.float64], shape (1..16777216,)
    """

    ASN1_NAME: ClassVar[str] = "DepthMap"
    ref_time: Time = field(default_factory=Time)
    timestamps: tuple[Time, ...] = field(default_factory=lambda: (Time(),) * 1)
    vertical_projection: ProjectionType = ProjectionType.POLAR
    horizontal_projection: ProjectionType = ProjectionType.POLAR
    vertical_interval: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))
    horizontal_interval: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))
    vertical_size: int = 0
    horizontal_size: int = 0
    distances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))
    remissions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DistanceImage(Message):
    """Type ``DistanceImage`` of the ASN.1 modules.

    Attributes
    ----------
    ref_time : Time
    width : int, 0..65535
    height : int, 0..65535
    scale_x : float
    scale_y : float
    center_x : float
    center_y : float
    data : NDArray[np.float64], shape (1..16777216,)
        m.
    """

    ASN1_NAME: ClassVar[str] = "DistanceImage"
    ref_time: Time = field(default_factory=Time)
    width: int = 0
    height: int = 0
    scale_x: float = 0.0
    scale_y: float = 0.0
    center_x: float = 0.0
    center_y: float = 0.0
    data: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sonar(Message):
    """Type ``Sonar`` of the ASN.1 modules.

    Attributes
    ----------
    ref_time : Time
    timestamps : tuple[Time, ...]
    bin_duration : Time
    beam_width : Angle
    beam_height : Angle
    bearings : tuple[Angle, ...]
    speed_of_sound : float
        m/s.
    bin_count : int, 0..4294967295
    beam_count : int, 0..4294967295
    bins : NDArray[np.float64], shape (1..60,)
    """

    ASN1_NAME: ClassVar[str] = "Sonar"
    ref_time: Time = field(default_factory=Time)
    timestamps: tuple[Time, ...] = field(default_factory=lambda: (Time(),) * 1)
    bin_duration: Time = field(default_factory=Time)
    beam_width: Angle = field(default_factory=Angle)
    beam_height: Angle = field(default_factory=Angle)
    bearings: tuple[Angle, ...] = field(default_factory=lambda: (Angle(),) * 1)
    speed_of_sound: float = 0.0
    bin_count: int = 0
    beam_count: int = 0
    bins: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1,), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SonarBeam(Message):
    """Type ``SonarBeam`` of the ASN.1 modules.

    Attributes
    ----------
    ref_time : Time
    bearing : Angle
    sampling_interval : float
        s.
    speed_of_sound : float
        m/s.
    beamwidth_horizontal : float
        rad.
    beamwidth_vertical : float
        rad.
    beam : NDArray[np.uint8], shape (1..60,)
    """

    ASN1_NAME: ClassVar[str] = "SonarBeam"
    ref_time: Time = field(default_factory=Time)
    bearing: Angle = field(default_factory=Angle)
    sampling_interval: float = 0.0
    speed_of_sound: float = 0.0
    beamwidth_horizontal: float = 0.0
    beamwidth_vertical: float = 0.0
    beam: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((1,), np.uint8))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SonarScan(Message):
    """Type ``SonarScan`` of the ASN.1 modules.

    Attributes
    ----------
    ref_time : Time
    data : NDArray[np.uint8], shape (1..60,)
    time_beams : tuple[Time, ...]
    number_of_beams : int, 0..65535
    number_of_bins : int, 0..65535
    start_bearing : Angle
    angular_resolution : Angle
    sampling_interval : float
        s.
    speed_of_sound : float
        m/s.
    beamwidth_horizontal : Angle
    beamwidth_vertical : Angle
    memory_layout_column : bool
    polar_coordinates : bool
    """

    ASN1_NAME: ClassVar[str] = "SonarScan"
    ref_time: Time = field(default_factory=Time)
    data: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((1,), np.uint8))
    time_beams: tuple[Time, ...] = field(default_factory=lambda: (Time(),) * 1)
    number_of_beams: int = 0
    number_of_bins: int = 0
    start_bearing: Angle = field(default_factory=Angle)
    angular_resolution: Angle = field(default_factory=Angle)
    sampling_interval: float = 0.0
    speed_of_sound: float = 0.0
    beamwidth_horizontal: Angle = field(default_factory=Angle)
    beamwidth_vertical: Angle = field(default_factory=Angle)
    memory_layout_column: bool = False
    polar_coordinates: bool = False

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns
