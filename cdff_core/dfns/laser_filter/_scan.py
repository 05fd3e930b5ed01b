# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Laser scans as arrays: valid ranges, points, and replacement of ranges by error codes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import InputError
from cdff_common.types import LaserRangeErrors, LaserScan

_M_PER_MM = 1e-3


def is_measured(scan: LaserScan) -> BoolArray:
    """Return which ranges are measurements, shape (n,); smaller values are error codes."""
    return scan.ranges >= LaserRangeErrors.END_LASER_RANGE_ERRORS


def ranges_m(scan: LaserScan) -> FloatArray:
    """Return the ranges in metres, shape (n,); NaN where the scan holds an error code."""
    return np.where(is_measured(scan), scan.ranges * _M_PER_MM, np.nan)


def points_laser_m(scan: LaserScan) -> FloatArray:
    """Return the points of the scan in the laser frame, shape (n, 3), metres; NaN where nothing was measured.

    The scan lies in the plane z = 0; the angle of beam i from x towards y is
    ``start_angle + i angular_resolution``.
    """
    angle_rad = scan.start_angle + scan.angular_resolution * np.arange(len(scan.ranges))
    directions = np.column_stack([np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)])
    points: FloatArray = ranges_m(scan)[:, np.newaxis] * directions
    return points


def check_beam_geometry(scan: LaserScan) -> None:
    """Raise InputError if the scan has no valid angles of its beams."""
    if not np.isfinite([scan.start_angle, scan.angular_resolution]).all() or scan.angular_resolution == 0:
        raise InputError(
            f"scan_samples: start_angle {scan.start_angle}, angular_resolution "
            f"{scan.angular_resolution} rad; expected finite numbers and a resolution other than 0"
        )


def replace_ranges(scan: LaserScan, removed: BoolArray, code: LaserRangeErrors) -> LaserScan:
    """Return the scan with an error code instead of the ranges selected by ``removed``, shape (n,)."""
    return replace(scan, ranges=np.where(removed, np.int32(code), scan.ranges).astype(np.int32))
