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

    The default noise is above that of a good gyroscope: increments are compounded as if independent, so it
    also accounts for the bias.
    """

    noise_rad_s_sqrt_hz: float = Field(1e-3, ge=0, le=1, description="Noise density of a rate")
    bias_sigma_rad_s: float = Field(2e-4, ge=0, le=1, description="Standard deviation of the gyroscope bias")
    max_gap_s: float = Field(0.1, gt=0, le=10, description="Longest interpolated time between two samples")


class MidpointRates(Interface[MidpointRatesConfig]):
    """Product of the exponentials of mean rates, interpolated at the ends or constant there."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the rotation over the interval.

        Raises
        ------
        InputError
            On stamps that do not ascend, or an interval whose end precedes its start.
        RefusedError
            If part of the interval longer than ``max_gap_s`` has no reading.
        """
        stamps, rates = inputs.stamps_ns, inputs.rates_rad_s
        begin, end = (int(t) for t in inputs.interval_ns)
        if np.any(np.diff(stamps) <= 0) or end < begin:
            raise InputError(
                f"{len(stamps)} stamps, interval {begin}..{end}: expected rising stamps and begin <= end"
            )
        inside = (stamps > begin) & (stamps < end)
        nodes = np.concatenate([[begin], stamps[inside], [end]])
        self._refuse_gaps(stamps, begin, end)
        at_nodes = np.stack([np.interp(nodes - begin, stamps - begin, rates[:, a]) for a in range(3)], axis=1)
        dt_s = np.diff(nodes) * 1e-9
        turns = 0.5 * (at_nodes[1:] + at_nodes[:-1]) - inputs.bias_rad_s
        R = np.eye(3)
        for step in se3.exp_so3(turns * dt_s[:, None]):
            R = R @ step
        span_s = (end - begin) * 1e-9
        variance = self.config.noise_rad_s_sqrt_hz**2 * span_s + (self.config.bias_sigma_rad_s * span_s) ** 2
        return Outputs(rotation=se3.normalise_rotation(R), covariance=variance * np.eye(3))

    def _refuse_gaps(self, stamps: np.ndarray, begin: int, end: int) -> None:
        limit_ns = self.config.max_gap_s * 1e9
        near = stamps[(stamps >= begin - limit_ns) & (stamps <= end + limit_ns)]
        covered = len(near) > 0 and near[0] - begin <= limit_ns and end - near[-1] <= limit_ns
        if not covered or np.any(np.diff(near) > limit_ns):
            raise RefusedError(
                f"gyro: {len(near)} readings around {begin}..{end} leave over "
                f"{self.config.max_gap_s} s without one",
                reasons=["gyro_gap"],
            )
