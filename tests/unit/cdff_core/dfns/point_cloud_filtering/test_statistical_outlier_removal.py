# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""StatisticalOutlierRemoval: isolated points are removed, sparse regions are kept."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
from cdff_core.dfns.point_cloud_filtering.statistical_outlier_removal import StatisticalOutlierRemoval


def test_isolated_points_are_dropped_and_the_ground_is_kept(rng: np.random.Generator) -> None:
    ground = np.c_[rng.uniform(-5, 5, (3000, 2)), np.zeros(3000)]
    air = np.c_[rng.uniform(-5, 5, (20, 2)), rng.uniform(5, 50, 20)]
    node = StatisticalOutlierRemoval()
    node.configure()
    out = node.process(PointCloudFilteringInputs(points=np.vstack([ground, air])))
    assert np.count_nonzero(out.kept >= 3000) <= 1
    assert np.count_nonzero(out.kept < 3000) > 2950


def test_points_that_are_not_finite_are_dropped(rng: np.random.Generator) -> None:
    points = rng.normal(size=(100, 3))
    points[7] = np.nan
    node = StatisticalOutlierRemoval()
    node.configure()
    assert 7 not in node.process(PointCloudFilteringInputs(points=points)).kept


def test_too_few_points_are_an_error() -> None:
    node = StatisticalOutlierRemoval()
    node.configure({"neighbours": 8})
    with pytest.raises(InputError, match="neighbours=8"):
        node.process(PointCloudFilteringInputs(points=np.zeros((5, 3))))
