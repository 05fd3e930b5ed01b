# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metadata of an Ouster lidar, as its HTTP interface and the manufacturer's tools write it.

Both layouts are read: one level, and the sections ``beam_intrinsics``, ``lidar_data_format``, ….
https://static.ouster.dev/sensor-docs (Sensor Data, Coordinate Frames and XYZ Calculation).
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import CodecError
from cdff_common.geometry.se3 import FloatArray

#: Largest metadata file of a sensor.
_MAX_BYTES = 1 << 22
_SECTIONS = (
    "beam_intrinsics",
    "lidar_intrinsics",
    "imu_intrinsics",
    "sensor_info",
    "config_params",
)
_FORMAT_SECTIONS = ("data_format", "lidar_data_format")
_BEAMS = ("beam_altitude_angles", "beam_azimuth_angles")
_MODE = re.compile(r"(\d{3,4})x\d{1,2}$")
#: Channels and columns of the packets of firmware before 2.0, which does not state them.
_LEGACY = {"pixels_per_column": 64, "columns_per_packet": 16, "udp_profile_lidar": "LEGACY"}
#: Distance between the axis of the lidar and the origin of its beams, mm, by product, where it is not stated.
_BEAM_ORIGINS_MM = {"OS-0-": 27.67, "OS-1-": 15.806, "OS-2-": 13.762}
#: Distance for products that are not listed, and the pose of the lidar in the sensor, row by row, mm.
_BEAM_ORIGIN_MM = 12.163
_LIDAR_TO_SENSOR = (-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1)
#: Limits of damaged metadata: numbers of beams and of columns, and magnitude of a number.
_MAX_BEAMS, _MAX_COLUMNS = 512, 8192
_MAX_NUMBER = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class OusterSensor:
    """Geometry and packet format of an Ouster lidar.

    Attributes
    ----------
    altitude_rad, azimuth_rad : array, shape (h,)
        Angles of the beams.
    T_lidar_beam_mm : array, shape (4, 4)
        Pose of the origin of the beams relative to the lidar frame at encoder angle 0.
    T_sensor_lidar_mm : array, shape (4, 4)
        Pose of the lidar frame in the sensor frame (x forward, z up).
    R_sensor_imu : array, shape (3, 3)
    columns_per_frame, columns_per_packet : int
    column_window : tuple of int
        First and last column that the sensor sends; the first may be larger than the last.
    profile : str
        Profile of the lidar packets, such as ``RNG19_RFL8_SIG16_NIR16``.
    is_fusa : bool
        Whether the packet headers are those for functional safety.
    imu_measurements_per_packet : int
        0 for the legacy packets, which have one.
    lidar_port, imu_port : int
        Destinations of the packets; 0 if unknown.
    serial : int
        Serial number; 0 if unknown.
    """

    altitude_rad: FloatArray
    azimuth_rad: FloatArray
    T_lidar_beam_mm: FloatArray
    T_sensor_lidar_mm: FloatArray
    R_sensor_imu: FloatArray
    columns_per_frame: int
    columns_per_packet: int
    column_window: tuple[int, int]
    profile: str
    is_fusa: bool
    imu_measurements_per_packet: int
    lidar_port: int
    imu_port: int
    serial: int

    @property
    def columns_in_window(self) -> int:
        """Number of columns of a sweep that the sensor sends."""
        first, last = self.column_window
        return (last - first) % self.columns_per_frame + 1


def is_metadata(path: Path) -> bool:
    """Return whether a file is the metadata of an Ouster lidar."""
    if not path.is_file() or path.stat().st_size > _MAX_BYTES:
        return False
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return False
    if not isinstance(content, dict):
        return False
    inner = content.get("beam_intrinsics")
    return any(_BEAMS[0] in part for part in (content, inner) if isinstance(part, dict))


def read_metadata(path: Path) -> OusterSensor:
    """Read the metadata of an Ouster lidar.

    Raises
    ------
    CodecError
        With the name of the file, if a value is missing or impossible.
    """
    try:
        return _sensor(_Values(path))
    except (TypeError, ValueError, KeyError, OverflowError, RecursionError) as error:
        raise CodecError(
            f"{path}: {error}; expected the metadata of an Ouster lidar, as "
            "http://SENSOR/api/v1/sensor/metadata gives it"
        ) from error


class _Values:
    """Values of a metadata file, in either layout."""

    def __init__(self, path: Path) -> None:
        content = json.loads(path.read_bytes())
        if not isinstance(content, dict):
            raise ValueError("no names")
        sections = [content.get(name) for name in _SECTIONS]
        formats = [content.get(name) for name in _FORMAT_SECTIONS]
        self._parts = [part for part in (content, *sections) if isinstance(part, dict)]
        self.format: dict[str, Any] = next((part for part in formats if isinstance(part, dict)), {})

    def get(self, name: str, default: Any) -> Any:
        return next((part[name] for part in self._parts if part.get(name) is not None), default)

    def array(self, name: str, default: Any, shape: tuple[int, ...]) -> FloatArray:
        values = np.array(self.get(name, default), dtype=np.float64)
        if values.size != np.prod(shape) or not (np.abs(values) < _MAX_NUMBER).all():
            expected = f"expected {np.prod(shape)}, each below {_MAX_NUMBER:.0e}"
            raise ValueError(f"{name}: {values.size} numbers, {expected}")
        return values.reshape(shape)

    def count(self, name: str, default: Any, largest: int) -> int:
        value = self.format.get(name, default)
        if not isinstance(value, int) or not 1 <= value <= largest:
            raise ValueError(f"{name}: {value!r}, expected 1 to {largest}")
        return value


def _sensor(values: _Values) -> OusterSensor:
    """Return the sensor of checked metadata; raises ValueError."""
    mode = _MODE.match(str(values.get("lidar_mode", "")))
    columns = values.count("columns_per_frame", int(mode[1]) if mode else None, _MAX_COLUMNS)
    beams = values.count("pixels_per_column", _LEGACY["pixels_per_column"], _MAX_BEAMS)
    window = values.format.get("column_window", [0, columns - 1])
    if len(window) != 2 or not all(isinstance(c, int) and 0 <= c < columns for c in window):
        raise ValueError(f"column_window: {window}, expected two columns below {columns}")
    altitude_deg, azimuth_deg = (values.array(name, (), (beams,)) for name in _BEAMS)
    product = str(values.get("prod_line", ""))
    origin_mm = next(
        (mm for name, mm in _BEAM_ORIGINS_MM.items() if product.startswith(name)), _BEAM_ORIGIN_MM
    )
    T_lidar_beam_mm = np.eye(4)
    T_lidar_beam_mm[0, 3] = values.array("lidar_origin_to_beam_origin_mm", origin_mm, ()).item()
    return OusterSensor(
        altitude_rad=np.radians(altitude_deg),
        azimuth_rad=np.radians(azimuth_deg),
        T_lidar_beam_mm=values.array("beam_to_lidar_transform", T_lidar_beam_mm, (4, 4)),
        T_sensor_lidar_mm=values.array("lidar_to_sensor_transform", _LIDAR_TO_SENSOR, (4, 4)),
        R_sensor_imu=values.array("imu_to_sensor_transform", np.eye(4), (4, 4))[:3, :3],
        columns_per_frame=columns,
        columns_per_packet=values.count("columns_per_packet", _LEGACY["columns_per_packet"], columns),
        column_window=(window[0], window[1]),
        profile=str(values.format.get("udp_profile_lidar", _LEGACY["udp_profile_lidar"])),
        is_fusa=values.format.get("header_type") == "FUSA",
        imu_measurements_per_packet=_imu_measurements(values.format),
        lidar_port=_positive(values.get("udp_port_lidar", 0)),
        imu_port=_positive(values.get("udp_port_imu", 0)),
        serial=_positive(values.get("prod_sn", 0)),
    )


def _imu_measurements(form: dict[str, Any]) -> int:
    if form.get("udp_profile_imu", "LEGACY") == "LEGACY":
        return 0
    count = form.get("imu_measurements_per_packet", 0)
    if not isinstance(count, int) or not 1 <= count <= 1000:
        raise ValueError(f"imu_measurements_per_packet: {count!r}, expected 1 to 1000")
    return count


def _positive(value: Any) -> int:
    """Return a number that may be written as text; 0 if it is not one."""
    text = str(value)
    return int(text) if text.isdecimal() and len(text) < 16 else 0
