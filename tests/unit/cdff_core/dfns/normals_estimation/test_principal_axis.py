# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PrincipalAxis: normals of planes and spheres, with signs towards the viewpoint."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_core.dfns.normals_estimation.principal_axis import PrincipalAxis


def make_node(**config: object) -> PrincipalAxis:
    node = PrincipalAxis()
    node.configure(config)
    return node


def test_a_plane_below_the_sensor_has_normals_that_point_up(rng: np.random.Generator) -> None:
    points = np.c_[rng.uniform(-5, 5, (500, 2)), np.full(500, -1.0) + rng.normal(0, 0.001, 500)]
    outputs = make_node().process(NormalsEstimationInputs(points=points))
    assert np.all(outputs.normals[:, 2] > 0.99)
    assert 0.0005 < np.median(outputs.roughness_m) < 0.0015


def test_a_sphere_seen_from_inside_has_radial_normals(rng: np.random.Generator) -> None:
    radial = rng.normal(size=(5000, 3))
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    outputs = make_node().process(NormalsEstimationInputs(points=3.0 * radial))
    assert np.median(np.einsum("ij,ij->i", outputs.normals, -radial)) > 0.999


def test_fewer_points_than_a_neighbourhood_are_refused() -> None:
    with pytest.raises(InputError, match="at least 12"):
        make_node().process(NormalsEstimationInputs(points=np.zeros((5, 3))))
