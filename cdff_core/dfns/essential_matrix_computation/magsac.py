# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ on samples of five pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2

from cdff_core.dfns.essential_matrix_computation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import (
    CalibrationConfig,
    MagsacConfig,
    estimated_matrix,
    outputs_of,
    pairs,
    parameters,
)
from cdff_core.imaging.relative_pose import MIN_IN_FRONT, checked_cameras, fit_in_front
from cdff_core.imaging.relative_pose_search import ambiguity, find_minima
from cdff_core.imaging.sampson import compile_kernels


class EssentialMagsacConfig(MagsacConfig, CalibrationConfig):
    """Parameters of Magsac."""


class Magsac(Interface[EssentialMagsacConfig]):
    """OpenCV's MAGSAC++ (Barath et al. 2020); the five parameters are refined by the Sampson distance.

    The best of several local minima is returned, since MAGSAC++ may end in any of them.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        compile_kernels()

    def process(self, inputs: Inputs) -> Outputs:
        """Return the essential matrix; raises RefusedError if too few pairs agree on one."""
        cfg = self.config
        source, sink = pairs(inputs.source, inputs.sink, cfg.min_inliers)
        K = checked_cameras(inputs.source_camera, inputs.sink_camera)
        E = estimated_matrix(
            cv2.findEssentialMat, len(source), source, sink, K[0], K[1], None, None, parameters(cfg)
        )
        minima = find_minima(E, K, source, sink, cfg.gate_sigmas, cfg.threshold_px)
        R, t = minima[0].R, minima[0].t
        fit, *_ = fit_in_front(R, t, K, source, sink, cfg.gate_sigmas, cfg.threshold_px, cfg.lenses)
        return Outputs(
            essential_matrix=fit.matrix,
            ambiguity=ambiguity(minima, MIN_IN_FRONT),
            **outputs_of(fit, cfg, sink, 5),
        )
