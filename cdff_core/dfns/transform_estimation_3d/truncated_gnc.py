# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Truncated least squares by graduated non-convexity; up to about 70 % of the pairs may be wrong."""

from __future__ import annotations

from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry.robust import graduated_fit
from cdff_core.dfns.transform_estimation_3d._rigid import RigidConfig, RigidEstimation


class TruncatedGncConfig(RigidConfig):
    """Parameters of TruncatedGnc."""

    threshold: float = Field(
        0.1,
        gt=0,
        le=1e6,
        description=(
            "Distance above which a pair is an outlier: metres, or standard deviations if sigmas are given"
        ),
    )


class TruncatedGnc(RigidEstimation[TruncatedGncConfig]):
    """Select the inliers by graduated non-convexity (Yang et al. 2020, doi:10.1109/LRA.2020.2965893), without
    random samples.
    """

    def _select_inliers(self, source: FloatArray, sink: FloatArray, sigmas: FloatArray) -> BoolArray:
        return graduated_fit(source, sink, self.config.threshold, sigmas)[1] <= self.config.threshold**2
