# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MidpointRates: between two readings the body turns at their mean rate."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.gyro_integration._interface import (
    GyroIntegrationInputs,
    GyroIntegrationInterface,
    GyroIntegrationOutputs,
)


class MidpointRatesConfig(DfnConfig):
    """Parameters of MidpointRates.

    The noise is above a good gyro's: increments are compounded as if independent, so it also stands for its bias.
    """

    noise_rad_s_sqrt_hz: Annotated[float, Field(ge=0, le=1, description="rad/s/sqrt(Hz)")] = 1e-3
    bias_sigma_rad_s: Annotated[float, Field(ge=0, le=1, description="rad/s")] = 2e-4
    max_gap_s: Annotated[float, Field(gt=0, le=10, description="s")] = 0.1


class MidpointRates(GyroIntegrationInterface):
    """Product of the exponentials of the mean rates; the ends are interpolated or, within ``max_gap_s``, held."""

    Config = MidpointRatesConfig
    config: MidpointRatesConfig

    def process(self, inputs: GyroIntegrationInputs) -> GyroIntegrationOutputs:
        """Integrate over the interval.

        Raises
        ------
        InputError
            On arrays that do not fit together, stamps that do not rise, or an interval that ends before it begins.
        RefusedError
            If a stretch of the interval longer than ``max_gap_s`` has no reading.
        """
        stamps, rates = inputs.stamps_ns, inputs.rates_rad_s
        begin, end = (int(t) for t in inputs.interval_ns)
        if rates.shape != (len(stamps), 3) or np.any(np.diff(stamps) <= 0) or end < begin:
            raise InputError(
                f"{len(stamps)} stamps, rates {rates.shape}, interval {begin}..{end}: expected (n, 3) rates at rising "
                "stamps and begin <= end"
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
        return GyroIntegrationOutputs(se3.normalise_rotation(R), variance * np.eye(3))

    def _refuse_gaps(self, stamps: np.ndarray, begin: int, end: int) -> None:
        limit_ns = self.config.max_gap_s * 1e9
        near = stamps[(stamps >= begin - limit_ns) & (stamps <= end + limit_ns)]
        covered = len(near) > 0 and near[0] - begin <= limit_ns and end - near[-1] <= limit_ns
        if not covered or np.any(np.diff(near) > limit_ns):
            raise RefusedError(
                f"gyro: {len(near)} readings around {begin}..{end} leave over {self.config.max_gap_s} s without one",
                reasons=["gyro_gap"],
            )
