# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth from disparity with its standard deviation.

References
----------
.. [1] Matthies, L., Shafer, S. (1987). Error modeling in stereo navigation. IEEE J. Robotics and Automation
   3(3). doi:10.1109/JRA.1987.1087097
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.disparity_to_point_cloud.interface import Inputs, Interface, Outputs


class TriangulationConfig(DfnConfig):
    """Parameters of Triangulation."""

    sigma_px: float = Field(0.3, gt=0, le=10, description="Standard deviation of the disparities")
    max_depth_sigma_m: float = Field(
        0.3,
        gt=0,
        le=1000,
        description="Largest standard deviation of the depth of a point that is kept, by the noise",
    )
    min_depth_m: float = Field(0.3, ge=0, description="Smallest depth that is kept")
    max_depth_m: float = Field(100.0, gt=0, description="Largest depth that is kept")
    focal_length_ratio: float = Field(
        0.005, ge=0, le=0.2, description="Standard deviation of the relative error of the focal length"
    )
    baseline_ratio: float = Field(
        0.005, ge=0, le=0.2, description="Standard deviation of the relative error of the baseline"
    )
    step_px: int = Field(1, ge=1, le=64, description="Step in columns and rows between the pixels used")


class Triangulation(Interface[TriangulationConfig]):
    """Triangulation by ``z = f B / d``, with the first-order error ``sigma_z = z^2 / (f B) sigma_d`` [1]_.

    An error of focal length or baseline changes all depths by the same ratio. One pair of images does not
    reveal it. The defaults are assumptions: a careful calibration with a printed target, some months old.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the points; raises InputError if the camera matrix is missing or the sizes differ."""
        cfg = self.config
        disparity, K = inputs.disparity.image, inputs.disparity.camera_matrix
        baseline_m = inputs.baseline_m
        if disparity.ndim != 2:
            raise InputError(f"disparity: shape {disparity.shape}, expected (rows, cols)")
        if not (K[0, 0] > 0.0 and K[1, 1] > 0.0):
            raise InputError(f"disparity: focal lengths {K[0, 0]}, {K[1, 1]} px, expected a camera matrix")
        sampled = disparity[:: cfg.step_px, :: cfg.step_px]
        with np.errstate(divide="ignore", invalid="ignore"):
            z_m = K[0, 0] * baseline_m / sampled.astype(np.float64)
            sigma_m = z_m**2 * (cfg.sigma_px / (K[0, 0] * baseline_m))
            # Points with disparities of 0 or less are at infinity; comparisons with NaN are false.
            is_valid = (
                (sampled > 0)
                & (z_m >= cfg.min_depth_m)
                & (z_m <= cfg.max_depth_m)
                & (sigma_m <= cfg.max_depth_sigma_m)
            )
        row, col = np.nonzero(is_valid)
        z_m, row, col = z_m[is_valid], row * cfg.step_px, col * cfg.step_px
        points = np.stack([(col - K[0, 2]) * z_m / K[0, 0], (row - K[1, 2]) * z_m / K[1, 1], z_m], axis=1)
        return Outputs(
            points=points,
            depth_sigma_m=sigma_m[is_valid],
            scale_sigma=float(np.hypot(cfg.focal_length_ratio, cfg.baseline_ratio)),
            intensity=self._intensity(inputs, row, col),
        )

    @staticmethod
    def _intensity(inputs: Inputs, row: NDArray[np.intp], col: NDArray[np.intp]) -> NDArray[np.int32]:
        """Return the grey values ``(n,)`` of the left image at rows and columns."""
        if inputs.left is None:
            return np.zeros(len(row), np.int32)
        image = inputs.left.image
        if image.shape[:2] != inputs.disparity.image.shape:
            raise InputError(
                f"left image {image.shape}, disparity {inputs.disparity.image.shape}: expected the same size"
            )
        values = image[row, col]
        return np.asarray(values if values.ndim == 1 else values[:, :3].mean(axis=1), dtype=np.int32)
