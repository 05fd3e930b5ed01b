# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Magsac: MAGSAC++ over samples of seven pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_core.dfns.fundamental_matrix_computation._interface import (
    FundamentalMatrixComputationInputs,
    FundamentalMatrixComputationInterface,
    FundamentalMatrixComputationOutputs,
)
from cdff_core.imaging.magsac import MagsacConfig, accepted, found, parameters, refused_few
from cdff_core.imaging.two_view import checked_pairs, fit_fundamental


class Magsac(FundamentalMatrixComputationInterface):
    """Barath et al. 2020 as OpenCV has it, refined on the seven parameters by Sampson's distance.

    Where points lie on one plane the answer is one of many; a homography then explains the same pairs, and the
    covariance is large.
    """

    Config = MagsacConfig
    config: MagsacConfig

    def process(self, inputs: FundamentalMatrixComputationInputs) -> FundamentalMatrixComputationOutputs:
        """Estimate; raises RefusedError where the pairs do not carry a model."""
        c = self.config
        source, sink = checked_pairs(inputs.source, inputs.sink, 0)
        refused_few(len(source), c)
        F = found(cv2.findFundamentalMat(source, sink, parameters(c))[0], len(source))
        fit = fit_fundamental(F, source, sink, c.gate_sigmas, c.threshold_px)
        alarms = accepted(fit, c, sink, 7, is_line=True)
        return FundamentalMatrixComputationOutputs(
            fit.matrix, fit.covariance, fit.inliers, fit.residuals, np.array(fit.sigma_px), np.array(alarms)
        )
