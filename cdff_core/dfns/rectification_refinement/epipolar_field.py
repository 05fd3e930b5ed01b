# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimation of a small rotation and decentring of the right camera from row offsets of matches."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.rectification_refinement.interface import Inputs, Interface, Outputs

#: Prior standard deviation of each coefficient, above the errors of any usable rectification.
_SIGMA_PRIOR_PX = 5.0


class EpipolarFieldConfig(DfnConfig):
    """Parameters of EpipolarField."""

    sigma_row_px: float = Field(0.2, gt=0, le=10, description="Standard deviation of a row offset")
    sigma_offset_px: float = Field(
        0.25, gt=0, le=5, description="Standard deviation of the remaining disparity offset"
    )
    memory: int = Field(20_000, ge=10, description="Effective number of previous row offsets in the estimate")


class EpipolarField(Interface[EpipolarFieldConfig]):
    """Estimate continuously [1]_ the errors of a rectification that are observable in rows.

    To first order, with ``x, y`` the normalised coordinates in the right image, the right camera's rotation
    (pitch P, yaw Y, roll R), scale S and decentring D (all in pixels, i.e. times the focal length) shift its
    points by

    ====  =======================================  =====================================
    term  rows                                     columns
    ====  =======================================  =====================================
    R     ``R x``                                  ``-R y``
    S     ``S y``                                  ``S x``
    Y     ``Y x y``                                ``Y (1 + x²)``
    D     ``2 D x y`` (decentring p2 of [2]_)      ``D (3 x² + y²)``
    ====  =======================================  =====================================

    An error of the principal point changes both Y and D, since it shifts the centre of the lens distortion.
    The coefficient ``k = Y + 2 D`` of ``x y`` in the rows thus determines the columns up to an offset and ``D
    (x² + y²)``, which are observable only from motion [3]_. If the rows contain no information, k remains
    near zero. R and S are estimated from the rows to avoid a bias of k, but not applied: after a usable
    rectification they shift columns by less than the noise of one disparity.

    References
    ----------
    .. [1] T. Dang et al., Continuous Stereo Self-Calibration by Camera Parameter Tracking, IEEE TIP 18(7),
       2009, doi:10.1109/TIP.2009.2017824
    .. [2] D. Brown, Decentering Distortion of Lenses, Photogrammetric Engineering 32(3), 1966
    .. [3] I. Kreso, S. Segvic, Improving the Egomotion Estimation by Correcting the Calibration Bias, VISAPP
       2015, doi:10.5220/0005316103470356
    """

    def setup(self) -> None:
        """Reset the estimate."""
        self._mean = np.zeros(4)
        self._information = np.eye(4) / _SIGMA_PRIOR_PX**2
        self._count = 0.0

    def process(self, inputs: Inputs) -> Outputs:
        """Update the estimate and return the corrections."""
        features, disparities = (
            np.asarray(inputs.features, np.float64),
            np.asarray(inputs.disparities, np.float64),
        )
        n = len(features)
        K = inputs.camera_matrix
        x = (features[:, 0] - disparities - K[0, 2]) / K[0, 0]
        y = (features[:, 1] - K[1, 2]) / K[1, 1]
        design = np.column_stack([np.ones(n), x, y, x * y])
        residuals = np.full(n, np.nan)
        if inputs.row_offsets is not None:
            self._update(design, np.asarray(inputs.row_offsets, np.float64))
            residuals = inputs.row_offsets - design @ self._mean
        k = float(self._mean[3])
        sigma_decentring = self.config.sigma_offset_px + abs(k)
        return Outputs(
            corrections=k * x**2,
            basis=np.column_stack([np.ones(n), x**2 + y**2]),
            row_residuals=residuals,
            coefficients=self._mean.copy(),
            open_covariance=np.diag([self.config.sigma_offset_px**2, sigma_decentring**2]),
        )

    def _update(self, design: FloatArray, offsets: FloatArray) -> None:
        """Update the estimate by least squares with Cauchy weights; the previous estimate is the prior."""
        c = self.config
        prior = self._information * min(1.0, c.memory / max(self._count + len(offsets), 1.0))
        mean, information = self._mean, prior
        for _ in range(10):
            residuals = offsets - design @ mean
            weights = 1.0 / (c.sigma_row_px**2 * (1.0 + (residuals / (2.0 * c.sigma_row_px)) ** 2))
            information = prior + design.T @ (design * weights[:, None])
            step = np.linalg.solve(
                information, prior @ (self._mean - mean) + design.T @ (weights * residuals)
            )
            mean = mean + step
            if float(step @ information @ step) < 1e-6:
                break
        self._mean, self._information = mean, information
        self._count = min(self._count + len(offsets), float(c.memory))
