# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ over samples of five pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2

from cdff_core.dfns.essential_matrix_computation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import MagsacConfig, checked_matrix, outputs_of, pairs, parameters
from cdff_core.imaging.relative_pose import checked_cameras, decomposed, fit_in_front, rays


class Magsac(Interface[MagsacConfig]):
    """MAGSAC++ (Barath et al. 2020) of OpenCV, with the five parameters refined by Sampson distance."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the essential matrix; raises RefusedError if the pairs do not support a model."""
        c = self.config
        source, sink = pairs(inputs.source, inputs.sink, c.min_inliers)
        K = checked_cameras(inputs.source_camera, inputs.sink_camera)
        E = checked_matrix(
            cv2.findEssentialMat(source, sink, K[0], K[1], None, None, parameters(c))[0], len(source)
        )
        R, t, _ = decomposed(E, rays(source, K[0]), rays(sink, K[1]))
        fit, *_ = fit_in_front(R, t, K, source, sink, c.gate_sigmas, c.threshold_px)
        return Outputs(essential_matrix=fit.matrix, **outputs_of(fit, c, sink, 5))
