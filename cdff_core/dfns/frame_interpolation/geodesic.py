# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Geodesic: translation along the line, rotation about one axis, and what lies between two known poses."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.frame_interpolation._interface import (
    FrameInterpolationInputs,
    FrameInterpolationInterface,
    FrameInterpolationOutputs,
)


class GeodesicConfig(DfnConfig):
    """How much a frame may move off the geodesic."""

    acceleration_m_s2: Annotated[float, Field(ge=0, le=100, description="m/s^2")] = 0.1
    angular_acceleration_rad_s2: Annotated[float, Field(ge=0, le=100, description="rad/s^2")] = 0.1


class Geodesic(FrameInterpolationInterface):
    """The error between two poses is the weighted mean of theirs, and half of ``a (t - t0)(t1 - t)`` of the motion."""

    Config: ClassVar[type[DfnConfig]] = GeodesicConfig
    config: GeodesicConfig

    def process(self, inputs: FrameInterpolationInputs) -> FrameInterpolationOutputs:
        """Interpolate; raises ExtrapolationError where the time lies outside the interval."""
        begin, end = (int(t) for t in inputs.interval_ns)
        time = int(inputs.time_ns)
        if not begin <= time <= end:
            raise ExtrapolationError(f"time {time}: expected within {begin}..{end}; this is interpolation")
        s = 0.0 if end == begin else (time - begin) / (end - begin)
        A, B = inputs.first, inputs.second
        R = A[:3, :3] @ se3.exp_so3(s * se3.log_so3(A[:3, :3].T @ B[:3, :3]))
        T = se3.transform(se3.normalise_rotation(R), (1.0 - s) * A[:3, 3] + s * B[:3, 3])
        covariance = np.full((6, 6), np.nan)
        C1, C2, X = inputs.first_covariance, inputs.second_covariance, inputs.cross_covariance
        if C1 is not None and C2 is not None:
            if X is None:
                covariance = (1.0 - s) * C1 + s * C2
            else:
                covariance = (1.0 - s) ** 2 * C1 + s**2 * C2 + s * (1.0 - s) * (X + X.T)
            bend_s2 = 0.5 * s * (1.0 - s) * ((end - begin) * 1e-9) ** 2
            bend = [self.config.acceleration_m_s2] * 3 + [self.config.angular_acceleration_rad_s2] * 3
            covariance = covariance + np.diag(np.square(np.multiply(bend, bend_s2)))
        return FrameInterpolationOutputs(T, covariance, np.asarray(s))
