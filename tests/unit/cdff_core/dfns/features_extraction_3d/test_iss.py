# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ISS keypoints: none on a plane, some on relief, independent of the pose."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfns.features_extraction_3d.interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_extraction_3d.iss import Iss
from tests.support import surfaces


def make_node(**config: object) -> Iss:
    node = Iss()
    node.configure(config)
    return node


def test_a_plane_has_no_keypoints() -> None:
    x, y = np.meshgrid(np.arange(0.0, 10.0, 0.2), np.arange(0.0, 10.0, 0.21))
    flat = np.c_[x.ravel(), y.ravel(), np.zeros(x.size)]
    assert len(make_node().process(FeaturesExtraction3DInputs(points=flat)).indices) == 0


def test_a_bump_on_a_plane_is_detected(rng: np.random.Generator) -> None:
    xy = rng.uniform(-5, 5, (6000, 2))
    points = np.c_[xy, 1.5 * np.exp(-8.0 * np.sum((xy - [1.0, 2.0]) ** 2, axis=1))]
    out = make_node(radius_m=0.6, max_keypoints=3).process(FeaturesExtraction3DInputs(points=points))
    assert len(out.indices) == 3
    assert np.all(np.linalg.norm(out.keypoints[:, :2] - [1.0, 2.0], axis=1) < 1.0)


def test_keypoints_rotate_with_the_cloud(rng: np.random.Generator) -> None:
    points = surfaces.terrain(rng, 3000)
    rotated = se3.transform_points(se3.exp_se3([3.0, -1.0, 2.0, 0.4, 0.2, 2.0]), points)
    indices, indices_rotated = (
        make_node(radius_m=1.0).process(FeaturesExtraction3DInputs(points=p)).indices
        for p in (points, rotated)
    )
    assert len(indices) > 20
    assert len(np.intersect1d(indices, indices_rotated)) >= 0.99 * len(indices)


def test_the_smallest_eigenvalue_is_that_of_the_weighted_scatter(rng: np.random.Generator) -> None:
    points = rng.normal(size=(60, 3)) * [3.0, 2.0, 1.0]
    node = make_node(least_neighbours=4, max_ratio_21=1.0, max_ratio_32=1.0)
    salience = node._salience(points, 2.5)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= 2.5
    weight = 1.0 / near.sum(axis=1)
    for i in np.flatnonzero(salience):
        neighbours = near[i] & (np.arange(60) != i)
        d, w = points[neighbours] - points[i], weight[neighbours]
        scatter = (d * w[:, None]).T @ d / w.sum()
        assert np.isclose(np.linalg.eigvalsh(scatter)[0], salience[i])
