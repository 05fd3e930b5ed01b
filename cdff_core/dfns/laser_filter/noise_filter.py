# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Removal of ranges beyond the sensor's limits, speckle, and mixed pixels at edges of objects."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import LaserRangeErrors, LaserScan
from cdff_core.dfns.laser_filter._scan import check_beam_geometry, is_measured, ranges_m, replace_ranges
from cdff_core.dfns.laser_filter.interface import Inputs, Interface, Outputs

#: Angle between beam and surface below which, on both sides, a range is a mixed pixel.
_MIN_INCIDENCE_RAD = np.deg2rad(3.0)


class NoiseFilterConfig(DfnConfig):
    """Parameters of NoiseFilter."""

    half_window: int = Field(
        3, ge=1, le=50, description="Number of beams on each side that a range is compared with"
    )
    max_deviation_m: float = Field(
        0.5, gt=0, le=100, description="Distance from the median of the window above which a range is noise"
    )


class NoiseFilter(Interface[NoiseFilterConfig]):
    """Remove ranges outside the limits, ranges far from the median of their window, and mixed pixels.

    1. A range outside the limits stated in the scan becomes too-near or too-far (``max_range`` 0: no limit).
    2. A range that differs from the median of its window by more than ``max_deviation_m`` is noise.
    3. A range whose lines to the next measured beam on *both* sides meet its own beam at less than
       3 degrees is a mixed pixel between two surfaces hit by one beam. The last point of a
       surface has such an angle on one side only and is kept; a surface at a smaller angle is removed.

    Notes
    -----
    For neighbouring ranges r and s with the angle δ between the beams, the angle at r is
    atan2(s sin δ, r - s cos δ), taken to the nearer of 0 and π. The effect is that of [1]_.

    References
    ----------
    .. [1] Tuley, J., Vandapel, N., Hebert, M. (2005). Analysis and removal of artifacts in 3-D LADAR data.
       ICRA, 2203-2210.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the filtered scan; raises InputError on a scan without beam geometry."""
        check_beam_geometry(inputs.scan_samples)
        scan = _apply_limits(inputs.scan_samples)
        values_m = ranges_m(scan)
        noise = self._is_speckle(values_m) | _is_mixed_pixel(values_m, abs(scan.angular_resolution))
        return Outputs(filtered_scans=replace_ranges(scan, noise, LaserRangeErrors.MEASUREMENT_ERROR))

    def _is_speckle(self, values_m: FloatArray) -> BoolArray:
        """Return which ranges are far from the median of their window, shape (n,)."""
        k = self.config.half_window
        windows = sliding_window_view(np.pad(values_m, k, constant_values=np.nan), 2 * k + 1)
        valid = np.isfinite(values_m)
        is_far = np.zeros(len(values_m), np.bool_)
        is_far[valid] = (
            np.abs(values_m[valid] - np.nanmedian(windows[valid], axis=1)) > self.config.max_deviation_m
        )
        return is_far


def _is_mixed_pixel(values_m: FloatArray, beam_angle_rad: float) -> BoolArray:
    """Return which ranges have a grazing incidence on both sides, shape (n,)."""
    beams = np.flatnonzero(np.isfinite(values_m))
    is_mixed = np.zeros(len(values_m), np.bool_)
    if len(beams) < 3:
        return is_mixed
    r = values_m[beams]
    delta = np.diff(beams) * beam_angle_rad
    to_next = _incidence_rad(r[:-1], r[1:], delta)
    to_previous = _incidence_rad(r[1:], r[:-1], delta)
    is_mixed[beams[1:-1]] = (to_previous[:-1] < _MIN_INCIDENCE_RAD) & (to_next[1:] < _MIN_INCIDENCE_RAD)
    return is_mixed


def _incidence_rad(r: FloatArray, s: FloatArray, delta: FloatArray) -> FloatArray:
    """Return the angle between beam ``r`` and the line to the end of beam ``s``, shape (n,), in 0…π/2."""
    angle = np.arctan2(s * np.sin(delta), r - s * np.cos(delta))
    acute: FloatArray = np.minimum(np.abs(angle), np.pi - np.abs(angle))
    return acute


def _apply_limits(scan: LaserScan) -> LaserScan:
    """Return the scan with error codes instead of the ranges outside the limits that it states."""
    valid = is_measured(scan)
    scan = replace_ranges(scan, valid & (scan.ranges < scan.min_range), LaserRangeErrors.TOO_NEAR)
    if scan.max_range:
        scan = replace_ranges(scan, valid & (scan.ranges > scan.max_range), LaserRangeErrors.TOO_FAR)
    return scan
