# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Intrinsic shape signatures: keypoints where the surface varies differently along three axes."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.neighbours import radius_neighbours
from cdff_common.geometry.points import checked_points
from cdff_core.dfns.features_extraction_3d._kernels import scatters
from cdff_core.dfns.features_extraction_3d._scale import SalienceConfig, most_salient, scale_m
from cdff_core.dfns.features_extraction_3d.interface import Inputs, Interface, Outputs


class IssConfig(SalienceConfig):
    """Parameters of Iss."""

    max_ratio_21: float = Field(
        0.975, gt=0, le=1, description="Largest ratio of the second to the first eigenvalue"
    )
    max_ratio_32: float = Field(
        0.975, gt=0, le=1, description="Largest ratio of the third to the second eigenvalue"
    )
    least_neighbours: int = Field(
        6, ge=4, le=10_000, description="Minimum number of points of a neighbourhood"
    )


class Iss(Interface[IssConfig]):
    """Local maxima of the least eigenvalue of the scatter, where the ratios of the eigenvalues are below the
    bounds.

    Zhong (2009), doi:10.1109/ICCVW.2009.5457637; the scatter is about the point, and neighbours are weighted
    by the inverse of their own number of neighbours.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        self._salience(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), 1.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        p = checked_points(inputs.points, least=2)
        radius_m = scale_m(p, inputs.radius_m, self.config)
        return most_salient(p, self._salience(p, radius_m), 0.0, radius_m, self.config)

    def _salience(self, p: np.ndarray, radius_m: float) -> np.ndarray:
        """Return the least eigenvalue of each point's scatter (n,), m^2; 0 where it is no candidate."""
        cfg = self.config
        start, index = radius_neighbours(p, p, radius_m)
        count = np.diff(start)
        third, second, first = np.linalg.eigvalsh(scatters(p, start, index)).T
        candidate = (count >= cfg.least_neighbours) & (second < cfg.max_ratio_21 * first)
        candidate &= (third < cfg.max_ratio_32 * second) & (third > 1e-9 * first)
        return np.where(candidate, third, 0.0)
