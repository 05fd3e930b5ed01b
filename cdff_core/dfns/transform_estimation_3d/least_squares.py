# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Least squares over all pairs."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_core.dfns.transform_estimation_3d._rigid import RigidConfig, RigidEstimation


class LeastSquares(RigidEstimation[RigidConfig]):
    """Estimate the transform in closed form (Umeyama 1991, doi:10.1109/34.88573) from all pairs."""

    def _select_inliers(self, source: FloatArray, sink: FloatArray, sigmas: FloatArray) -> BoolArray:
        return np.ones(len(source), bool)
