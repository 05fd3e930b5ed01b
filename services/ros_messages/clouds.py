# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ``sensor_msgs/PointCloud2`` and ``LaserScan`` to LidarScan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import LidarScan
from services.ros_messages.topics import Topic

#: Types of the fields by their number in ``sensor_msgs/PointField``.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
#: Names of the time of a point: seconds if floating, else nanoseconds; stamps of drivers are absolute or
#: relative to the header.
_TIME_FIELDS = ("t", "time", "timestamp", "time_offset", "offset_time")
_INTENSITY_FIELDS = ("intensity", "reflectivity", "reflectance")
_NS_PER_S = 1_000_000_000
_INTENSITY_FACTOR = 257.0
_MAX_OFFSET_US = np.iinfo(np.uint32).max


def lidar_scan(message: Any, topic: Topic, stamp_ns: int) -> tuple[LidarScan, str, None]:
    """Return a sweep with the finite points of a cloud, their times, intensities and rings.

    Intensities of 8 bits or floating numbers, which drivers state between 0 and 255, are multiplied by 257.

    Raises
    ------
    InputError
        If the cloud has no x, y, z, or its data do not have the stated size.
    """
    points = _structured(message)
    names = points.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"fields {', '.join(names)}: expected x, y and z")
    xyz = _in_frame(_coordinates(points), message).astype(np.float32, copy=False)
    # The sum is finite if all numbers are, but for numbers near the limit; it needs no array of its own.
    if not (np.isfinite(xyz.sum()) or np.isfinite(xyz).all()):
        finite = np.isfinite(xyz).all(axis=1)
        points, xyz = points[finite], xyz[finite]
    start_ns, offsets_us = _times(points, stamp_ns)
    name = topic.frame(message.header.frame_id)
    scan = LidarScan.from_arrays(
        xyz,
        offsets_us,
        frame=name,
        t0_ns=start_ns,
        t1_ns=start_ns + int(offsets_us.max(initial=0)) * 1000,
        intensity=_intensity(points),
        ring=points["ring"].astype(np.uint16) if "ring" in names else None,
    )
    return scan, name, None


def unused_fields(message: Any) -> tuple[str, ...]:
    """Return the fields of a cloud that a sweep does not have, such as the colour ``rgb``.

    A cloud of a damaged type definition has no fields, or fields without a name; it has none of them.
    """
    used = {"x", "y", "z", "ring", *_INTENSITY_FIELDS, *_TIME_FIELDS}
    names = (getattr(field, "name", "") for field in getattr(message, "fields", ()))
    return tuple(name for name in names if name and name not in used)


def laser_scan(message: Any, topic: Topic, stamp_ns: int) -> tuple[LidarScan, str, None]:
    """Return the points of a planar scan within its limits of range, with their times.

    Intensities, which have no unit in ROS, are rounded and limited to 16 bits.
    """
    ranges_m = np.asarray(message.ranges, np.float64)
    angles = message.angle_min + message.angle_increment * np.arange(len(ranges_m))
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(ranges_m) & (ranges_m >= message.range_min) & (ranges_m <= message.range_max)
    valid &= ranges_m > 0.0
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    points_m = _in_frame(directions[valid] * ranges_m[valid, None], message)
    offsets_us = np.round(message.time_increment * 1e6 * np.flatnonzero(valid))
    if not (np.isfinite(points_m).all() and np.all((offsets_us >= 0) & (offsets_us < _MAX_OFFSET_US))):
        raise InputError(
            f"angles from {message.angle_min} with steps of {message.angle_increment} rad and "
            f"{message.time_increment} s: expected finite numbers, and times that ascend"
        )
    intensities = np.asarray(message.intensities, np.float64)
    has_intensities = len(intensities) == len(ranges_m)
    name = topic.frame(message.header.frame_id)
    scan = LidarScan.from_arrays(
        points_m,
        offsets_us.astype(np.uint32),
        frame=name,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns + int(offsets_us.max(initial=0)) * 1000,
        intensity=_of_16_bits(intensities[valid]) if has_intensities else None,
    )
    return scan, name, None


def _in_frame(points_m: NDArray[Any], message: Any) -> NDArray[Any]:
    """Return points in the frame of the header, in which clouds of Foxglove have a pose."""
    pose = getattr(message, "pose", None)
    if pose is None:
        return points_m
    p, q = pose.position, pose.orientation
    q_xyzw = np.array([q.x, q.y, q.z, q.w])
    if not q_xyzw.any():  # not set
        q_xyzw[3] = 1.0
    T = se3.transform_from_quaternion_xyzw(np.array([p.x, p.y, p.z]), q_xyzw)
    is_identity = np.array_equal(T, np.eye(4))
    return points_m if is_identity else points_m @ T[:3, :3].T + T[:3, 3]


def _of_16_bits(values: NDArray[Any]) -> NDArray[np.uint16]:
    """Return values as integers from 0 to 65535; NaN is 0."""
    return np.asarray(np.rint(np.fmin(np.fmax(values, 0.0), 65535.0)), np.uint16)


def _structured(message: Any) -> NDArray[Any]:
    """Return the points as a structured array ``(n,)``."""
    order = ">" if message.is_bigendian else "<"
    fields = [f for f in message.fields if f.datatype in _TYPES]
    # The check of numpy overflows for offsets near 2**31: its array would read memory of others.
    for field in fields:
        end = field.offset + np.dtype(_TYPES[field.datatype]).itemsize
        if not 0 <= field.offset < end <= message.point_step:
            raise InputError(
                f"field {field.name!r} at byte {field.offset}: expected a field within the "
                f"{message.point_step} bytes of a point"
            )
    dtype = np.dtype(
        {
            "names": [f.name for f in fields],
            "formats": [order + _TYPES[f.datatype] for f in fields],
            "offsets": [f.offset for f in fields],
            "itemsize": message.point_step,
        }
    )
    data = np.asarray(message.data, np.uint8)
    row = message.width * message.point_step
    if message.row_step < row or data.size < message.row_step * message.height:
        raise InputError(
            f"{data.size} bytes in rows of {message.row_step}: expected {message.height} rows of {row}"
        )
    rows = data[: message.row_step * message.height].reshape(message.height, message.row_step)[:, :row]
    return np.ascontiguousarray(rows).reshape(-1).view(dtype)


def _coordinates(points: NDArray[Any]) -> NDArray[np.float32]:
    """Return x, y and z of points as columns; consecutive 32-bit numbers are copied in one step."""
    fields: Mapping[str, Any] = points.dtype.fields or {}
    (kind, start), *others = ((fields[axis][0], fields[axis][1]) for axis in "xyz")
    if kind == np.dtype("<f4") and others == [(kind, start + 4), (kind, start + 8)]:
        columns = points.view(np.uint8).reshape(len(points), -1)[:, start : start + 12]
        return np.ascontiguousarray(columns).view(np.float32)
    return np.stack([points[axis].astype(np.float32) for axis in "xyz"], axis=1)


def _times(points: NDArray[Any], stamp_ns: int) -> tuple[int, NDArray[np.uint32]]:
    """Return the start of the sweep, and the time of each point after it in microseconds."""
    offsets_ns = _offsets_ns(points, stamp_ns)
    if offsets_ns is None:
        return stamp_ns, np.zeros(len(points), np.uint32)
    start_ns = stamp_ns + int(offsets_ns.min(initial=0)) // 1000 * 1000
    return start_ns, ((offsets_ns + (stamp_ns - start_ns)) // 1000).astype(np.uint32)


def _offsets_ns(points: NDArray[Any], stamp_ns: int) -> NDArray[np.int64] | None:
    """Return the time of each point relative to the header's stamp; None without times.

    Only numbers of 64 bits can be absolute times.
    """
    names = points.dtype.names or ()
    name = next((n for n in _TIME_FIELDS if n in names), None)
    if name is None:
        return None
    times = points[name]
    if times.dtype.kind == "f":
        times = np.round(times.astype(np.float64) * _NS_PER_S)
    times_ns = times.astype(np.int64)
    is_wide = points[name].dtype.itemsize == 8
    is_absolute = is_wide and len(times_ns) > 0 and times_ns[0] > stamp_ns // 2
    return times_ns - stamp_ns if is_absolute else times_ns


def _intensity(points: NDArray[Any]) -> NDArray[np.uint16] | None:
    names = points.dtype.names or ()
    name = next((n for n in _INTENSITY_FIELDS if n in names), None)
    if name is None:
        return None
    if points[name].dtype == np.dtype("<u2"):
        return np.asarray(points[name], np.uint16)
    values = points[name].astype(np.float64)
    factor = 1.0 if points[name].dtype.itemsize == 2 else _INTENSITY_FACTOR
    return _of_16_bits(values * factor)
