# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Intrinsic shape signatures: keypoints where the surface varies along all three axes, and differently."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_3d._interface import (
    FeaturesExtraction3DInputs,
    FeaturesExtraction3DInterface,
    FeaturesExtraction3DOutputs,
)
from cdff_core.dfns.features_extraction_3d._scale import ScaleConfig, scale_m


class IssConfig(ScaleConfig):
    """Neighbourhoods, and what is salient."""

    radius_spacings: float = Field(6.0, ge=1.0, le=200.0, description="Radius in median point spacings")
    max_ratio_21: float = Field(0.975, gt=0.0, le=1.0, description="Largest second over first eigenvalue")
    max_ratio_32: float = Field(0.975, gt=0.0, le=1.0, description="Largest third over second eigenvalue")
    least_neighbours: int = Field(6, ge=4, le=10_000, description="Fewest points of a neighbourhood")
    suppression: float = Field(0.67, gt=0.0, le=10.0, description="Radius of non-maximum suppression, in radii")


class Iss(FeaturesExtraction3DInterface):
    """Points whose least eigenvalue is the greatest around, where the ratios of the eigenvalues are below the bounds.

    Zhong (2009), doi:10.1109/ICCVW.2009.5457637; the scatter is about the point and neighbours weigh the inverse of
    how many neighbours they have themselves.
    """

    Config: ClassVar[type[DfnConfig]] = IssConfig

    def setup(self) -> None:
        """Compile the kernels, so that the first call costs what the others do."""
        self._salience(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), 1.0)

    def process(self, inputs: FeaturesExtraction3DInputs) -> FeaturesExtraction3DOutputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        from cdff_common.geometry.neighbours import radius_neighbours
        from cdff_core.dfns.features_extraction_3d._iss_kernels import greatest_around

        cfg: Any = self.config
        p = checked_points(inputs.points, least=2)
        radius_m = scale_m(p, inputs.radius_m, cfg)
        salience = self._salience(p, radius_m)
        salient = np.flatnonzero(salience > 0.0)
        start, index = radius_neighbours(p, p[salient], cfg.suppression * radius_m)
        chosen = salient[greatest_around(salience, salient, start, index)]
        if len(chosen) > cfg.max_keypoints:
            chosen = chosen[np.argsort(-salience[chosen], kind="stable")[: cfg.max_keypoints]]
        indices = np.sort(chosen)
        return FeaturesExtraction3DOutputs(keypoints=p[indices], indices=indices)

    def _salience(self, p: np.ndarray, radius_m: float) -> np.ndarray:
        """Least eigenvalue of each point's scatter (n,), square metres; 0 where it is no candidate."""
        from cdff_common.geometry.neighbours import radius_neighbours
        from cdff_core.dfns.features_extraction_3d._iss_kernels import scatters

        cfg: Any = self.config
        start, index = radius_neighbours(p, p, radius_m)
        count = np.diff(start)
        third, second, first = np.linalg.eigvalsh(scatters(p, start, index)).T
        candidate = (count >= cfg.least_neighbours) & (second < cfg.max_ratio_21 * first)
        candidate &= (third < cfg.max_ratio_32 * second) & (third > 1e-9 * first)
        return np.where(candidate, third, 0.0)
