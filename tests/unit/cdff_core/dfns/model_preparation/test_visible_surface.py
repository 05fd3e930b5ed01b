# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelPreparation: consistent arrays, repeatable, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from cdff_core.dfns.model_preparation.visible_surface import VisibleSurface
from tests.support import satellite
from tests.support.prepared_satellite import prepared


def test_grid_and_views_refer_to_points_of_the_surface() -> None:
    model = prepared()
    assert model.grid_index.min() >= 0
    assert model.grid_index.max() < len(model.points)
    np.testing.assert_allclose(np.linalg.norm(model.normals, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(model.view_directions, axis=1), 1.0, atol=1e-12)
    # The visible centroid lies on the side of its viewer.
    towards = np.einsum("ij,ij->i", model.view_centroids - model.centre_m, model.view_directions)
    assert np.mean(towards > 0.0) > 0.9
    assert model.diameter_m == pytest.approx(1.66, abs=0.1)
    assert model.symmetries.shape == (1, 4, 4)


def test_the_grid_returns_the_nearest_point_within_a_cell(rng: np.random.Generator) -> None:
    model = prepared()
    places = model.points[rng.permutation(len(model.points))[:200]] + rng.normal(0.0, 0.05, (200, 3))
    cell = ((places - model.grid_low) / model.grid_cell_m).astype(int)
    distances = np.linalg.norm(places - model.points[model.grid_index[tuple(cell.T)]], axis=1)
    exact = np.linalg.norm(places[:, None] - model.points[None], axis=2).min(axis=1)
    assert (distances - exact).max() < np.sqrt(3.0) * model.grid_cell_m


def test_two_preparations_are_equal_and_the_seed_changes_the_points() -> None:
    vertices, triangles = satellite.box((1.0, 0.6, 0.4))
    outputs = []
    for seed in (0, 0, 1):
        node = VisibleSurface()
        node.configure({"points": 1000, "views": 60, "view_pixels": 64, "grid_cells": 16, "seed": seed})
        outputs.append(node.process(ModelPreparationInputs(vertices=vertices, triangles=triangles)))
    np.testing.assert_array_equal(outputs[0].points, outputs[1].points)
    assert not np.array_equal(outputs[0].points[:50], outputs[2].points[:50])


def test_a_triangle_with_a_vertex_that_does_not_exist_is_refused() -> None:
    vertices, triangles = satellite.box((1.0, 0.6, 0.4))
    node = VisibleSurface()
    node.configure()
    with pytest.raises(InputError, match="vertex 8"):
        node.process(ModelPreparationInputs(vertices=vertices, triangles=np.vstack([triangles, [0, 1, 8]])))
