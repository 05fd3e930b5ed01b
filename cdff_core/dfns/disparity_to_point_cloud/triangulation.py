# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth from disparity, with its uncertainty.

References
----------
.. [1] Matthies, L., Shafer, S. (1987). Error modeling in stereo navigation. IEEE J. Robotics and Automation 3(3).
   doi:10.1109/JRA.1987.1087097
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.disparity_to_point_cloud._interface import (
    DisparityToPointCloudInputs,
    DisparityToPointCloudInterface,
    DisparityToPointCloudOutputs,
)


class TriangulationConfig(DfnConfig):
    """What is kept, and how certain a disparity is."""

    sigma_px: float = Field(0.3, gt=0.0, le=10.0, description="Standard deviation of a disparity, px")
    max_depth_sigma_m: float = Field(0.3, gt=0.0, le=1000.0, description="Largest depth sigma kept, metres")
    min_depth_m: float = Field(0.3, ge=0.0, description="Nearest depth kept, metres")
    max_depth_m: float = Field(100.0, gt=0.0, description="Farthest depth kept, metres")
    step_px: int = Field(1, ge=1, le=64, description="Every how many columns and rows a pixel is used")


class Triangulation(DisparityToPointCloudInterface):
    """z = f B / d and sigma_z = z^2 / (f B) sigma_d, first order ([1]_)."""

    Config: ClassVar[type[DfnConfig]] = TriangulationConfig

    def process(self, inputs: DisparityToPointCloudInputs) -> DisparityToPointCloudOutputs:
        """Return the points; raises InputError without camera matrix or baseline."""
        c = self.config
        disparity, K, baseline_m = inputs.disparity.image, inputs.disparity.camera_matrix, float(inputs.baseline_m)
        if disparity.ndim != 2:
            raise InputError(f"disparity: shape {disparity.shape}, expected (rows, cols)")
        if not (K[0, 0] > 0.0 and K[1, 1] > 0.0):
            raise InputError(f"disparity: focal lengths {K[0, 0]}, {K[1, 1]} px, expected a camera matrix")
        if not (np.isfinite(baseline_m) and baseline_m > 0.0):
            raise InputError(f"baseline_m={baseline_m}: expected metres above 0")
        sampled = disparity[:: c.step_px, :: c.step_px]
        with np.errstate(divide="ignore", invalid="ignore"):
            z = K[0, 0] * baseline_m / sampled.astype(np.float64)
            sigma = z**2 * (c.sigma_px / (K[0, 0] * baseline_m))
            # A disparity at or below zero is at or beyond infinity; comparisons with NaN are false.
            keep = (sampled > 0) & (z >= c.min_depth_m) & (z <= c.max_depth_m) & (sigma <= c.max_depth_sigma_m)
        row, col = np.nonzero(keep)
        z, row, col = z[keep], row * c.step_px, col * c.step_px
        points = np.stack([(col - K[0, 2]) * z / K[0, 0], (row - K[1, 2]) * z / K[1, 1], z], axis=1)
        return DisparityToPointCloudOutputs(
            points=points, depth_sigma_m=sigma[keep], intensity=self._intensity(inputs, row, col)
        )

    @staticmethod
    def _intensity(
        inputs: DisparityToPointCloudInputs, row: NDArray[np.intp], col: NDArray[np.intp]
    ) -> NDArray[np.int32]:
        if inputs.left is None:
            return np.zeros(len(row), np.int32)
        image = inputs.left.image
        if image.shape[:2] != inputs.disparity.image.shape:
            raise InputError(f"left image {image.shape}, disparity {inputs.disparity.image.shape}: expected one size")
        values = image[row, col]
        return np.asarray(values if values.ndim == 1 else values[:, :3].mean(axis=1), dtype=np.int32)
