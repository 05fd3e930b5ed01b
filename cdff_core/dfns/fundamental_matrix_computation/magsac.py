# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ over samples of seven pairs, then least squares over all inliers."""

from __future__ import annotations

import cv2

from cdff_core.dfns.fundamental_matrix_computation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import MagsacConfig, checked_matrix, outputs_of, pairs, parameters
from cdff_core.imaging.two_view import fit_fundamental


class Magsac(Interface[MagsacConfig]):
    """MAGSAC++ (Barath et al. 2020) of OpenCV, with the seven parameters refined by Sampson distance.

    Where the points lie on one plane the solution is not unique: a homography explains the same pairs, and
    the covariance is large.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the fundamental matrix; raises RefusedError if the pairs do not support a model."""
        c = self.config
        source, sink = pairs(inputs.source, inputs.sink, c.min_inliers)
        F = checked_matrix(cv2.findFundamentalMat(source, sink, parameters(c))[0], len(source))
        fit = fit_fundamental(F, source, sink, c.gate_sigmas, c.threshold_px)
        return Outputs(fundamental_matrix=fit.matrix, **outputs_of(fit, c, sink, 7))
