# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LeastSquares: all pairs are right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.transform_estimation_3d._rigid import Float, RigidConfig, RigidEstimation


class LeastSquares(RigidEstimation):
    """Closed form of Umeyama (1991), doi:10.1109/34.88573, over all pairs."""

    Config = RigidConfig
    config: RigidConfig

    def _agreeing(self, source: Float, sink: Float, sigmas: Float) -> NDArray[np.bool_]:
        return np.ones(len(source), bool)
