# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points of the second cloud are averaged with the first's where those are near, and added elsewhere."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_assembly._interface import (
    PointCloudAssemblyInputs,
    PointCloudAssemblyInterface,
    PointCloudAssemblyOutputs,
)
from cdff_core.dfns.point_cloud_assembly._view import in_view


class NeighbourPointAverageConfig(DfnConfig):
    """What is near."""

    distance_m: float = Field(0.05, gt=0.0, le=1000.0, description="Points this near are averaged, metres")


class NeighbourPointAverage(PointCloudAssemblyInterface):
    """Each point of the first cloud becomes the mean of itself and of the second's points that are nearest to it."""

    Config: ClassVar[type[DfnConfig]] = NeighbourPointAverageConfig

    def process(self, inputs: PointCloudAssemblyInputs) -> PointCloudAssemblyOutputs:
        """Return the joined cloud, the first's points in their order; raises InputError as ``in_view`` does."""
        from cdff_common.geometry.kdtree import kd_tree, nearest

        first, second = in_view(inputs)
        if not len(first) or not len(second):
            return PointCloudAssemblyOutputs(first if len(first) else second)
        distance_m, row = nearest(kd_tree(first), second, self.config.distance_m)
        near = np.isfinite(distance_m)
        count = 1.0 + np.bincount(row[near], minlength=len(first))
        total = np.stack(
            [np.bincount(row[near], weights=second[near, axis], minlength=len(first)) for axis in range(3)], axis=1
        )
        return PointCloudAssemblyOutputs(np.vstack([(first + total) / count[:, None], second[~near]]))
