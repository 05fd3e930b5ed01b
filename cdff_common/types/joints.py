# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/joints.asn by cdff generate; do not edit.

"""Types of ``asn1/joints.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointState(Message):
    """What a ``JointState`` of the ASN.1 modules holds.

    Attributes
    ----------
    position : float
        rad or m.
    speed : float
        rad/s or m/s.
    effort : float
        N m or N.
    raw : float
        motor command, -1 to 1.
    acceleration : float
        rad/s2 or m/s2.
    """

    ASN1_NAME: ClassVar[str] = "JointState"
    position: float = 0.0
    speed: float = 0.0
    effort: float = 0.0
    raw: float = 0.0
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "position", check.real(self.position, "JointState.position"))
        put(self, "speed", check.real(self.speed, "JointState.speed"))
        put(self, "effort", check.real(self.effort, "JointState.effort"))
        put(self, "raw", check.real(self.raw, "JointState.raw"))
        put(self, "acceleration", check.real(self.acceleration, "JointState.acceleration"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointLimitRange(Message):
    """What a ``JointLimitRange`` of the ASN.1 modules holds.

    Attributes
    ----------
    min : JointState
    max : JointState
    """

    ASN1_NAME: ClassVar[str] = "JointLimitRange"
    min: JointState = field(default_factory=JointState)
    max: JointState = field(default_factory=JointState)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "min", check.instance(self.min, "JointLimitRange.min", JointState))
        put(self, "max", check.instance(self.max, "JointLimitRange.max", JointState))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class OutOfBounds(Message):
    """What an ``OutOfBounds`` of the ASN.1 modules holds.

    Attributes
    ----------
    error_name : str, at most 256 octets
    min : float
    max : float
    value : float
    """

    ASN1_NAME: ClassVar[str] = "OutOfBounds"
    error_name: str = ""
    min: float = 0.0
    max: float = 0.0
    value: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "error_name", check.text(self.error_name, "OutOfBounds.error_name", 256))
        put(self, "min", check.real(self.min, "OutOfBounds.min"))
        put(self, "max", check.real(self.max, "OutOfBounds.max"))
        put(self, "value", check.real(self.value, "OutOfBounds.value"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointLimits(Message):
    """What a ``JointLimits`` of the ASN.1 modules holds.

    Attributes
    ----------
    vector_name : str, at most 256 octets
    ranges : tuple[JointLimitRange, ...]
    """

    ASN1_NAME: ClassVar[str] = "JointLimits"
    vector_name: str = ""
    ranges: tuple[JointLimitRange, ...] = field(default_factory=lambda: (JointLimitRange(),) * 1)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "vector_name", check.text(self.vector_name, "JointLimits.vector_name", 256))
        put(
            self,
            "ranges",
            check.items(self.ranges, "JointLimits.ranges", 1, 60, lambda v, w: check.instance(v, w, JointLimitRange)),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Joints(Message):
    """What a ``Joints`` of the ASN.1 modules holds.

    Attributes
    ----------
    timestamp : Time
    names : tuple[str, ...]
    elements : tuple[JointState, ...]
        in the order of names.
    """

    ASN1_NAME: ClassVar[str] = "Joints"
    timestamp: Time = field(default_factory=Time)
    names: tuple[str, ...] = ()
    elements: tuple[JointState, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "timestamp", check.instance(self.timestamp, "Joints.timestamp", Time))
        put(self, "names", check.items(self.names, "Joints.names", 0, 50, lambda v, w: check.text(v, w, 256)))
        put(
            self,
            "elements",
            check.items(self.elements, "Joints.elements", 0, 50, lambda v, w: check.instance(v, w, JointState)),
        )

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointTrajectory(Message):
    """What a ``JointTrajectory`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[JointState, ...]
    """

    ASN1_NAME: ClassVar[str] = "JointTrajectory"
    items: tuple[JointState, ...] = field(default_factory=lambda: (JointState(),) * 1)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(self.items, "JointTrajectory.items", 1, 60, lambda v, w: check.instance(v, w, JointState)),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointsTrajectory(Message):
    """What a ``JointsTrajectory`` of the ASN.1 modules holds.

    Attributes
    ----------
    vector_name : tuple[str, ...]
    timetags : tuple[Time, ...]
    trajectory : tuple[tuple[JointState, ...], ...]
    """

    ASN1_NAME: ClassVar[str] = "JointsTrajectory"
    vector_name: tuple[str, ...] = field(default_factory=lambda: ("",) * 1)
    timetags: tuple[Time, ...] = field(default_factory=lambda: (Time(),) * 1)
    trajectory: tuple[tuple[JointState, ...], ...] = field(default_factory=lambda: ((JointState(),) * 1,) * 1)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "vector_name",
            check.items(self.vector_name, "JointsTrajectory.vector_name", 1, 60, lambda v, w: check.text(v, w, 256)),
        )
        put(
            self,
            "timetags",
            check.items(self.timetags, "JointsTrajectory.timetags", 1, 60, lambda v, w: check.instance(v, w, Time)),
        )
        put(
            self,
            "trajectory",
            check.items(
                self.trajectory,
                "JointsTrajectory.trajectory",
                1,
                60,
                lambda v, w: check.items(v, w, 1, 60, lambda v, w: check.instance(v, w, JointState)),
            ),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InvalidTimeStep(Message):
    """What an ``InvalidTimeStep`` of the ASN.1 modules holds.

    Attributes
    ----------
    time_step : int, 0..4294967295
    """

    ASN1_NAME: ClassVar[str] = "InvalidTimeStep"
    time_step: int = 0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "time_step", check.integer(self.time_step, "InvalidTimeStep.time_step", 0, 4294967295))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InvalidName(Message):
    """What an ``InvalidName`` of the ASN.1 modules holds.

    Attributes
    ----------
    name_string : str, at most 256 octets
    """

    ASN1_NAME: ClassVar[str] = "InvalidName"
    name_string: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "name_string", check.text(self.name_string, "InvalidName.name_string", 256))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Wrench(Message):
    """What a ``Wrench`` of the ASN.1 modules holds.

    Attributes
    ----------
    timestamp : Time
    force : NDArray[np.float64], shape (3,)
        N.
    torque : NDArray[np.float64], shape (3,)
        N m.
    """

    ASN1_NAME: ClassVar[str] = "Wrench"
    timestamp: Time = field(default_factory=Time)
    force: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    torque: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "timestamp", check.instance(self.timestamp, "Wrench.timestamp", Time))
        put(self, "force", check.real_array(self.force, "Wrench.force", ((3, 3),)))
        put(self, "torque", check.real_array(self.torque, "Wrench.torque", ((3, 3),)))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Wrenches(Message):
    """What a ``Wrenches`` of the ASN.1 modules holds.

    Attributes
    ----------
    vector_name : str, at most 256 octets
    timestamp : Time
    wrenches : tuple[Wrench, ...]
    """

    ASN1_NAME: ClassVar[str] = "Wrenches"
    vector_name: str = ""
    timestamp: Time = field(default_factory=Time)
    wrenches: tuple[Wrench, ...] = field(default_factory=lambda: (Wrench(),) * 1)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "vector_name", check.text(self.vector_name, "Wrenches.vector_name", 256))
        put(self, "timestamp", check.instance(self.timestamp, "Wrenches.timestamp", Time))
        put(
            self,
            "wrenches",
            check.items(self.wrenches, "Wrenches.wrenches", 1, 60, lambda v, w: check.instance(v, w, Wrench)),
        )

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pressure(Message):
    """What a ``Pressure`` of the ASN.1 modules holds.

    Attributes
    ----------
    timestamp : Time
    pascals : float
        Pa.
    """

    ASN1_NAME: ClassVar[str] = "Pressure"
    timestamp: Time = field(default_factory=Time)
    pascals: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "timestamp", check.instance(self.timestamp, "Pressure.timestamp", Time))
        put(self, "pascals", check.real(self.pascals, "Pressure.pascals"))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Temperature(Message):
    """What a ``Temperature`` of the ASN.1 modules holds.

    Attributes
    ----------
    kelvin : float
        K.
    """

    ASN1_NAME: ClassVar[str] = "Temperature"
    kelvin: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "kelvin", check.real(self.kelvin, "Temperature.kelvin"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class IMUSensors(Message):
    """Calibrated inertial measurements in the frame of the sensor.

    Attributes
    ----------
    timestamp : Time
    acc : NDArray[np.float64], shape (3,)
        m/s2, specific force: +9.81 upwards at rest.
    gyro : NDArray[np.float64], shape (3,)
        rad/s.
    mag : NDArray[np.float64], shape (3,)
        uT, or normalised where the sensor says so.
    """

    ASN1_NAME: ClassVar[str] = "IMUSensors"
    timestamp: Time = field(default_factory=Time)
    acc: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    gyro: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    mag: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "timestamp", check.instance(self.timestamp, "IMUSensors.timestamp", Time))
        put(self, "acc", check.real_array(self.acc, "IMUSensors.acc", ((3, 3),)))
        put(self, "gyro", check.real_array(self.gyro, "IMUSensors.gyro", ((3, 3),)))
        put(self, "mag", check.real_array(self.mag, "IMUSensors.mag", ((3, 3),)))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns
