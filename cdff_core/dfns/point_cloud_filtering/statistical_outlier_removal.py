# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drop points whose neighbours are unusually far away."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_filtering._interface import (
    PointCloudFilteringInputs,
    PointCloudFilteringInterface,
    PointCloudFilteringOutputs,
)


class StatisticalOutlierRemovalConfig(DfnConfig):
    """How isolated a point may be."""

    neighbours: int = Field(8, ge=1, le=200, description="Neighbours whose mean distance is judged")
    deviations: float = Field(6.0, gt=0.0, le=100.0, description="Robust standard deviations above the median")


class StatisticalOutlierRemoval(PointCloudFilteringInterface):
    """Judge each point by the mean distance to its nearest neighbours.

    Notes
    -----
    As Rusu et al. (2008), "Towards 3D point cloud based object maps", doi:10.1016/j.robot.2008.08.005, section 4, with
    median and median absolute deviation of the logarithm in place of mean and standard deviation, so that a lidar's
    falling density with range is not taken for outliers and outliers do not widen the gate.
    """

    Config: ClassVar[type[DfnConfig]] = StatisticalOutlierRemovalConfig

    def process(self, inputs: PointCloudFilteringInputs) -> PointCloudFilteringOutputs:
        """Return the points with neighbours; raises InputError if none is left."""
        from cdff_common.geometry.kdtree import kd_tree, neighbours

        p = checked_points(inputs.points, finite=False)
        finite = np.flatnonzero(np.all(np.isfinite(p), axis=1))
        k = self.config.neighbours
        if len(finite) <= k:
            raise InputError(f"points: {len(finite)} finite of {len(p)}, expected more than neighbours={k}")
        tree = kd_tree(p[finite])
        distance_m, _ = neighbours(tree, tree.points, k + 1)
        isolation = np.empty(len(finite))
        isolation[tree.order] = np.log(np.maximum(distance_m[:, 1:].mean(axis=1), 1e-12))
        centre = np.median(isolation)
        spread = 1.4826 * np.median(np.abs(isolation - centre))
        kept = finite[isolation <= centre + self.config.deviations * max(float(spread), 1e-3)]
        return PointCloudFilteringOutputs(filtered_points=p[kept], kept=kept.astype(np.int64))
