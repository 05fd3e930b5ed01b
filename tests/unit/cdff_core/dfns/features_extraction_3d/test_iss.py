# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Iss: keypoints where there is something to see."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfns.features_extraction_3d._interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_extraction_3d.iss import Iss
from tests import surfaces


def made(**config: object) -> Iss:
    node = Iss()
    node.configure(config)
    return node


def test_a_plane_has_no_keypoints() -> None:
    x, y = np.meshgrid(np.arange(0.0, 10.0, 0.2), np.arange(0.0, 10.0, 0.21))
    flat = np.c_[x.ravel(), y.ravel(), np.zeros(x.size)]
    assert len(made().process(FeaturesExtraction3DInputs(flat)).indices) == 0


def test_a_bump_on_a_plane_is_found(rng: np.random.Generator) -> None:
    xy = rng.uniform(-5, 5, (6000, 2))
    points = np.c_[xy, 1.5 * np.exp(-8.0 * np.sum((xy - [1.0, 2.0]) ** 2, axis=1))]
    out = made(radius_m=0.6, max_keypoints=3).process(FeaturesExtraction3DInputs(points))
    assert len(out.indices) == 3
    assert np.all(np.linalg.norm(out.keypoints[:, :2] - [1.0, 2.0], axis=1) < 1.0)


def test_keypoints_turn_with_the_cloud(rng: np.random.Generator) -> None:
    points = surfaces.terrain(rng, 3000)
    turned = se3.transform_points(se3.exp_se3([3.0, -1.0, 2.0, 0.4, 0.2, 2.0]), points)
    here, there = (made(radius_m=1.0).process(FeaturesExtraction3DInputs(p)).indices for p in (points, turned))
    assert len(here) > 20
    assert len(np.intersect1d(here, there)) >= 0.99 * len(here)


def test_the_least_eigenvalue_is_that_of_the_weighted_scatter(rng: np.random.Generator) -> None:
    points = rng.normal(size=(60, 3)) * [3.0, 2.0, 1.0]
    node = made(least_neighbours=4, max_ratio_21=1.0, max_ratio_32=1.0)
    salience = node._salience(points, 2.5)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= 2.5
    weight = 1.0 / near.sum(axis=1)
    for i in np.flatnonzero(salience):
        others = near[i] & (np.arange(60) != i)
        d, w = points[others] - points[i], weight[others]
        scatter = (d * w[:, None]).T @ d / w.sum()
        assert np.isclose(np.linalg.eigvalsh(scatter)[0], salience[i])
