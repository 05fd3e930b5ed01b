# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layouts of the packets of Ouster lidars.

A lidar packet has measurement blocks of one column each, which have a header and, for each channel, some
little-endian words. Sensor Data, firmware 3.x, https://static.ouster.dev/sensor-docs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_dev.logs.formats.pcap.ouster_sensor import OusterSensor

#: Sizes of the header and the footer of a packet, of the NMEA sentence and of a measurement in an IMU packet.
_HEADER_BYTES = _FOOTER_BYTES = 32
_NMEA_BYTES, _IMU_BLOCK_BYTES = 100, 36
#: Size of a legacy IMU packet.
LEGACY_IMU_BYTES = 48
LEGACY = "LEGACY"


class _Bits(NamedTuple):
    """A value in the words of a channel: word, first bit, number of bits, factor."""

    word: int
    first: int
    size: int
    factor: int = 1

    def of(self, words: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return the values of channels (...,) from their words (..., n)."""
        values = (words[..., self.word] >> np.uint32(self.first)) & np.uint32((1 << self.size) - 1)
        return np.asarray(values * np.uint32(self.factor), np.uint32)


class Return(NamedTuple):
    """Fields of one return: range in millimetres, intensity, and the factor of the latter to 16 bits."""

    range_mm: _Bits
    intensity: _Bits
    intensity_factor: int


@dataclass(frozen=True, slots=True)
class _Profile:
    """Number of words of a channel, and its returns; intensities are signal photons where there are any."""

    words: int
    returns: tuple[Return, ...]


def _signal(word: int, first: int, range_bits: _Bits) -> Return:
    return Return(range_bits, _Bits(word, first, 16), 1)


def _reflectivity(word: int, range_bits: _Bits) -> Return:
    return Return(range_bits, _Bits(word, 16, 8), 257)


#: Ranges of 15 bits are in units of 8 mm.
_SHORT, _SHORT_SECOND = _Bits(0, 0, 15, 8), _Bits(1, 0, 15, 8)
_RANGE, _RANGE_SECOND = _Bits(0, 0, 19), _Bits(1, 0, 19)
_SINGLE = (_signal(1, 16, _RANGE),)
_DUAL = (_signal(2, 0, _RANGE), _signal(2, 16, _RANGE_SECOND))
_SHORT_SINGLE = (_reflectivity(0, _SHORT),)
_SHORT_DUAL = (_reflectivity(0, _SHORT), _reflectivity(1, _SHORT_SECOND))
_PROFILES = {
    LEGACY: _Profile(3, (_signal(1, 16, _Bits(0, 0, 20)),)),
    "RNG19_RFL8_SIG16_NIR16": _Profile(3, _SINGLE),
    "RNG19_RFL8_SIG16_NIR16_DUAL": _Profile(4, _DUAL),
    "RNG19_RFL8_SIG16_NIR16_ZONE16": _Profile(3, _SINGLE),
    "RNG19_RFL8_SIG16_ZONE16_DUAL": _Profile(4, _DUAL),
    "RNG19_RFL8_SIG16_NIR16_RGB16": _Profile(4, (_signal(1, 0, _RANGE),)),
    "RNG19_RFL8_SIG16_NIR16_RGB16_DUAL": _Profile(5, _DUAL),
    "RNG15_RFL8_NIR8": _Profile(1, _SHORT_SINGLE),
    "RNG15_RFL8_WIN8": _Profile(1, _SHORT_SINGLE),
    "RNG15_RFL8_NIR8_ZONE16": _Profile(2, _SHORT_SINGLE),
    "RNG15_RFL8_NIR8_DUAL": _Profile(2, _SHORT_DUAL),
    "FUSA_RNG15_RFL8_NIR8_DUAL": _Profile(2, _SHORT_DUAL),
    "FIVE_WORD_PIXEL": _Profile(5, _DUAL),
}


class PacketLayout:
    """Layout of the packets of a sensor.

    Attributes
    ----------
    lidar_bytes, imu_bytes : int
        Sizes of the packets.
    returns : tuple of Return

    Raises
    ------
    InputError
        If the profile is not supported.
    """

    def __init__(self, sensor: OusterSensor) -> None:
        if sensor.profile not in _PROFILES:
            raise InputError(
                f"profile {sensor.profile!r} of the lidar packets, expected one of {', '.join(_PROFILES)}: "
                "convert the capture with the manufacturer's tool (ouster-cli source FILE save FILE.pcd)"
            )
        profile = _PROFILES[sensor.profile]
        self.returns = profile.returns
        self._is_legacy = sensor.profile == LEGACY
        channels = len(sensor.altitude_rad)
        column = [("stamp_ns", "<u8"), ("number", "<u2")]
        words = ("words", "<u4", (channels, profile.words))
        if self._is_legacy:
            fields: list[Any] = [*column, ("frame", "<u2"), ("encoder", "<u4"), words, ("status", "<u4")]
        else:
            fields = [*column, ("status", "<u2"), words]
        self._column = np.dtype(fields)
        header = 0 if self._is_legacy else _HEADER_BYTES
        self._columns = slice(header, header + sensor.columns_per_packet * self._column.itemsize)
        self.lidar_bytes = self._columns.stop + (0 if self._is_legacy else _FOOTER_BYTES)
        self._frame, self._serial = ((4, 8), (11, 16)) if sensor.is_fusa else ((2, 4), (7, 12))
        self._measurements = sensor.imu_measurements_per_packet
        block = _HEADER_BYTES + _NMEA_BYTES + self._measurements * _IMU_BLOCK_BYTES + _FOOTER_BYTES
        self.imu_bytes = block if self._measurements else LEGACY_IMU_BYTES

    def frame_id(self, packet: bytes) -> int:
        """Return the number of the sweep of a lidar packet, which is 0 again after the largest one."""
        begin, end = (10, 12) if self._is_legacy else self._frame
        return int.from_bytes(packet[begin:end], "little")

    def serial(self, packet: bytes) -> int:
        """Return the serial number of the sensor; 0 for legacy packets, which have none."""
        begin, end = self._serial
        return 0 if self._is_legacy else int.from_bytes(packet[begin:end], "little")

    def columns(self, packets: bytes) -> NDArray[Any]:
        """Return the valid columns of lidar packets: an array with ``stamp_ns``, ``number``, ``words``."""
        rows = np.frombuffer(packets, np.uint8).reshape(-1, self.lidar_bytes)[:, self._columns]
        columns: NDArray[Any] = np.ascontiguousarray(rows).view(self._column).ravel()
        return np.asarray(columns[(columns["status"] & 1) == 1])

    def imu(self, packet: bytes) -> NDArray[np.float64]:
        """Return the valid measurements of an IMU packet.

        Returns
        -------
        array, shape (n, 7)
            Time of the sensor in nanoseconds, acceleration in g, angular rate in degrees per second. The
            float64 of a time since 1970 is exact to 256 ns.
        """
        if not self._measurements:
            times_ns = np.frombuffer(packet, "<u8", 3)
            # The readings of the accelerometer and of the gyroscope have a time each.
            return np.array([[float(times_ns[1]), *np.frombuffer(packet, "<f4", 6, 24)]])
        block = np.dtype([("stamp_ns", "<u8"), ("number", "<u2"), ("status", "<u2"), ("values", "<f4", 6)])
        measurements = np.frombuffer(packet, block, self._measurements, _HEADER_BYTES + _NMEA_BYTES)
        measurements = measurements[(measurements["status"] & 1) == 1]
        return np.column_stack([measurements["stamp_ns"].astype(np.float64), measurements["values"]])
