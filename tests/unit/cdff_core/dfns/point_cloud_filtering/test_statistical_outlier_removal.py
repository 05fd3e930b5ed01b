# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""StatisticalOutlierRemoval: isolated points are removed, sparse regions are kept."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
from cdff_core.dfns.point_cloud_filtering.statistical_outlier_removal import StatisticalOutlierRemoval


def test_isolated_points_are_removed_and_points_on_the_ground_remain(rng: np.random.Generator) -> None:
    ground = np.c_[rng.uniform(-5, 5, (3000, 2)), np.zeros(3000)]
    isolated = np.c_[rng.uniform(-5, 5, (20, 2)), rng.uniform(5, 50, 20)]
    node = StatisticalOutlierRemoval()
    node.configure()
    outputs = node.process(PointCloudFilteringInputs(points=np.vstack([ground, isolated])))
    assert np.count_nonzero(outputs.kept >= 3000) <= 1
    assert np.count_nonzero(outputs.kept < 3000) > 2950


def test_points_that_are_not_finite_are_removed(rng: np.random.Generator) -> None:
    points = rng.normal(size=(100, 3))
    points[7] = np.nan
    node = StatisticalOutlierRemoval()
    node.configure()
    assert 7 not in node.process(PointCloudFilteringInputs(points=points)).kept


def test_too_few_points_are_refused() -> None:
    node = StatisticalOutlierRemoval()
    node.configure({"neighbours": 8})
    with pytest.raises(InputError, match="neighbours=8"):
        node.process(PointCloudFilteringInputs(points=np.zeros((5, 3))))
