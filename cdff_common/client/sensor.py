# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver kit: publication of the samples of a sensor."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass, fields, replace
from types import TracebackType
from typing import Any, Literal, Self

from cdff_common.bus import Bus, Qos, keys
from cdff_common.client.sample_queue import EncodedSample, SampleQueue
from cdff_common.client.sensor_modes import ActiveMode, OnMode, SensorModes
from cdff_common.client.stamp_monitor import ClockLimits, StampFault, StampMonitor
from cdff_common.clock import NS_PER_S, monotonic_s
from cdff_common.codecs import encode_payload
from cdff_common.errors import ConflictError, InputError
from cdff_common.geometry import checked_frame
from cdff_common.interfaces.product import Header, Quality, Status, product_id
from cdff_common.mission_clock import ClockState
from cdff_common.types.message import CapturedMessage, Message
from cdff_common.types.time import Time

logger = logging.getLogger(__name__)

#: Time in which the first tick of the mission clock is expected, seconds: ticks have at least 10 Hz.
_FIRST_TICK_S = 0.3
#: Time in which the token of an ended driver disappears, seconds.
_VACANT_S = 3.0
#: Time for which waiting samples are sent when a driver ends, seconds.
_FLUSH_S = 1.0
#: Time between two log messages about stamps, seconds.
_REPORT_S = 10.0
#: Fields that hold the time of a message.
_TIMES = ("timestamp", "ref_time", "time_stamp")

OnClockFault = Literal["refuse", "report"]


@dataclass(frozen=True, slots=True)
class SensorStatus:
    """Counters of a sensor since its start.

    Attributes
    ----------
    sent : int
        Samples that were sent.
    dropped : int
        Samples that were dropped because the link was busy.
    withheld : int
        Samples that were not sent because the sensor is off.
    clock_faults : int
        Samples with a fault of their stamp.
    last_fault : StampFault or None
        The last of these faults.
    mode : ActiveMode
        Mode that the instrument control unit set.
    """

    sent: int
    dropped: int
    withheld: int
    clock_faults: int
    last_fault: StampFault | None
    mode: ActiveMode


class Sensor:
    """A stream of a sensor of a robot; a context manager::

        with Sensor("lidar/scan", LidarScan, frame="mana/lidar") as lidar:
            while True:
                points_m, offsets_us, t0_ns, t1_ns = device.read()
                times = {"t0_ns": t0_ns, "t1_ns": t1_ns}
                scan = LidarScan.from_arrays(points_m, offsets_us, frame=lidar.frame, **times)
                lidar.publish(scan)

    Parameters
    ----------
    stream : str
        ``sensor/stream`` as in the profile.
    message_type : type
        Type of the samples, of ``cdff_common.types``.
    frame : str
        Frame of the samples, such as ``mana/lidar``; for a pose the parent.
    child : str, optional
        For a pose the child frame.
    robot : str, optional
        Robot id; by default the first part of ``frame``.
    connect : str, optional
        Endpoint of the router; default ``CDFF_CONNECT``, then ``tcp/127.0.0.1:7447``.
    bus : Bus, optional
        Connection of another sensor of the same process (``other.bus``), which is used and not closed.
    on_mode : callable, optional
        Called with each mode that the instrument control unit sets, the first one included. If it raises, the
        unit marks the sensor as lost.
    on_clock_fault : str
        Treatment of a sample whose stamp is not after the previous one, ahead of mission time, or late:
        ``refuse`` (default) does not send it, ``report`` sends it with quality DEGRADED and the reason. Both
        count it in ``status`` and write a warning to the log.
    limits : ClockLimits
    queue : int
        Largest number of samples that wait for a busy link; with more the oldest is dropped and counted.
    codec : str
        Encoding of the samples: ``uper``, or ``msgpack``, which takes less time for large arrays.

    Raises
    ------
    InputError
        If a name, frame or type is wrong.
    ConflictError
        If another process publishes this stream.
    UnavailableError
        If no router answers within 5 s.
    """

    def __init__(
        self,
        stream: str,
        message_type: type[Message],
        *,
        frame: str,
        child: str | None = None,
        robot: str | None = None,
        connect: str | None = None,
        bus: Bus | None = None,
        on_mode: OnMode | None = None,
        on_clock_fault: OnClockFault = "refuse",
        limits: ClockLimits | None = None,
        queue: int = 8,
        codec: Literal["uper", "msgpack"] = "uper",
    ) -> None:
        sensor, separator, item = stream.partition("/")
        if not separator:
            raise InputError(f"stream {stream!r}: expected sensor/stream, such as lidar/scan")
        if not (isinstance(message_type, type) and issubclass(message_type, Message)):
            raise InputError(
                f"type {message_type!r}: expected a class of cdff_common.types, such as LidarScan"
            )
        if on_clock_fault not in ("refuse", "report"):
            raise InputError(f"on_clock_fault={on_clock_fault!r}: expected refuse or report")
        if queue < 1:
            raise InputError(f"queue={queue}: expected at least 1")
        if codec not in ("uper", "msgpack"):
            raise InputError(f"codec={codec!r}: expected uper or msgpack")
        self.frame, self.child = (
            checked_frame(frame),
            None if child is None else checked_frame(child, "child"),
        )
        self.robot = robot or frame.partition("/")[0]
        self.name, self.stream = sensor, item
        self._key = keys.sensor(self.robot, sensor, item)
        self._type = message_type
        self._on_clock_fault, self._codec = on_clock_fault, codec
        self._monitor = StampMonitor(limits)
        self._lock = threading.Lock()
        self._seq = self._withheld = self._clock_faults = 0
        self._acquired = (0, 0)  # number of the last acquisition, and of its samples
        self._last_fault: StampFault | None = None
        self._reported_s = -_REPORT_S
        self._owns_bus = bus is None
        self.bus = bus or Bus.open(connect, name=f"sensor {sensor}")
        try:
            self._claim()
        except ConflictError:
            if self._owns_bus:
                self.bus.close()
            raise
        self._clock = self.bus.mission_clock
        self._await_clock()
        self._queue = SampleQueue(f"{self.robot}/{stream}", queue, self._send)
        self._modes = SensorModes(self.bus, self.robot, sensor, on_mode)
        self.bus.declare_alive(self.robot, self._service)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Send the waiting samples, and close the connection if it is this sensor's own."""
        self._queue.close(_FLUSH_S)
        self._modes.close()
        if self._owns_bus:
            self.bus.close()

    def now_ns(self) -> int:
        """Return mission time, nanoseconds: the stamp of a device without a clock of its own."""
        return self._clock.now_ns()

    @property
    def mode(self) -> ActiveMode:
        """Mode that the instrument control unit set."""
        return self._modes.current

    @property
    def status(self) -> SensorStatus:
        """Counters of this sensor."""
        return SensorStatus(
            self._queue.sent,
            self._queue.dropped,
            self._withheld,
            self._clock_faults,
            self._last_fault,
            self._modes.current,
        )

    def publish(self, value: Message, stamp_ns: int | None = None, *, quality: Quality | None = None) -> bool:
        """Publish a sample; the call does not wait for the link.

        Parameters
        ----------
        value : Message
            A sample of the type of this sensor. Its own frames, if any, must be those of this sensor.
        stamp_ns : int, optional
            Time of capture, its end for a sweep; by default that of the value. It is rounded down to 1 µs.
            If the value has the time 0, it receives this one.
        quality : Quality, optional
            Quality that the device states; by default OK.

        Returns
        -------
        bool
            False if the sample is not sent: the sensor is off, or the stamp is refused.

        Raises
        ------
        InputError
            If the type or a frame is wrong, or the time of the value differs from ``stamp_ns``.
        CodecError
            If the value cannot be encoded.
        """
        value, t0_ns, t1_ns = self._value_with_times(value, stamp_ns)
        self._check_frames(value)
        with self._lock:
            mode = self._modes.current
            if not mode.on or not self._is_acquired(mode):
                self._withheld += 1
                return False
            fault = self._stamp_fault(t1_ns)
            if fault is not None and self._on_clock_fault == "refuse":
                return False
            header = Header(
                id=product_id(self.robot, self.name, self.stream, t1_ns, self._seq, ""),
                seq=self._seq,
                t0_ns=t0_ns,
                t1_ns=t1_ns,
                frame=self.frame,
                child=self.child,
                producer=self.name,
                quality=_with_fault(quality or Quality(), fault),
            )
            payload, encoding = encode_payload(value, self._codec)
            self._seq += 1
            self._queue.put(EncodedSample(payload, encoding, header.to_attachment()))
        return True

    def _is_acquired(self, mode: ActiveMode) -> bool:
        """Return True if a sample is sent: in a mode for single acquisitions only its first samples are."""
        if mode.acquires is None:
            return True
        number, count = self._acquired
        count = count if number == mode.acquisition else 0
        self._acquired = (mode.acquisition, count + 1)
        return count < mode.acquires

    def report_lost(self, reason: str) -> None:
        """Report to the instrument control unit that the device does not work: plans use other sensors."""
        self._modes.report(reason or "unknown reason")

    def report_recovered(self) -> None:
        """Report to the instrument control unit that the device works again, in its initial mode."""
        self._modes.report("")

    @property
    def _service(self) -> str:
        return f"sensor_{self.name}_{self.stream}"

    def _claim(self) -> None:
        """Raise ConflictError if another process publishes this stream."""
        token, until_s = keys.alive(self.robot, self._service), monotonic_s() + _VACANT_S
        while self.bus.alive(token):
            if monotonic_s() > until_s:
                raise ConflictError(
                    f"{self.robot}: another process publishes {self.name}/{self.stream}; end it first"
                )
            time.sleep(0.1)

    def _await_clock(self) -> None:
        """Wait for the first tick, so that the wall clock is not taken for mission time."""
        until_s = monotonic_s() + _FIRST_TICK_S
        while self._clock.state is ClockState.WALL and monotonic_s() < until_s:
            time.sleep(0.02)

    def _value_with_times(self, value: Message, stamp_ns: int | None) -> tuple[Message, int, int]:
        """Return the value with its time, and the start and end of its capture."""
        if not isinstance(value, self._type):
            raise InputError(
                f"{self.name}/{self.stream}: got a {type(value).__name__}, expected {self._type.__name__}"
            )
        own_ns = int(getattr(value, "stamp_ns", 0))
        end_ns = own_ns if stamp_ns is None else int(stamp_ns) // 1000 * 1000
        if end_ns == 0:
            raise InputError(
                f"{self.name}/{self.stream}: no stamp; expected stamp_ns=, or a value with a time"
            )
        if not hasattr(value, "stamp_ns"):  # its type has no time; the header of the sample has it
            return value, end_ns, end_ns
        if own_ns == 0:
            return _with_time(value, end_ns), end_ns, end_ns
        if own_ns != end_ns:
            raise InputError(
                f"{self.name}/{self.stream}: stamp_ns={end_ns}, but the value has {own_ns} "
                f"({(own_ns - end_ns) / NS_PER_S:.6f} s later): expected one time of capture"
            )
        return value, value.t0_ns if isinstance(value, CapturedMessage) else end_ns, end_ns

    def _check_frames(self, value: Any) -> None:
        """Raise InputError if the frames in a value are not those of the sensor."""
        frames = (
            ("frame", getattr(value, "frame", ""), self.frame),
            ("parent frame", getattr(value, "parent_frame", ""), self.frame),
            ("child frame", getattr(value, "child_frame", ""), self.child or ""),
        )
        for name, frame_of_value, frame_of_sensor in frames:
            if frame_of_value and frame_of_value != frame_of_sensor:
                raise InputError(
                    f"{self.name}/{self.stream}: {name} {frame_of_value!r} in the value, expected "
                    f"{frame_of_sensor!r} of this sensor"
                )

    def _stamp_fault(self, stamp_ns: int) -> StampFault | None:
        """Return the fault of a stamp, counted and logged; None if it has none."""
        fault = self._monitor.fault(stamp_ns, self._clock.now_ns(), self._clock.jumped_s)
        if fault is not None:
            self._clock_faults, self._last_fault = self._clock_faults + 1, fault
            if monotonic_s() - self._reported_s > _REPORT_S:
                self._reported_s = monotonic_s()
                logger.warning(
                    "%s/%s/%s: %s (%d such samples)",
                    self.robot,
                    self.name,
                    self.stream,
                    fault,
                    self._clock_faults,
                )
        return fault

    def _send(self, sample: EncodedSample) -> None:
        self.bus.publish(
            self._key,
            sample.payload,
            encoding=sample.encoding,
            attachment=sample.attachment,
            qos=Qos.STREAM,
        )


def _with_fault(quality: Quality, fault: StampFault | None) -> Quality:
    """Return the quality with the reason of a fault of the stamp."""
    if fault is None:
        return quality
    status = Status.FAILED if quality.status is Status.FAILED else Status.DEGRADED
    return replace(quality, status=status, reasons=(*quality.reasons, fault.reason))


def _with_time(value: Message, stamp_ns: int) -> Message:
    """Return a message with its time set; raises InputError if its time is not a field of its own."""
    name = next((f.name for f in fields(value) if f.name in _TIMES), None)  # type: ignore[arg-type]
    if name is None:
        raise InputError(
            f"{type(value).__name__}: its time is 0; expected the time of capture, set by its constructor"
        )
    return replace(value, **{name: Time.from_ns(stamp_ns)})  # type: ignore[type-var]
