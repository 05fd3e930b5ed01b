# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EpipolarField: a small relative rotation and decentring of the right camera, from the rows of matched points."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.rectification_refinement._interface import (
    RectificationRefinementInputs,
    RectificationRefinementInterface,
    RectificationRefinementOutputs,
)

FloatArray = NDArray[np.float64]


class EpipolarFieldConfig(DfnConfig):
    """Noise of row offsets and of what a calibration leaves over."""

    sigma_row_px: Annotated[float, Field(gt=0, le=10)] = 0.2
    sigma_prior_px: Annotated[float, Field(gt=0, le=100)] = 5.0
    sigma_offset_px: Annotated[float, Field(gt=0, le=5)] = 0.25
    memory: Annotated[int, Field(ge=10)] = 20_000


class EpipolarField(RectificationRefinementInterface):
    """Continuous self-calibration [1]_ of the part of a rectification that shows in rows.

    To first order, with ``x, y`` the normalised coordinates in the right image, the right camera's rotation
    (pitch P, yaw Y, roll R), scale S and decentring D (all in pixels, i.e. times the focal length) move its points by

    ====  =======================================  =====================================
    term  rows                                     columns
    ====  =======================================  =====================================
    R     ``R x``                                  ``-R y``
    S     ``S y``                                  ``S x``
    Y     ``Y x y``                                ``Y (1 + x2)``
    D     ``2 D x y`` (decentring p2 of [2]_)      ``D (3 x2 + y2)``
    ====  =======================================  =====================================

    (a principal point that is off comes with both Y and D: it shifts the centre of the lens distortion). The
    coefficient ``k = Y + 2 D`` of ``xy`` in the rows so fixes the columns up to an offset and ``D (x2 + y2)``: those
    two stay open, and only motion can tell them [3]_. Where the rows show nothing, D is held near zero. R and S are
    learnt from the rows, so as not to bias k, and left at that: for a rectification worth the name they move columns by
    less than the noise of one disparity.

    References
    ----------
    .. [1] T. Dang et al., Continuous Stereo Self-Calibration by Camera Parameter Tracking, IEEE TIP 18(7), 2009,
       doi:10.1109/TIP.2009.2017824
    .. [2] D. Brown, Decentering Distortion of Lenses, Photogrammetric Engineering 32(3), 1966
    .. [3] I. Kreso, S. Segvic, Improving the Egomotion Estimation by Correcting the Calibration Bias, VISAPP 2015,
       doi:10.5220/0005316103470356
    """

    Config = EpipolarFieldConfig
    config: EpipolarFieldConfig

    def setup(self) -> None:
        """Forget everything learnt."""
        self._mean = np.zeros(4)
        self._information = np.eye(4) / self.config.sigma_prior_px**2
        self._count = 0.0

    def process(self, inputs: RectificationRefinementInputs) -> RectificationRefinementOutputs:
        """Learn where row offsets are given, and say what is known; raises InputError where shapes do not fit."""
        features, disparities = np.asarray(inputs.features, np.float64), np.asarray(inputs.disparities, np.float64)
        n = len(features)
        if features.shape != (n, 2) or disparities.shape != (n,):
            raise InputError(f"features {features.shape}, disparities {disparities.shape}: expected (n, 2), (n,)")
        K = inputs.camera_matrix
        x = (features[:, 0] - disparities - K[0, 2]) / K[0, 0]
        y = (features[:, 1] - K[1, 2]) / K[1, 1]
        design = np.column_stack([np.ones(n), x, y, x * y])
        residuals = np.full(n, np.nan)
        if inputs.row_offsets is not None:
            if inputs.row_offsets.shape != (n,):
                raise InputError(f"row offsets {inputs.row_offsets.shape}: expected ({n},)")
            self._learn(design, np.asarray(inputs.row_offsets, np.float64))
            residuals = inputs.row_offsets - design @ self._mean
        k = float(self._mean[3])
        sigma_decentring = self.config.sigma_offset_px + abs(k)
        return RectificationRefinementOutputs(
            corrections=k * x**2,
            basis=np.column_stack([np.ones(n), x**2 + y**2]),
            row_residuals=residuals,
            coefficients=self._mean.copy(),
            open_covariance=np.diag([self.config.sigma_offset_px**2, sigma_decentring**2]),
        )

    def _learn(self, design: FloatArray, offsets: FloatArray) -> None:
        """Robust least squares (Cauchy weights) on top of what is remembered."""
        c = self.config
        before, mean = self._information * min(1.0, c.memory / max(self._count + len(offsets), 1.0)), self._mean
        information = before
        for _ in range(10):
            residuals = offsets - design @ mean
            weights = 1.0 / (c.sigma_row_px**2 * (1.0 + (residuals / (2.0 * c.sigma_row_px)) ** 2))
            information = before + design.T @ (design * weights[:, None])
            step = np.linalg.solve(information, before @ (self._mean - mean) + design.T @ (weights * residuals))
            mean = mean + step
            if float(step @ information @ step) < 1e-6:
                break
        self._mean, self._information = mean, information
        self._count = min(self._count + len(offsets), float(c.memory))
