# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small relative rotation and decentring of the right camera, from the rows of matched points."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.rectification_refinement.interface import Inputs, Interface, Outputs

#: Prior standard deviation of each coefficient: above that of any usable rectification.
_SIGMA_PRIOR_PX = 5.0


class EpipolarFieldConfig(DfnConfig):
    """Parameters of EpipolarField."""

    sigma_row_px: float = Field(0.2, gt=0, le=10, description="Standard deviation of a row offset")
    sigma_offset_px: float = Field(
        0.25, gt=0, le=5, description="Standard deviation of the remaining disparity offset"
    )
    memory: int = Field(20_000, ge=10, description="Effective number of remembered row offsets")


class EpipolarField(Interface[EpipolarFieldConfig]):
    """Continuous self-calibration [1]_ of the part of a rectification that shows in rows.

    To first order, with ``x, y`` the normalised coordinates in the right image, the right camera's rotation
    (pitch P, yaw Y, roll R), scale S and decentring D (all in pixels, i.e. times the focal length) move its
    points by

    ====  =======================================  =====================================
    term  rows                                     columns
    ====  =======================================  =====================================
    R     ``R x``                                  ``-R y``
    S     ``S y``                                  ``S x``
    Y     ``Y x y``                                ``Y (1 + x2)``
    D     ``2 D x y`` (decentring p2 of [2]_)      ``D (3 x2 + y2)``
    ====  =======================================  =====================================

    (an error of the principal point changes both Y and D: it shifts the centre of the lens distortion). The
    coefficient ``k = Y + 2 D`` of ``xy`` in the rows so fixes the columns up to an offset and ``D (x2 +
    y2)``: these two are observable only from motion [3]_. Where the rows have no information, D stays near
    zero. R and S are estimated from the rows to avoid a bias of k, but not applied: after a usable
    rectification they move columns by less than the noise of one disparity.

    References
    ----------
    .. [1] T. Dang et al., Continuous Stereo Self-Calibration by Camera Parameter Tracking, IEEE TIP 18(7),
       2009,
       doi:10.1109/TIP.2009.2017824
    .. [2] D. Brown, Decentering Distortion of Lenses, Photogrammetric Engineering 32(3), 1966
    .. [3] I. Kreso, S. Segvic, Improving the Egomotion Estimation by Correcting the Calibration Bias, VISAPP
       2015,
       doi:10.5220/0005316103470356
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
            self._learn(design, np.asarray(inputs.row_offsets, np.float64))
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

    def _learn(self, design: FloatArray, offsets: FloatArray) -> None:
        """Update by robust least squares (Cauchy weights) with the previous estimate as prior."""
        c = self.config
        before, mean = (
            self._information * min(1.0, c.memory / max(self._count + len(offsets), 1.0)),
            self._mean,
        )
        information = before
        for _ in range(10):
            residuals = offsets - design @ mean
            weights = 1.0 / (c.sigma_row_px**2 * (1.0 + (residuals / (2.0 * c.sigma_row_px)) ** 2))
            information = before + design.T @ (design * weights[:, None])
            step = np.linalg.solve(
                information, before @ (self._mean - mean) + design.T @ (weights * residuals)
            )
            mean = mean + step
            if float(step @ information @ step) < 1e-6:
                break
        self._mean, self._information = mean, information
        self._count = min(self._count + len(offsets), float(c.memory))
