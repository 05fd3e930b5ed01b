# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Magsac: MAGSAC++ over samples of five pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_core.dfns.essential_matrix_computation._interface import (
    EssentialMatrixComputationInputs,
    EssentialMatrixComputationInterface,
    EssentialMatrixComputationOutputs,
)
from cdff_core.imaging.magsac import MagsacConfig, accepted, found, parameters, refused_few
from cdff_core.imaging.relative_pose import checked_cameras, decomposed, fit_in_front, rays
from cdff_core.imaging.two_view import checked_pairs


class Magsac(EssentialMatrixComputationInterface):
    """Barath et al. 2020 as OpenCV has it, refined on rotation and direction of translation by Sampson's distance."""

    Config = MagsacConfig
    config: MagsacConfig

    def process(self, inputs: EssentialMatrixComputationInputs) -> EssentialMatrixComputationOutputs:
        """Estimate; raises RefusedError where the pairs do not carry a model."""
        c = self.config
        source, sink = checked_pairs(inputs.source, inputs.sink, 0)
        K = checked_cameras(inputs.source_camera, inputs.sink_camera)
        refused_few(len(source), c)
        E = found(cv2.findEssentialMat(source, sink, K[0], K[1], None, None, parameters(c))[0], len(source))
        R, t, _ = decomposed(E, rays(source, K[0]), rays(sink, K[1]))
        fit, *_ = fit_in_front(R, t, K, source, sink, c.gate_sigmas, c.threshold_px)
        alarms = accepted(fit, c, sink, 5, is_line=True)
        return EssentialMatrixComputationOutputs(
            fit.matrix, fit.covariance, fit.inliers, fit.residuals, np.array(fit.sigma_px), np.array(alarms)
        )
