# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keypoints spread evenly over the surface."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_3d._interface import (
    FeaturesExtraction3DInputs,
    FeaturesExtraction3DInterface,
    FeaturesExtraction3DOutputs,
)
from cdff_core.dfns.features_extraction_3d._scale import ScaleConfig, scale_m


class UniformConfig(ScaleConfig):
    """Edge of the cells and how many keypoints there may be."""


class Uniform(FeaturesExtraction3DInterface):
    """The point nearest to the middle of each occupied cell of a grid; of too many, evenly spaced ones."""

    Config: ClassVar[type[DfnConfig]] = UniformConfig

    def process(self, inputs: FeaturesExtraction3DInputs) -> FeaturesExtraction3DOutputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        p = checked_points(inputs.points, least=2)
        edge_m = scale_m(p, inputs.radius_m, self.config)
        cell = np.floor((p - p.min(axis=0)) / edge_m)
        off = np.sum(((p - p.min(axis=0)) / edge_m - cell - 0.5) ** 2, axis=1)
        order = np.lexsort((off, cell[:, 2], cell[:, 1], cell[:, 0]))
        is_first = np.r_[True, np.any(np.diff(cell[order], axis=0) != 0.0, axis=1)]
        chosen = order[is_first]
        if len(chosen) > self.config.max_keypoints:
            chosen = chosen[np.linspace(0, len(chosen) - 1, self.config.max_keypoints).astype(np.int64)]
        indices = np.sort(chosen)
        return FeaturesExtraction3DOutputs(keypoints=p[indices], indices=indices)
