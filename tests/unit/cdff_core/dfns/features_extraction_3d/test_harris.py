# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Harris keypoints: the corners of a box, and none on a plane or an edge."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.features_extraction_3d.interface import FeaturesExtraction3DInputs


def extract(points: Any, **config: Any) -> Any:
    node = Registry.default().make_dfn("features_extraction_3d", "Harris")
    node.configure(config)
    return node.process(FeaturesExtraction3DInputs(points=points))


def box(rng: np.random.Generator, n: int = 12_000) -> np.ndarray:
    """Return points sampled uniformly on the faces of a cube of 2 m."""
    points = rng.uniform(-1.0, 1.0, (n, 3))
    axis = rng.integers(0, 3, n)
    points[np.arange(n), axis] = rng.choice([-1.0, 1.0], n)
    return points


def test_exactly_the_eight_corners_of_a_box_are_detected(rng: np.random.Generator) -> None:
    points = box(rng)
    result = extract(points, radius_m=0.25, least_response=0.005, suppression=1.0)
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    distance = np.linalg.norm(result.keypoints[:, None] - corners, axis=2)
    assert np.all(distance.min(axis=0) < 0.2)
    assert np.all(distance.min(axis=1) < 0.3)
    np.testing.assert_array_equal(points[result.indices], result.keypoints)


def test_a_plane_has_no_corner(rng: np.random.Generator) -> None:
    plane = np.c_[rng.uniform(-1, 1, (3000, 2)), rng.normal(0, 1e-4, 3000)]
    assert len(extract(plane).indices) == 0


def test_beyond_the_limit_the_strongest_corners_are_kept(rng: np.random.Generator) -> None:
    assert len(extract(box(rng), radius_m=0.25, max_keypoints=3).indices) == 3
