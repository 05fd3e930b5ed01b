# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ on samples of four pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2

from cdff_core.dfns.homography_computation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import (
    MagsacConfig,
    checked_matrix,
    estimated_matrix,
    outputs_of,
    pairs,
    parameters,
)
from cdff_core.imaging.two_view import fit_homography


class Magsac(Interface[MagsacConfig]):
    """OpenCV's MAGSAC++ (Barath et al. 2020); the eight parameters are refined by the transfer error."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the homography; raises RefusedError if too few pairs agree on one."""
        cfg = self.config
        source, sink = pairs(inputs.source, inputs.sink, cfg.min_inliers)
        if inputs.guess is None:
            H = estimated_matrix(cv2.findHomography, len(source), source, sink, parameters(cfg))
        else:
            H = checked_matrix(inputs.guess, len(source))
        fit = fit_homography(H, source, sink, cfg.gate_sigmas, cfg.threshold_px)
        return Outputs(homography=fit.matrix, **outputs_of(fit, cfg, sink, 4, is_line=False))
