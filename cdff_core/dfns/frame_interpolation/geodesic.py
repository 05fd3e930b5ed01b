# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Linear interpolation of the translation and geodesic interpolation of the rotation."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.frame_interpolation.interface import Inputs, Interface, Outputs


class GeodesicConfig(DfnConfig):
    """Parameters of Geodesic: motion that deviates from the geodesic."""

    acceleration_m_s2: float = Field(
        0.1, ge=0, le=100, description="Standard deviation of the acceleration between the poses"
    )
    angular_acceleration_rad_s2: float = Field(
        0.1, ge=0, le=100, description="Standard deviation of the angular acceleration"
    )


class Geodesic(Interface[GeodesicConfig]):
    """Interpolation; its error is the mean of both plus half of ``a (t - t0)(t1 - t)`` of the motion."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the interpolated pose; raises ExtrapolationError for a time outside the interval."""
        start, end = (int(t) for t in inputs.interval_ns)
        time = inputs.time_ns
        if not start <= time <= end:
            raise ExtrapolationError(f"time {time}: expected within {start}..{end}; this is interpolation")
        s = 0.0 if end == start else (time - start) / (end - start)
        T = se3.interpolate_transform(inputs.first, inputs.second, s)
        covariance = np.full((6, 6), np.nan)
        C1, C2, X = inputs.first_covariance, inputs.second_covariance, inputs.cross_covariance
        if C1 is not None and C2 is not None:
            if X is None:
                covariance = (1.0 - s) * C1 + s * C2
            else:
                covariance = (1.0 - s) ** 2 * C1 + s**2 * C2 + s * (1.0 - s) * (X + X.T)
            bend_s2 = 0.5 * s * (1.0 - s) * ((end - start) * 1e-9) ** 2
            bend = [self.config.acceleration_m_s2] * 3 + [self.config.angular_acceleration_rad_s2] * 3
            covariance = covariance + np.diag(np.square(np.multiply(bend, bend_s2)))
        return Outputs(pose=T, covariance=covariance, fraction=s)
