# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""NoiseFilter: takes out ranges beyond the sensor's limits, speckle, and mixed pixels at the edges of things."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import LaserRangeErrors, LaserScan
from cdff_core.dfns.laser_filter._interface import LaserFilterInputs, LaserFilterInterface, LaserFilterOutputs
from cdff_core.dfns.laser_filter._scan import checked, measured, ranges_m, without


class NoiseFilterConfig(DfnConfig):
    """Parameters of NoiseFilter."""

    half_window: Annotated[int, Field(ge=1, le=50, description="beams on each side that a range is compared with")] = 3
    max_deviation_m: Annotated[
        float, Field(gt=0, le=100, description="distance from the window's median beyond which a range is noise, m")
    ] = 0.5
    min_incidence_deg: Annotated[
        float,
        Field(
            ge=0,
            lt=45,
            description="angle between beam and surface below which a range is a mixed pixel, deg; 0 switches it off",
        ),
    ] = 3.0


class NoiseFilter(LaserFilterInterface):
    """Range limits, median in a window, mixed pixels.

    1. A range outside the limits that the scan itself states becomes too-near or too-far (``max_range`` 0: no limit).
    2. A range that differs from the median of its window by more than ``max_deviation_m`` is noise.
    3. A range whose lines to the next measured beam on *both* sides meet its own beam at less than
       ``min_incidence_deg`` hangs between two surfaces: a mixed pixel, where one beam hit two things. The last point of
       a surface is seen so on one side only and stays. A surface that is seen at a smaller angle than that goes, too.

    Notes
    -----
    For neighbouring ranges r and s with the angle δ between the beams, the angle at r is
    atan2(s sin δ, r - s cos δ), taken to the nearer of 0 and π. The effect is that of [1]_.

    References
    ----------
    .. [1] Tuley, J., Vandapel, N., Hebert, M. (2005). Analysis and removal of artifacts in 3-D LADAR data. ICRA,
       2203-2210.
    """

    Config = NoiseFilterConfig
    config: NoiseFilterConfig

    def process(self, inputs: LaserFilterInputs) -> LaserFilterOutputs:
        """Filter one scan; the transform is not needed. Raises InputError on a scan without beam geometry."""
        scan = _within_limits(checked(inputs.scan_samples))
        values_m = ranges_m(scan)
        noise = self._speckle(values_m) | self._mixed(values_m, abs(scan.angular_resolution))
        return LaserFilterOutputs(filtered_scans=without(scan, noise, LaserRangeErrors.MEASUREMENT_ERROR))

    def _speckle(self, values_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which ranges lie far from the median of their window, shape (n,)."""
        k = self.config.half_window
        windows = sliding_window_view(np.pad(values_m, k, constant_values=np.nan), 2 * k + 1)
        there = np.isfinite(values_m)
        far = np.zeros(len(values_m), np.bool_)
        far[there] = np.abs(values_m[there] - np.nanmedian(windows[there], axis=1)) > self.config.max_deviation_m
        return far

    def _mixed(self, values_m: NDArray[np.float64], beam_angle_rad: float) -> NDArray[np.bool_]:
        """Which ranges are seen at a grazing angle from both sides, shape (n,)."""
        there = np.flatnonzero(np.isfinite(values_m))
        mixed = np.zeros(len(values_m), np.bool_)
        if len(there) < 3:
            return mixed
        r = values_m[there]
        delta = np.diff(there) * beam_angle_rad
        after = _incidence_rad(r[:-1], r[1:], delta)
        before = _incidence_rad(r[1:], r[:-1], delta)
        least = np.deg2rad(self.config.min_incidence_deg)
        mixed[there[1:-1]] = (before[:-1] < least) & (after[1:] < least)
        return mixed


def _incidence_rad(r: NDArray[np.float64], s: NDArray[np.float64], delta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle at the end of beam ``r`` between it and the line to the end of beam ``s``, shape (n,), in 0…π/2."""
    angle = np.arctan2(s * np.sin(delta), r - s * np.cos(delta))
    nearer: NDArray[np.float64] = np.minimum(np.abs(angle), np.pi - np.abs(angle))
    return nearer


def _within_limits(scan: LaserScan) -> LaserScan:
    """The scan with error codes in place of ranges outside its own limits."""
    valid = measured(scan)
    scan = without(scan, valid & (scan.ranges < scan.min_range), LaserRangeErrors.TOO_NEAR)
    if scan.max_range:
        scan = without(scan, valid & (scan.ranges > scan.max_range), LaserRangeErrors.TOO_FAR)
    return scan
