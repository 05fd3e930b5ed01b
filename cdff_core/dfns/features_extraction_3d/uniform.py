# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keypoints spread evenly over the surface."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry.points import checked_points
from cdff_core.dfns.features_extraction_3d._scale import ScaleConfig, scale_m
from cdff_core.dfns.features_extraction_3d.interface import Inputs, Interface, Outputs


class Uniform(Interface[ScaleConfig]):
    """The point nearest to the middle of each occupied cell of a grid; of too many, evenly spaced ones."""

    def process(self, inputs: Inputs) -> Outputs:
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
        return Outputs(keypoints=p[indices], indices=indices)
