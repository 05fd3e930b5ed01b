# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sources of the robot that become samples of sensors on the bus: limits, counters and checks."""

from __future__ import annotations

import logging
import struct
from typing import Any

import numpy as np

from cdff_common import types
from cdff_common.bus import Bus
from cdff_common.client import Sensor
from cdff_common.clock import monotonic_s, wall_ns
from cdff_common.codecs.bitstream import unwrap
from cdff_common.errors import InputError
from cdff_common.types import Asn1Bitstream, TransformWithCovariance
from services.gateways.counters import RateLimit, TopicCounters
from services.gateways.stream_settings import InputStream

logger = logging.getLogger(__name__)

#: Errors of conversions for damaged messages; MemoryError for stated lengths that no message has.
CONVERSION_ERRORS = (
    ArithmeticError,
    AssertionError,
    LookupError,
    MemoryError,
    TypeError,
    ValueError,
    struct.error,
)


class SampleLink:
    """A source of the robot and the sensor stream that it becomes.

    Parameters
    ----------
    entry : InputStream
    name : str
        Name of the source in messages of the log.
    type_name : str
        ASN.1 type of the samples.
    robot : str
    bus : Bus
        Bus of the samples.
    """

    def __init__(self, entry: InputStream, name: str, type_name: str, robot: str, bus: Bus) -> None:
        self.name, self.counters = name, TopicCounters()
        self._rate, self._max_hz, self._max_bytes = RateLimit(entry.max_hz), entry.max_hz, entry.max_bytes
        self._frames, self._holds = (entry.frame, entry.child), entry.holds
        self.sensor = Sensor(
            entry.stream,
            getattr(types, entry.holds or type_name),
            frame=entry.frame,
            child=entry.child,
            robot=robot,
            bus=bus,
            on_clock_fault=entry.on_clock_fault,
            codec=entry.codec,
        )

    def close(self) -> None:
        """Send the waiting samples."""
        self.sensor.close()

    def admits(self, size: int, start_s: float) -> bool:
        """Count a message of a number of bytes; return False if it exceeds the limits, and is dropped."""
        self.counters.receive(size)
        if not self._rate.admits(start_s):
            self.drop("rate", f"more than {self._max_hz:g} messages per second")
            return False
        return self.fits(size)

    def fits(self, size: int) -> bool:
        """Return whether a message has at most the allowed bytes; one with more is counted as dropped."""
        if size > self._max_bytes:
            self.drop("size", f"{size} bytes, expected at most {self._max_bytes}")
            return False
        return True

    def send(self, value: Any, frames: tuple[str, str | None], stamp_ns: int, start_s: float) -> None:
        """Send a value that was made from a message that arrived at a monotonic time.

        Raises
        ------
        InputError
            If a pose is not finite, the frames are not those of the entry, or a bitstream has another type
            than the entry.
        CodecError
            If the content of a bitstream is malformed.
        """
        if self._holds is not None:
            value = self._content(value)
            stamp_ns = getattr(value, "stamp_ns", 0) or stamp_ns
        if isinstance(value, TransformWithCovariance):
            numbers = (value.data.translation, value.data.orientation)
            if not all(np.isfinite(part).all() for part in numbers):
                raise InputError("pose that is not finite")
        if frames != self._frames:
            raise InputError(
                f"frames {frames[0]} and {frames[1]}: expected {self._frames[0]} and {self._frames[1]}; "
                "see frames in the settings"
            )
        self.counters.age(1e-9 * (wall_ns() - stamp_ns))
        own_ns = getattr(value, "stamp_ns", 0)
        is_sent = self.sensor.publish(value) if own_ns else self.sensor.publish(value, stamp_ns)
        if is_sent:
            self.counters.forward(monotonic_s() - start_s)
        else:
            fault = self.sensor.status.last_fault
            is_off = not self.sensor.mode.on
            self.drop("sensor_off" if is_off else "clock", "sensor is off" if is_off else str(fault))

    def _content(self, value: Any) -> Any:
        """Return the content of a bitstream."""
        content = unwrap(value) if isinstance(value, Asn1Bitstream) else value
        if not isinstance(content, getattr(types, self._holds or "")):
            raise InputError(f"a {type(content).__name__}: expected a bitstream that holds {self._holds}")
        return content

    def drop(self, reason: str, detail: str) -> None:
        """Count a message that does not become a sample, and log the first with a reason."""
        if self.counters.drop(reason, detail):
            logger.warning("%s: dropped (%s): %s", self.name, reason, detail)
