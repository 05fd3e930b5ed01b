# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points of an Ouster lidar from ranges and columns.

Sensor Data, Coordinate Frames and XYZ Calculation, https://static.ouster.dev/sensor-docs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.formats.pcap.ouster_packets import Return
from cdff_dev.logs.formats.pcap.ouster_sensor import OusterSensor

_M_PER_MM = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points in the order of their times.

    Attributes
    ----------
    points_m : array, shape (n, 3), float32
        In the sensor frame.
    stamps_ns : array, shape (n,), int64
        Time of the sensor.
    intensity, ring : array, shape (n,), uint16
    """

    points_m: NDArray[np.float32]
    stamps_ns: NDArray[np.int64]
    intensity: NDArray[np.uint16]
    ring: NDArray[np.uint16]


class RayTable:
    """Direction and origin of each beam at each column, in the sensor frame.

    A range r, measured from the origin of the beam, is the point r·direction + offset.
    """

    def __init__(self, sensor: OusterSensor) -> None:
        width = sensor.columns_per_frame
        encoder = 2.0 * np.pi * (1.0 - np.arange(width) / width)[:, None]
        azimuth, altitude = encoder - sensor.azimuth_rad, sensor.altitude_rad + 0.0 * encoder
        direction = np.stack(
            [np.cos(azimuth) * np.cos(altitude), np.sin(azimuth) * np.cos(altitude), np.sin(altitude)], axis=2
        )
        radius_mm, height_mm = sensor.T_lidar_beam_mm[[0, 2], 3]
        origin_mm = np.stack(
            [radius_mm * np.cos(encoder), radius_mm * np.sin(encoder), np.full_like(encoder, height_mm)],
            axis=2,
        )
        # The range is the path from the axis: it has the distance to the origin of the beam in it.
        offset_mm = origin_mm - np.hypot(radius_mm, height_mm) * direction
        T = sensor.T_sensor_lidar_mm
        self._direction: FloatArray = direction @ T[:3, :3].T
        self._offset_mm: FloatArray = offset_mm @ T[:3, :3].T + T[:3, 3]

    def points(self, columns: NDArray[Any], returns: Sequence[Return]) -> Points:
        """Return the points of columns with a number in the sweep; ranges of 0 are no points."""
        columns = columns[columns["number"] < len(self._direction)]
        columns = columns[np.argsort(columns["stamp_ns"], kind="stable")]
        words = columns["words"]
        range_mm = np.stack([echo.range_mm.of(words) for echo in returns], axis=2)
        intensity = np.stack(
            [echo.intensity.of(words) * np.uint32(echo.intensity_factor) for echo in returns], axis=2
        )
        column, ring, number = np.nonzero(range_mm)
        at = columns["number"][column], ring
        points_mm = range_mm[column, ring, number, None] * self._direction[at] + self._offset_mm[at]
        return Points(
            points_m=(_M_PER_MM * points_mm).astype(np.float32),
            stamps_ns=columns["stamp_ns"].astype(np.int64)[column],
            intensity=intensity[column, ring, number].astype(np.uint16),
            ring=ring.astype(np.uint16),
        )
