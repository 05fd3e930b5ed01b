# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Integration of angular rates with the mean rate between two readings."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.gyro_integration.interface import Inputs, Interface, Outputs


class MidpointRatesConfig(DfnConfig):
    """Parameters of MidpointRates.

    The default noise is above that of a good gyroscope, since it also accounts for the bias where consecutive
    rotations are compounded as if their errors were independent.
    """

    noise_rad_s_sqrt_hz: float = Field(1e-3, ge=0, le=1, description="Noise density of a rate")
    bias_sigma_rad_s: float = Field(2e-4, ge=0, le=1, description="Standard deviation of the gyroscope bias")
    max_gap_s: float = Field(0.1, gt=0, le=10, description="Longest time between two readings")


class MidpointRates(Interface[MidpointRatesConfig]):
    """Product of the rotations by the mean rate between consecutive readings.

    Rates at the ends of the interval are interpolated; outside the readings they are constant.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the rotation over the interval.

        Raises
        ------
        InputError
            If the stamps do not ascend, or the interval ends before it starts.
        RefusedError
            If part of the interval longer than ``max_gap_s`` has no reading.
        """
        stamps, rates = inputs.stamps_ns, inputs.rates_rad_s
        start, end = (int(t) for t in inputs.interval_ns)
        if np.any(np.diff(stamps) <= 0) or end < start:
            raise InputError(
                f"{len(stamps)} stamps, interval {start}..{end}: expected ascending stamps and start <= end"
            )
        inside = (stamps > start) & (stamps < end)
        nodes = np.concatenate([[start], stamps[inside], [end]])
        self._refuse_gaps(stamps, start, end)
        node_rates = np.stack(
            [np.interp(nodes - start, stamps - start, rates[:, a]) for a in range(3)], axis=1
        )
        dt_s = np.diff(nodes) * 1e-9
        mean_rates = 0.5 * (node_rates[1:] + node_rates[:-1]) - inputs.bias_rad_s
        R = np.eye(3)
        for rotation in se3.exp_so3(mean_rates * dt_s[:, None]):
            R = R @ rotation
        duration_s = (end - start) * 1e-9
        variance = (
            self.config.noise_rad_s_sqrt_hz**2 * duration_s + (self.config.bias_sigma_rad_s * duration_s) ** 2
        )
        return Outputs(rotation=se3.normalise_rotation(R), covariance=variance * np.eye(3))

    def _refuse_gaps(self, stamps: np.ndarray, start: int, end: int) -> None:
        """Raise RefusedError if the readings around an interval leave a gap above ``max_gap_s``."""
        limit_ns = self.config.max_gap_s * 1e9
        nearby_stamps = stamps[(stamps >= start - limit_ns) & (stamps <= end + limit_ns)]
        is_covered = (
            len(nearby_stamps) > 0
            and nearby_stamps[0] - start <= limit_ns
            and end - nearby_stamps[-1] <= limit_ns
        )
        if not is_covered or np.any(np.diff(nearby_stamps) > limit_ns):
            raise RefusedError(
                f"gyro: {len(nearby_stamps)} readings around {start}..{end}, expected no gap above "
                f"{self.config.max_gap_s} s",
                reasons=["gyro_gap"],
            )
