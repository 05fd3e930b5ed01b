# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parts of the results of ``cdff vo``: voxels, the graph of its motions, the plane of its pictures."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.slam import voxel_means
from cdff_dev.slam.odometry_graph import odometry_graph
from cdff_dev.slam.pictures import map_plane
from cdff_dev.slam.voxel_means import VoxelMeans


def test_means_are_those_of_all_points_of_a_voxel_whatever_the_parts() -> None:
    rng = np.random.default_rng(1)
    points_m, values = rng.uniform(-3.0, 3.0, (5000, 3)), rng.uniform(0.0, 255.0, 5000)
    whole_means, parts = VoxelMeans(1.0), VoxelMeans(1.0)
    whole_means.add(points_m, values)
    for part in np.array_split(np.arange(5000), 7):
        parts.add(points_m[part], values[part])
    for first, second in zip(whole_means.means(), parts.means(), strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)
    assert len(whole_means.means()[0]) == 6**3
    in_first = (points_m >= -3.0).all(axis=1) & (points_m < -2.0).all(axis=1)
    np.testing.assert_allclose(whole_means.means()[0][0], points_m[in_first].mean(axis=0))
    assert whole_means.means()[1][0] == pytest.approx(values[in_first].mean())


def test_the_number_of_voxels_is_limited_by_larger_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voxel_means, "_MAX_VOXELS", 100)
    voxels = VoxelMeans(0.1)
    points_m = np.random.default_rng(1).uniform(0.0, 4.0, (5000, 3))
    voxels.add(points_m, np.zeros(5000))
    assert len(voxels.means()[0]) <= 100
    assert voxels.edge_m == pytest.approx(0.8 * round(voxels.edge_m / 0.8))


def test_edges_have_the_covariance_of_the_motions() -> None:
    motion = UncertainTransform(
        se3.transform(se3.exp_so3([0.0, 0.0, 0.3]), [1.0, 0.2, 0.0]),
        np.diag([0.1, 0.05, 0.02, 0.01, 0.02, 0.03]) ** 2,
    )
    poses = [UncertainTransform.identity()]
    for _ in range(4):
        poses.append(poses[-1] @ motion)
    stamps_ns = np.arange(5) * 100_000_000
    covariances = np.array([pose.covariance for pose in poses])
    track = Track("estimate", stamps_ns, np.array([pose.matrix for pose in poses]), covariances)
    graph = odometry_graph(track, "odom")
    assert graph.vertices.fixed.tolist() == [1, 0, 0, 0, 0]
    assert graph.edges.ends.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert motion.covariance is not None
    expected = np.linalg.inv(motion.covariance + 1e-6 * np.eye(6))
    for matrix, information in zip(graph.edges.matrices, graph.edges.information_matrices, strict=True):
        np.testing.assert_allclose(matrix, motion.matrix, atol=1e-9)
        np.testing.assert_allclose(information, expected, rtol=1e-6, atol=1e-3)


def test_poses_without_covariances_have_finite_edges() -> None:
    track = Track("estimate", np.arange(3) * 1000, np.tile(np.eye(4), (3, 1, 1)), np.full((3, 6, 6), np.nan))
    assert np.isfinite(odometry_graph(track, "odom").edges.information).all()
    alone = Track("estimate", np.zeros(1, np.int64), np.eye(4)[None])
    assert len(odometry_graph(alone, "odom").edges.ends) == 0


@pytest.mark.parametrize(
    ("path_m", "plane"),
    [
        ([[0.0, 0.0, 0.0], [0.1, -0.8, 60.0]], (0, 2)),  # straight, with a drift of height
        ([[0.0, 0.0, 0.0], [0.0, 30.0, 60.0]], (1, 2)),
        ([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]], (0, 2)),
    ],
)
def test_a_picture_of_a_map_shows_the_path_and_the_widest_extent_across(
    path_m: list[list[float]], plane: tuple[int, int]
) -> None:
    points_m = np.random.default_rng(1).uniform([-10.0, -3.0, 0.0], [10.0, 1.0, 70.0], (500, 3))
    assert map_plane(points_m, np.array(path_m)) == plane
