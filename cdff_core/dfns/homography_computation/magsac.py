# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Magsac: MAGSAC++ over samples of four pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_core.dfns.homography_computation._interface import (
    HomographyComputationInputs,
    HomographyComputationInterface,
    HomographyComputationOutputs,
)
from cdff_core.imaging.magsac import MagsacConfig, accepted, found, parameters, refused_few
from cdff_core.imaging.two_view import checked_pairs, fit_homography


class Magsac(HomographyComputationInterface):
    """Barath et al. 2020 as OpenCV has it, refined on the eight parameters by the transfer error."""

    Config = MagsacConfig
    config: MagsacConfig

    def process(self, inputs: HomographyComputationInputs) -> HomographyComputationOutputs:
        """Estimate; raises RefusedError where the pairs do not carry a model."""
        c = self.config
        source, sink = checked_pairs(inputs.source, inputs.sink, 0)
        refused_few(len(source), c)
        H = found(cv2.findHomography(source, sink, parameters(c))[0], len(source))
        fit = fit_homography(H, source, sink, c.gate_sigmas, c.threshold_px)
        alarms = accepted(fit, c, sink, 4, is_line=False)
        return HomographyComputationOutputs(
            fit.matrix, fit.covariance, fit.inliers, fit.residuals, np.array(fit.sigma_px), np.array(alarms)
        )
