# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ranges and clouds, as defined by the headers of ``base/samples`` of ROCK.

The frame of a sensor has x forward, y left and z up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types import DistanceImage, LidarScan, Pointcloud
from services.rock_types.values import (
    Conversion,
    Converted,
    FloatArray,
    Source,
    record,
    stamp_ns,
)

#: Smallest range of a laser scan in millimetres that is not an error code.
_FIRST_RANGE_MM = 6
_MAX_OFFSET_US = np.iinfo(np.uint32).max
_MAX_INTENSITY = 65535.0


def _laser_scan(value: Any, source: Source) -> Converted:
    """Return the valid points of a laser scan in the plane z = 0 with their times.

    The time of a laser scan is that at which the mirror points backwards (angle -pi, or pi if it turns
    clockwise), from where it turns with ``speed``; without a speed all points have that time. The remission
    has no unit in ROCK: it is rounded and limited to 16 bits.
    """
    ranges_mm = np.asarray(value["ranges"], np.float64)
    angles = float(value["start_angle"]) + float(value["angular_resolution"]) * np.arange(len(ranges_mm))
    limits_mm = max(int(value["minRange"]), _FIRST_RANGE_MM), int(value["maxRange"])
    valid = (ranges_mm >= limits_mm[0]) & (ranges_mm <= limits_mm[1])
    points_m = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    points_m *= ranges_mm[:, None] / 1000.0
    speed = float(value["speed"])
    offsets_s = (np.pi * np.sign(speed) + angles) / speed if speed else np.zeros(len(angles))
    remission = np.asarray(value["remission"], np.float64)
    intensity = remission[valid] if len(remission) == len(ranges_mm) else None
    return _scan(points_m[valid], offsets_s[valid], source, source.stamp_ns, intensity=intensity)


def _depth_map(value: Any, source: Source) -> Converted:
    """Return the valid points of a depth map with their times; the ring of a point is its row.

    A measurement is along the x axis, rotated about y by the angle of its row, then about z by the angle of
    its column. Planar intervals are tangents of angles, those of columns to the right. Remissions between 0
    and 1, as drivers of ROCK give, become 16 bits.
    """
    rows, cols = int(value["vertical_size"]), int(value["horizontal_size"])
    distances_m = np.asarray(value["distances"], np.float64)
    if distances_m.size != rows * cols:
        raise InputError(f"{distances_m.size} distances: expected {rows} x {cols}")
    if not distances_m.size:
        return _scan(np.zeros((0, 3)), np.zeros(0), source, source.stamp_ns)
    vertical = _angles(value["vertical_interval"], value["vertical_projection"], rows, is_vertical=True)
    horizontal = _angles(
        value["horizontal_interval"], value["horizontal_projection"], cols, is_vertical=False
    )
    valid = np.flatnonzero(np.isfinite(distances_m) & (distances_m > 0.0))
    row, col = np.divmod(valid, cols)
    level = np.cos(vertical[row])
    directions = [level * np.cos(horizontal[col]), level * np.sin(horizontal[col]), -np.sin(vertical[row])]
    points_m = np.stack(directions, axis=1) * distances_m[valid, None]
    start_ns, offsets_s = _depth_map_times(value["timestamps"], rows, cols, source)
    remissions = np.asarray(value["remissions"], np.float64)
    intensity = _MAX_INTENSITY * remissions[valid] if remissions.size == distances_m.size else None
    return _scan(points_m, offsets_s[valid], source, start_ns, intensity=intensity, ring=row)


def _angles(interval: Any, projection: str, count: int, *, is_vertical: bool) -> FloatArray:
    """Return the angles of rows, downwards, or of columns, to the left."""
    values = np.asarray(interval, np.float64)
    if projection not in ("POLAR", "PLANAR") or values.size not in (0, 1, 2, count):
        raise InputError(
            f"{projection} interval of {values.size} values: expected POLAR or PLANAR of up to 2 or {count}"
        )
    if values.size < 2:
        values = np.full(count, values[0] if values.size else 0.0)
        return values if projection == "POLAR" else np.arctan(values)
    is_planar = projection == "PLANAR"
    to_left = -1.0 if not is_vertical else 1.0
    if values.size == 2:
        first, last = values
        span = last - first if is_planar else abs((last - first + np.pi) % (2.0 * np.pi) - np.pi)
        if not is_planar and first == last:
            span = 2.0 * np.pi
        steps = span / max(count - 1, 1) * np.arange(count)
        values = first + (steps if is_planar else to_left * steps)
    return np.arctan(to_left * values) if is_planar else values


def _depth_map_times(times: Any, rows: int, cols: int, source: Source) -> tuple[int, FloatArray]:
    """Return the start of the sweep, and the time of each measurement after it in seconds.

    Raises
    ------
    InputError
        If there is not one time for all, for each row, column or measurement, or two between which the rows
        are interpolated, as ROCK does by default.
    """
    count = len(times)
    if count == 0:
        return source.stamp_ns, np.zeros(rows * cols)
    stamps = np.array([stamp_ns(time) or source.stamp_ns for time in times], np.int64)
    start_ns = int(stamps.min())
    offsets_s = np.asarray((stamps - start_ns) * 1e-9, np.float64)
    if count == rows * cols:
        return start_ns, offsets_s
    if count == 2:
        count = rows if rows > 1 else cols
        offsets_s = np.interp(np.linspace(0.0, 1.0, count), [0.0, 1.0], offsets_s)
    if count in (1, rows):
        return start_ns, np.repeat(np.broadcast_to(offsets_s, rows), cols)
    if count != cols:
        raise InputError(f"{count} times for {rows} x {cols} distances: expected 1, 2, or one for each")
    return start_ns, np.tile(offsets_s, rows)


def _scan(
    points_m: FloatArray,
    offsets_s: FloatArray,
    source: Source,
    start_ns: int,
    intensity: FloatArray | None = None,
    ring: NDArray[Any] | None = None,
) -> Converted:
    """Return the scan of points (n, 3) with times (n,) after its start, seconds; raises InputError."""
    offsets_us = np.round(offsets_s * 1e6)
    if offsets_us.size and not 0 <= offsets_us.min() <= offsets_us.max() <= _MAX_OFFSET_US:
        raise InputError(
            f"times {offsets_s.min()} to {offsets_s.max()} s after the start: expected 0 to 4294 s"
        )
    if intensity is not None:
        intensity = np.clip(np.nan_to_num(intensity), 0.0, _MAX_INTENSITY).round()
    scan = LidarScan.from_arrays(
        points_m,
        offsets_us.astype(np.uint32),
        frame=source.sensor_frame,
        t0_ns=start_ns,
        t1_ns=start_ns + int(offsets_us.max(initial=0)) * 1000,
        intensity=None if intensity is None else intensity.astype(np.uint16),
        ring=None if ring is None else ring.astype(np.uint16),
        sensor=source.sensor_frame,
    )
    return scan, source.sensor_frame, None


def _cloud(value: Any, source: Source) -> Converted:
    """Return the finite points of a cloud, with their colours."""
    points_m = np.asarray(value["points"]["data"], np.float64).reshape(-1, 3)
    colors = np.asarray(value["colors"]["data"], np.float64)
    finite = np.isfinite(points_m).all(axis=1)
    message = Pointcloud.from_points(
        points_m[finite],
        frame=source.sensor_frame,
        stamp_ns=source.stamp_ns,
        colors=colors[finite, :3] if len(colors) == len(points_m) else None,
        sensor=source.sensor_frame,
    )
    return message, source.sensor_frame, None


RANGES = {
    "/base/samples/LaserScan": (
        Conversion(
            "LidarScan",
            _laser_scan,
            ("start_angle", "angular_resolution", "speed", "ranges", "minRange", "maxRange", "remission"),
        ),
    ),
    "/base/samples/DepthMap": (
        Conversion(
            "LidarScan",
            _depth_map,
            (
                "timestamps",
                "vertical_projection",
                "horizontal_projection",
                "vertical_interval",
                "horizontal_interval",
                "vertical_size",
                "horizontal_size",
                "distances",
                "remissions",
            ),
        ),
    ),
    "/base/samples/Pointcloud": (Conversion("Pointcloud", _cloud, ("points", "colors")),),
    "/base/samples/DistanceImage": (
        record(
            DistanceImage,
            stamp="ref_time",
            width=("width", int),
            height=("height", int),
            scale_x=("scale_x", float),
            scale_y=("scale_y", float),
            center_x=("center_x", float),
            center_y=("center_y", float),
            data=("data", lambda data: np.asarray(data, np.float64)),
        ),
    ),
}
