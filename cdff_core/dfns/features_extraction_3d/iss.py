# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Intrinsic shape signatures: keypoints where the surface varies differently along three axes."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.neighbours import radius_neighbours
from cdff_common.geometry.points import checked_points
from cdff_core.dfns.features_extraction_3d._kernels import weighted_scatters
from cdff_core.dfns.features_extraction_3d._scale import SalienceConfig, scale_m, select_most_salient
from cdff_core.dfns.features_extraction_3d.interface import Inputs, Interface, Outputs


class IssConfig(SalienceConfig):
    """Parameters of Iss."""

    max_ratio_21: float = Field(
        0.975, gt=0, le=1, description="Largest ratio of the second largest to the largest eigenvalue"
    )
    max_ratio_32: float = Field(
        0.975, gt=0, le=1, description="Largest ratio of the smallest to the second largest eigenvalue"
    )
    least_neighbours: int = Field(
        6, ge=4, le=10_000, description="Minimum number of points of a neighbourhood"
    )


class Iss(Interface[IssConfig]):
    """Local maxima of the smallest eigenvalue of the scatter, if the ratios of the eigenvalues are below
    bounds.

    Zhong (2009), doi:10.1109/ICCVW.2009.5457637. The scatter is about the point, and neighbours are weighted
    by the inverse of their own number of neighbours.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        self._salience(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), 1.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        points = checked_points(inputs.points, least=2)
        radius_m = scale_m(points, inputs.radius_m, self.config)
        return select_most_salient(points, self._salience(points, radius_m), 0.0, radius_m, self.config)

    def _salience(self, points: np.ndarray, radius_m: float) -> np.ndarray:
        """Return the smallest eigenvalue (n,) of the scatter of each point, m^2; 0 if it is no candidate."""
        cfg = self.config
        start, index = radius_neighbours(points, points, radius_m)
        neighbour_count = np.diff(start)
        smallest, middle, largest = np.linalg.eigvalsh(weighted_scatters(points, start, index)).T
        is_candidate = (neighbour_count >= cfg.least_neighbours) & (middle < cfg.max_ratio_21 * largest)
        is_candidate &= (smallest < cfg.max_ratio_32 * middle) & (smallest > 1e-9 * largest)
        return np.where(is_candidate, smallest, 0.0)
