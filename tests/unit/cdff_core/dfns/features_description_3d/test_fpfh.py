# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""FPFH descriptors agree with those of Open3D and do not depend on the pose."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.features_description_3d.fpfh import Fpfh
from cdff_core.dfns.features_description_3d.interface import FeaturesDescription3DInputs
from tests.support import surfaces

RADIUS_M = 1.5


def describe(points: np.ndarray, normals: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    node = Fpfh()
    node.configure()
    out = node.process(
        FeaturesDescription3DInputs(points=points, normals=normals, keypoints=keypoints, radius_m=RADIUS_M)
    )
    assert np.all(out.valid)
    return out.descriptors


def cloud(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    points = surfaces.terrain(rng, 2000)
    normals = rng.normal(0, 0.2, points.shape) + np.array([0.0, 0.0, 1.0])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.slow
def test_histograms_agree_with_open3d(rng: np.random.Generator) -> None:
    o3d = pytest.importorskip("open3d")
    points, normals = cloud(rng)
    reference = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    reference.normals = o3d.utility.Vector3dVector(normals)
    radius = o3d.geometry.KDTreeSearchParamRadius(RADIUS_M)
    expected = np.asarray(o3d.pipelines.registration.compute_fpfh_feature(reference, radius).data).T[::20]
    result = describe(points, normals, points[::20])
    correlation = [np.corrcoef(a, b)[0, 1] for a, b in zip(result, expected, strict=True)]
    assert np.median(correlation) > 0.99


def test_descriptors_do_not_depend_on_the_pose(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    T = se3.exp_se3([5.0, -2.0, 1.0, 1.0, -0.5, 2.0])
    moved_points = se3.transform_points(T, points)
    descriptors = describe(points, normals, points[::20])
    descriptors_moved = describe(moved_points, normals @ T[:3, :3].T, moved_points[::20])
    # Rounding may move a value at the edge of a bin to the neighbouring bin.
    assert np.mean(np.abs(descriptors - descriptors_moved) < 0.5) > 0.99
