# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ``sensor_msgs/PointCloud2`` to LidarScan."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types import LidarScan
from cdff_dev.logs.formats.ros.topics import Topic

#: Types of the fields by their number in ``sensor_msgs/PointField``.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
#: Names of the time of a point: seconds if floating, else nanoseconds; stamps of drivers are absolute or
#: relative to the header.
_TIME_FIELDS = ("t", "time", "timestamp", "time_offset", "offset_time")
_INTENSITY_FIELDS = ("intensity", "reflectivity", "reflectance")
_NS_PER_S = 1_000_000_000
_INTENSITY_FACTOR = 257.0


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
    xyz = np.stack([points[axis].astype(np.float32) for axis in "xyz"], axis=1)
    finite = np.isfinite(xyz).all(axis=1)
    points, xyz = points[finite], xyz[finite]
    offsets_ns = _offsets_ns(points, stamp_ns)
    start_ns = stamp_ns + int(offsets_ns.min(initial=0)) // 1000 * 1000
    offsets_us = (stamp_ns + offsets_ns - start_ns) // 1000
    name = topic.frame(message.header.frame_id)
    scan = LidarScan.from_arrays(
        xyz,
        offsets_us.astype(np.uint32),
        frame=name,
        t0_ns=start_ns,
        t1_ns=start_ns + int(offsets_us.max(initial=0)) * 1000,
        intensity=_intensity(points),
        ring=points["ring"].astype(np.uint16) if "ring" in names else None,
    )
    return scan, name, None


def _structured(message: Any) -> NDArray[Any]:
    """Return the points as a structured array ``(n,)``."""
    order = ">" if message.is_bigendian else "<"
    fields = [f for f in message.fields if f.datatype in _TYPES]
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


def _offsets_ns(points: NDArray[Any], stamp_ns: int) -> NDArray[np.int64]:
    """Return the time of each point relative to the header's stamp."""
    names = points.dtype.names or ()
    name = next((n for n in _TIME_FIELDS if n in names), None)
    if name is None:
        return np.zeros(len(points), np.int64)
    times = points[name]
    if times.dtype.kind == "f":
        times = np.round(times.astype(np.float64) * _NS_PER_S)
    times_ns = times.astype(np.int64)
    is_absolute = len(times_ns) > 0 and times_ns[0] > stamp_ns // 2
    return times_ns - stamp_ns if is_absolute else times_ns


def _intensity(points: NDArray[Any]) -> NDArray[np.uint16] | None:
    names = points.dtype.names or ()
    name = next((n for n in _INTENSITY_FIELDS if n in names), None)
    if name is None:
        return None
    values = np.nan_to_num(points[name].astype(np.float64))
    factor = 1.0 if points[name].dtype.itemsize == 2 else _INTENSITY_FACTOR
    return np.clip(np.round(values * factor), 0, 65535).astype(np.uint16)
