# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Removal of points whose mean distance to their neighbours is unusually large."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.kdtree import kd_tree, neighbours
from cdff_common.geometry.points import checked_points
from cdff_common.geometry.robust import median_sigma
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_filtering.interface import Inputs, Interface, Outputs


class StatisticalOutlierRemovalConfig(DfnConfig):
    """Parameters of StatisticalOutlierRemoval."""

    neighbours: int = Field(8, ge=1, le=200, description="Number of neighbours whose mean distance is tested")
    deviations: float = Field(
        6.0,
        gt=0,
        le=100,
        description="Robust standard deviations above the median at which a point is an outlier",
    )


class StatisticalOutlierRemoval(Interface[StatisticalOutlierRemovalConfig]):
    """Remove points with a large mean distance to their nearest neighbours.

    Notes
    -----
    After Rusu et al. (2008), "Towards 3D point cloud based object maps", doi:10.1016/j.robot.2008.08.005,
    section 4, with median and median absolute deviation of the logarithm in place of mean and standard
    deviation, so that points are not outliers because the density of a lidar cloud decreases with range, and
    outliers do not widen the gate.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the remaining points; raises InputError if the cloud has too few finite points."""
        p = checked_points(inputs.points, finite=False)
        finite = np.flatnonzero(np.all(np.isfinite(p), axis=1))
        k = self.config.neighbours
        if len(finite) <= k:
            raise InputError(f"points: {len(finite)} finite of {len(p)}, expected more than neighbours={k}")
        tree = kd_tree(p[finite])
        distance_m, _ = neighbours(tree, tree.points, k + 1)
        log_distance = np.empty(len(finite))
        log_distance[tree.order] = np.log(np.maximum(distance_m[:, 1:].mean(axis=1), 1e-12))
        median = np.median(log_distance)
        limit = median + self.config.deviations * max(median_sigma(log_distance - median), 1e-3)
        kept_rows = finite[log_distance <= limit]
        return Outputs(filtered_points=p[kept_rows], kept=kept_rows.astype(np.int64))
