# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/joints.asn by cdff generate; do not edit.

"""Types of ``asn1/joints.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.joints_ext import JointsExt
from cdff_common.types.message import Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointState(Message):
    """Type ``JointState`` of the ASN.1 modules.

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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointLimitRange(Message):
    """Type ``JointLimitRange`` of the ASN.1 modules.

    Attributes
    ----------
    min : JointState
    max : JointState
    """

    ASN1_NAME: ClassVar[str] = "JointLimitRange"
    min: JointState = field(default_factory=JointState)
    max: JointState = field(default_factory=JointState)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class OutOfBounds(Message):
    """Type ``OutOfBounds`` of the ASN.1 modules.

    Attributes
    ----------
    error_name : str, at most 256 bytes
    min : float
    max : float
    value : float
    """

    ASN1_NAME: ClassVar[str] = "OutOfBounds"
    error_name: str = ""
    min: float = 0.0
    max: float = 0.0
    value: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointLimits(Message):
    """Type ``JointLimits`` of the ASN.1 modules.

    Attributes
    ----------
    vector_name : str, at most 256 bytes
    ranges : tuple[JointLimitRange, ...]
    """

    ASN1_NAME: ClassVar[str] = "JointLimits"
    vector_name: str = ""
    ranges: tuple[JointLimitRange, ...] = field(default_factory=lambda: (JointLimitRange(),) * 1)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Joints(JointsExt):
    """Type ``Joints`` of the ASN.1 modules.

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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointTrajectory(Message):
    """Type ``JointTrajectory`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[JointState, ...]
    """

    ASN1_NAME: ClassVar[str] = "JointTrajectory"
    items: tuple[JointState, ...] = field(default_factory=lambda: (JointState(),) * 1)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointsTrajectory(Message):
    """Type ``JointsTrajectory`` of the ASN.1 modules.

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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InvalidTimeStep(Message):
    """Type ``InvalidTimeStep`` of the ASN.1 modules.

    Attributes
    ----------
    time_step : int, 0..4294967295
    """

    ASN1_NAME: ClassVar[str] = "InvalidTimeStep"
    time_step: int = 0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InvalidName(Message):
    """Type ``InvalidName`` of the ASN.1 modules.

    Attributes
    ----------
    name_string : str, at most 256 bytes
    """

    ASN1_NAME: ClassVar[str] = "InvalidName"
    name_string: str = ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Wrench(Message):
    """Type ``Wrench`` of the ASN.1 modules.

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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Wrenches(Message):
    """Type ``Wrenches`` of the ASN.1 modules.

    Attributes
    ----------
    vector_name : str, at most 256 bytes
    timestamp : Time
    wrenches : tuple[Wrench, ...]
    """

    ASN1_NAME: ClassVar[str] = "Wrenches"
    vector_name: str = ""
    timestamp: Time = field(default_factory=Time)
    wrenches: tuple[Wrench, ...] = field(default_factory=lambda: (Wrench(),) * 1)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pressure(Message):
    """Type ``Pressure`` of the ASN.1 modules.

    Attributes
    ----------
    timestamp : Time
    pascals : float
        Pa.
    """

    ASN1_NAME: ClassVar[str] = "Pressure"
    timestamp: Time = field(default_factory=Time)
    pascals: float = 0.0

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Temperature(Message):
    """Type ``Temperature`` of the ASN.1 modules.

    Attributes
    ----------
    kelvin : float
        K.
    """

    ASN1_NAME: ClassVar[str] = "Temperature"
    kelvin: float = 0.0


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
        uT, or normalised if the sensor is specified so.
    """

    ASN1_NAME: ClassVar[str] = "IMUSensors"
    timestamp: Time = field(default_factory=Time)
    acc: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    gyro: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    mag: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns
