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

from cdff_common.types import validation as check
from cdff_common.types.eigen import Angle
from cdff_common.types.message import Message
from cdff_common.types.time import Time


class ProjectionType(IntEnum):
    """``PROJECTION-TYPE``."""

    POLAR = 0
    PLANAR = 1


class LaserRangeErrors(IntEnum):
    """Values of ranges below end-laser-range-errors are these errors."""

    TOO_FAR = 0
    TOO_NEAR = 1
    MEASUREMENT_ERROR = 2
    OTHER_RANGE_ERRORS = 3
    MAX_RANGE_ERROR = 4
    END_LASER_RANGE_ERRORS = 5


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LaserScan(Message):
    """One line of ranges.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "LaserScan.ref_time", Time))
        put(self, "start_angle", check.real(self.start_angle, "LaserScan.start_angle"))
        put(self, "angular_resolution", check.real(self.angular_resolution, "LaserScan.angular_resolution"))
        put(self, "speed", check.real(self.speed, "LaserScan.speed"))
        put(
            self,
            "ranges",
            check.integer_array(self.ranges, "LaserScan.ranges", ((1, 16777216),), -2147483648, 2147483647, "int32"),
        )
        put(self, "min_range", check.integer(self.min_range, "LaserScan.min_range", 0, 4294967295))
        put(self, "max_range", check.integer(self.max_range, "LaserScan.max_range", 0, 4294967295))
        put(self, "remission", check.real_array(self.remission, "LaserScan.remission", ((1, 16777216),)))

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "DepthMap.ref_time", Time))
        put(
            self,
            "timestamps",
            check.items(self.timestamps, "DepthMap.timestamps", 1, 16777216, lambda v, w: check.instance(v, w, Time)),
        )
        put(
            self,
            "vertical_projection",
            check.enumeration(self.vertical_projection, "DepthMap.vertical_projection", ProjectionType),
        )
        put(
            self,
            "horizontal_projection",
            check.enumeration(self.horizontal_projection, "DepthMap.horizontal_projection", ProjectionType),
        )
        put(
            self,
            "vertical_interval",
            check.real_array(self.vertical_interval, "DepthMap.vertical_interval", ((1, 16777216),)),
        )
        put(
            self,
            "horizontal_interval",
            check.real_array(self.horizontal_interval, "DepthMap.horizontal_interval", ((1, 16777216),)),
        )
        put(self, "vertical_size", check.integer(self.vertical_size, "DepthMap.vertical_size", 0, 4294967295))
        put(self, "horizontal_size", check.integer(self.horizontal_size, "DepthMap.horizontal_size", 0, 4294967295))
        put(self, "distances", check.real_array(self.distances, "DepthMap.distances", ((1, 16777216),)))
        put(self, "remissions", check.real_array(self.remissions, "DepthMap.remissions", ((1, 16777216),)))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DistanceImage(Message):
    """What a ``DistanceImage`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "DistanceImage.ref_time", Time))
        put(self, "width", check.integer(self.width, "DistanceImage.width", 0, 65535))
        put(self, "height", check.integer(self.height, "DistanceImage.height", 0, 65535))
        put(self, "scale_x", check.real(self.scale_x, "DistanceImage.scale_x"))
        put(self, "scale_y", check.real(self.scale_y, "DistanceImage.scale_y"))
        put(self, "center_x", check.real(self.center_x, "DistanceImage.center_x"))
        put(self, "center_y", check.real(self.center_y, "DistanceImage.center_y"))
        put(self, "data", check.real_array(self.data, "DistanceImage.data", ((1, 16777216),)))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sonar(Message):
    """What a ``Sonar`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "Sonar.ref_time", Time))
        put(
            self,
            "timestamps",
            check.items(self.timestamps, "Sonar.timestamps", 1, 60, lambda v, w: check.instance(v, w, Time)),
        )
        put(self, "bin_duration", check.instance(self.bin_duration, "Sonar.bin_duration", Time))
        put(self, "beam_width", check.instance(self.beam_width, "Sonar.beam_width", Angle))
        put(self, "beam_height", check.instance(self.beam_height, "Sonar.beam_height", Angle))
        put(
            self,
            "bearings",
            check.items(self.bearings, "Sonar.bearings", 1, 60, lambda v, w: check.instance(v, w, Angle)),
        )
        put(self, "speed_of_sound", check.real(self.speed_of_sound, "Sonar.speed_of_sound"))
        put(self, "bin_count", check.integer(self.bin_count, "Sonar.bin_count", 0, 4294967295))
        put(self, "beam_count", check.integer(self.beam_count, "Sonar.beam_count", 0, 4294967295))
        put(self, "bins", check.real_array(self.bins, "Sonar.bins", ((1, 60),)))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SonarBeam(Message):
    """What a ``SonarBeam`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "SonarBeam.ref_time", Time))
        put(self, "bearing", check.instance(self.bearing, "SonarBeam.bearing", Angle))
        put(self, "sampling_interval", check.real(self.sampling_interval, "SonarBeam.sampling_interval"))
        put(self, "speed_of_sound", check.real(self.speed_of_sound, "SonarBeam.speed_of_sound"))
        put(self, "beamwidth_horizontal", check.real(self.beamwidth_horizontal, "SonarBeam.beamwidth_horizontal"))
        put(self, "beamwidth_vertical", check.real(self.beamwidth_vertical, "SonarBeam.beamwidth_vertical"))
        put(self, "beam", check.integer_array(self.beam, "SonarBeam.beam", ((1, 60),), 0, 255, "uint8"))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SonarScan(Message):
    """What a ``SonarScan`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "SonarScan.ref_time", Time))
        put(self, "data", check.integer_array(self.data, "SonarScan.data", ((1, 60),), 0, 255, "uint8"))
        put(
            self,
            "time_beams",
            check.items(self.time_beams, "SonarScan.time_beams", 1, 60, lambda v, w: check.instance(v, w, Time)),
        )
        put(self, "number_of_beams", check.integer(self.number_of_beams, "SonarScan.number_of_beams", 0, 65535))
        put(self, "number_of_bins", check.integer(self.number_of_bins, "SonarScan.number_of_bins", 0, 65535))
        put(self, "start_bearing", check.instance(self.start_bearing, "SonarScan.start_bearing", Angle))
        put(self, "angular_resolution", check.instance(self.angular_resolution, "SonarScan.angular_resolution", Angle))
        put(self, "sampling_interval", check.real(self.sampling_interval, "SonarScan.sampling_interval"))
        put(self, "speed_of_sound", check.real(self.speed_of_sound, "SonarScan.speed_of_sound"))
        put(
            self,
            "beamwidth_horizontal",
            check.instance(self.beamwidth_horizontal, "SonarScan.beamwidth_horizontal", Angle),
        )
        put(self, "beamwidth_vertical", check.instance(self.beamwidth_vertical, "SonarScan.beamwidth_vertical", Angle))
        put(self, "memory_layout_column", check.boolean(self.memory_layout_column, "SonarScan.memory_layout_column"))
        put(self, "polar_coordinates", check.boolean(self.polar_coordinates, "SonarScan.polar_coordinates"))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns
