# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Times, vectors, matrices and quaternions of ROCK, and the description of a conversion to a type of CDFF.

The value of a compound is a dictionary or a structured scalar of numpy, indexed by the names of its fields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import MAX_STAMP_NS
from cdff_common.contract.foreign_names import frame_name
from cdff_common.types import Time

ROBOT = "robot"
FloatArray = NDArray[np.float64]
#: Value, frame and child frame of a sample.
Converted = tuple[Any, str, str | None]


@dataclass(frozen=True, slots=True)
class Source:
    """Origin of a sample.

    Attributes
    ----------
    task : str
        Name of the ROCK task that wrote the sample.
    stamp_ns : int
        Stamp of the sample.
    order : str
        Byte order of the computer that wrote the sample: ``<`` little-endian, ``>`` big-endian.
    robot : str
        Robot id, the first part of frame names.
    frames : mapping
        Frames of CDFF by their names in ROCK.
    sensor : str
        Frame of the sensor; if empty, it is ``{robot}/{task}``.
    """

    task: str
    stamp_ns: int
    order: str = "<"
    robot: str = ROBOT
    frames: Mapping[str, str] = field(default_factory=dict)
    sensor: str = ""

    @property
    def sensor_frame(self) -> str:
        """Frame of the sensor."""
        return self.sensor or f"{self.robot}/{self.task}"

    @property
    def time(self) -> Time:
        """Stamp of the sample as a CDFF ``Time``."""
        return Time.from_ns(self.stamp_ns)

    def frame(self, name: str) -> str:
        """Return the CDFF frame of a ROCK frame: its entry in ``frames``, otherwise ``{robot}/{name}``."""
        return self.frames.get(name) or frame_name(self.robot, name)


@dataclass(frozen=True, slots=True)
class Conversion:
    """Conversion of a type of ROCK.

    Attributes
    ----------
    type_name : str
        ASN.1 type of the samples.
    convert : callable
        Takes the value of a sample and its source; returns the CDFF value, its frame and child frame.
    fields : tuple of str
        Fields that the value must have.
    optional : tuple of str
        Fields that it can have, and whose content is used, or follows from others. Further fields are listed
        as not converted.
    suffix : str
        Suffix of the name of the stream, where a type has several conversions.
    """

    type_name: str
    convert: Callable[[Any, Source], Converted]
    fields: tuple[str, ...] = ()
    optional: tuple[str, ...] = ("time",)
    suffix: str = ""


def names_of(value: Any) -> tuple[str, ...]:
    """Return the names of the fields of a compound."""
    return tuple(value) if isinstance(value, dict) else (value.dtype.names or ())


def microseconds(time: Any) -> int:
    """Return the microseconds of a ``base::Time``; old versions of the type store seconds and
    microseconds.
    """
    seconds = int(time["seconds"]) if "seconds" in names_of(time) else 0
    return seconds * 1_000_000 + int(time["microseconds"])


def stamp_ns(time: Any) -> int | None:
    """Return the stamp of ``base::Time``; None if it is zero, as unset times are, or out of range."""
    ns = microseconds(time) * 1000
    return ns if ns and abs(ns) <= MAX_STAMP_NS else None


def vector(value: Any) -> FloatArray:
    """Return the numbers of a vector."""
    return np.asarray(value["data"], np.float64)


def matrix(value: Any) -> FloatArray:
    """Return a square matrix; Eigen stores its elements column by column."""
    numbers = vector(value)
    side = round(float(np.sqrt(numbers.size)))
    return numbers.reshape(side, side).T


def dynamic_matrix(value: Any) -> FloatArray:
    """Return a matrix whose size is part of the value."""
    return vector(value).reshape(int(value["cols"]), int(value["rows"])).T


def quaternion_xyzw(value: Any) -> FloatArray:
    """Return a quaternion of Eigen, ``re`` and ``im``, as ``(4,)`` in the order x, y, z, w."""
    return np.append(np.asarray(value["im"], np.float64), float(value["re"]))


def record(
    cls: Any, stamp: str = "", optional: tuple[str, ...] = (), **parts: tuple[str, Callable[[Any], Any]]
) -> Conversion:
    """Return the conversion of a compound whose fields correspond to those of a message.

    Parameters
    ----------
    cls : type
        Message.
    stamp : str
        Field of the message with the stamp of the sample.
    optional : tuple of str
        Fields of the compound whose content follows from others.
    **parts : tuple
        For each field of the message: field of the compound, and the conversion of its value.
    """

    def convert(value: Any, source: Source) -> Converted:
        fields = {target: how(value[name]) for target, (name, how) in parts.items()}
        if stamp:
            fields[stamp] = source.time
        return cls(**fields), source.sensor_frame, None

    names = tuple(name for name, _ in parts.values())
    return Conversion(cls.ASN1_NAME, convert, names, ("time", *optional))


def plain(value: Any) -> Any:
    """Return a decoded value with compounds as dictionaries; numbers in arrays stay arrays."""
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, np.void):
        return {name: plain(value[name]) for name in value.dtype.names or ()}
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.names):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value
