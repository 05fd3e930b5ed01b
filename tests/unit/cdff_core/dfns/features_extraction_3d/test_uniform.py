# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Uniform keypoints: one for each cell of a grid."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.features_extraction_3d.interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_extraction_3d.uniform import Uniform
from tests.support import surfaces


def make_node(**config: object) -> Uniform:
    node = Uniform()
    node.configure(config)
    return node


def test_each_cell_gives_the_point_nearest_to_its_centre() -> None:
    points = np.array([[0.0, 0, 0], [0.4, 0.5, 0.5], [1.9, 0.1, 0.1], [1.6, 0.5, 0.5]])
    out = make_node(radius_m=1.0).process(FeaturesExtraction3DInputs(points=points))
    assert out.indices.tolist() == [1, 3]
    assert np.array_equal(out.keypoints, points[[1, 3]])


def test_the_port_overrides_the_configured_edge(rng: np.random.Generator) -> None:
    points = surfaces.terrain(rng)
    out = make_node(radius_m=0.1).process(FeaturesExtraction3DInputs(points=points, radius_m=5.0))
    assert len(out.indices) <= 64


def test_the_maximum_number_of_keypoints_is_spread_over_the_cloud(rng: np.random.Generator) -> None:
    out = make_node(max_keypoints=100).process(FeaturesExtraction3DInputs(points=surfaces.terrain(rng)))
    assert len(out.indices) == 100
    assert np.all(np.ptp(out.keypoints[:, :2], axis=0) > 17.0)


def test_values_that_are_not_finite_are_refused() -> None:
    with pytest.raises(InputError, match="not finite"):
        make_node().process(FeaturesExtraction3DInputs(points=np.full((10, 3), np.nan)))
    with pytest.raises(InputError, match="radius_m"):
        make_node().process(FeaturesExtraction3DInputs(points=np.eye(3), radius_m=-1.0))
