# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assembly by averaging the points of the second cloud with nearby points of the first."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.kdtree import kd_tree, nearest
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_assembly._view import crop_to_view
from cdff_core.dfns.point_cloud_assembly.interface import Inputs, Interface, Outputs


class NeighbourPointAverageConfig(DfnConfig):
    """Parameters of NeighbourPointAverage."""

    distance_m: float = Field(0.05, gt=0, le=1000, description="Distance below which two points are averaged")


class NeighbourPointAverage(Interface[NeighbourPointAverageConfig]):
    """Replace each point of the first cloud by its mean with the points of the second cloud that are nearest
    to it, and add the other points of the second cloud.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the joined cloud, the points of the first cloud first; raises InputError as
        ``crop_to_view``.
        """
        first, second = crop_to_view(inputs)
        if not len(first) or not len(second):
            return Outputs(assembled_points=first if len(first) else second)
        distance_m, row = nearest(kd_tree(first), second, self.config.distance_m)
        is_near = np.isfinite(distance_m)
        count = 1.0 + np.bincount(row[is_near], minlength=len(first))
        total = np.stack(
            [
                np.bincount(row[is_near], weights=second[is_near, axis], minlength=len(first))
                for axis in range(3)
            ],
            axis=1,
        )
        return Outputs(assembled_points=np.vstack([(first + total) / count[:, None], second[~is_near]]))
