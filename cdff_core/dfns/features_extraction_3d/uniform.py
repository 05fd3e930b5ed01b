# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keypoints distributed evenly over the surface."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry.points import checked_points
from cdff_core.dfns.features_extraction_3d._scale import ScaleConfig, scale_m
from cdff_core.dfns.features_extraction_3d.interface import Inputs, Interface, Outputs


class Uniform(Interface[ScaleConfig]):
    """Point nearest to the centre of each occupied cell of a grid.

    If there are more than ``max_keypoints``, evenly spaced ones in the order of the cells are kept.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        points = checked_points(inputs.points, least=2)
        edge_m = scale_m(points, inputs.radius_m, self.config)
        cell = np.floor((points - points.min(axis=0)) / edge_m)
        centre_distance2 = np.sum(((points - points.min(axis=0)) / edge_m - cell - 0.5) ** 2, axis=1)
        order = np.lexsort((centre_distance2, cell[:, 2], cell[:, 1], cell[:, 0]))
        starts_cell = np.r_[True, np.any(np.diff(cell[order], axis=0) != 0.0, axis=1)]
        selected = order[starts_cell]
        if len(selected) > self.config.max_keypoints:
            selected = selected[np.linspace(0, len(selected) - 1, self.config.max_keypoints).astype(np.int64)]
        indices = np.sort(selected)
        return Outputs(keypoints=points[indices], indices=indices)
