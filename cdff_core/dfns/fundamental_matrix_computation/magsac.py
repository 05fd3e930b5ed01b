# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ on samples of seven pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2

from cdff_core.dfns.fundamental_matrix_computation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import (
    MagsacConfig,
    checked_matrix,
    estimated_matrix,
    outputs_of,
    pairs,
    parameters,
)
from cdff_core.imaging.sampson import compile_kernels
from cdff_core.imaging.two_view import fit_fundamental


class Magsac(Interface[MagsacConfig]):
    """OpenCV's MAGSAC++ (Barath et al. 2020); the seven parameters are refined by the Sampson distance.

    If all points lie on one plane the solution is not unique, since a homography explains the same pairs; the
    covariance is then large.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        compile_kernels()

    def process(self, inputs: Inputs) -> Outputs:
        """Return the fundamental matrix; raises RefusedError if too few pairs agree on one."""
        cfg = self.config
        source, sink = pairs(inputs.source, inputs.sink, cfg.min_inliers)
        if inputs.guess is None:
            F = estimated_matrix(cv2.findFundamentalMat, len(source), source, sink, parameters(cfg))
        else:
            F = checked_matrix(inputs.guess, len(source))
        fit = fit_fundamental(F, source, sink, cfg.gate_sigmas, cfg.threshold_px)
        return Outputs(fundamental_matrix=fit.matrix, **outputs_of(fit, cfg, sink, 7))
