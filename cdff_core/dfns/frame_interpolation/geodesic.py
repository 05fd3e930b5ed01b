# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Linear interpolation of the position and geodesic interpolation of the rotation."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.frame_interpolation.interface import Inputs, Interface, Outputs


class GeodesicConfig(DfnConfig):
    """Parameters of Geodesic: deviation of the motion from the interpolation."""

    acceleration_m_s2: float = Field(
        0.1, ge=0, le=100, description="Standard deviation of the acceleration between the poses"
    )
    angular_acceleration_rad_s2: float = Field(
        0.1, ge=0, le=100, description="Standard deviation of the angular acceleration"
    )


class Geodesic(Interface[GeodesicConfig]):
    """Interpolation between two poses with the covariance of the interpolated pose.

    The covariance is that of the weighted mean of both errors plus that of the motion in between: a constant
    acceleration a causes the deviation ``a (t - t0) (t1 - t) / 2``. Without a cross-covariance, the weighted
    mean of both covariances is used, an upper bound for any correlation.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the interpolated pose; raises ExtrapolationError for a time outside the interval."""
        start, end = (int(t) for t in inputs.interval_ns)
        time = inputs.time_ns
        if not start <= time <= end:
            raise ExtrapolationError(f"time {time}: expected within {start}..{end}")
        fraction = 0.0 if end == start else (time - start) / (end - start)
        pose = se3.interpolate_transform(inputs.first, inputs.second, fraction)
        covariance = np.full((6, 6), np.nan)
        start_covariance, end_covariance = inputs.first_covariance, inputs.second_covariance
        cross = inputs.cross_covariance
        if start_covariance is not None and end_covariance is not None:
            if cross is None:
                covariance = (1.0 - fraction) * start_covariance + fraction * end_covariance
            else:
                covariance = (
                    (1.0 - fraction) ** 2 * start_covariance
                    + fraction**2 * end_covariance
                    + fraction * (1.0 - fraction) * (cross + cross.T)
                )
            deviation_s2 = 0.5 * fraction * (1.0 - fraction) * ((end - start) * 1e-9) ** 2
            c = self.config
            accelerations = np.repeat([c.acceleration_m_s2, c.angular_acceleration_rad_s2], 3)
            covariance = covariance + np.diag((accelerations * deviation_s2) ** 2)
        return Outputs(pose=pose, covariance=covariance, fraction=fraction)
