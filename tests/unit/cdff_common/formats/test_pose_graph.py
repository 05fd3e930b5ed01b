# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graph messages as g2o files: information matrices are converted between the error definitions."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.formats.payload import to_file
from cdff_common.formats.pose_graph import read_pose_graph, write_pose_graph
from cdff_common.geometry import se3

SPATIAL = (
    b"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"
    b"EDGE_SE3:QUAT 0 3 1 2 3 0 0 0.70710678118654757 0.70710678118654757 "
    b"1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6\n"
    b"EDGE_SE3:QUAT 3 4 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n"
)
PLANE = b"EDGE_SE2 5 6 1 0 1.5707963267948966 1 0 0 2 0 3\nEDGE_SE2 6 7 1 0 0 1 0 0 1 0 1\nFIX 6\n"


def test_information_is_converted_between_the_error_frames_of_an_edge() -> None:
    graph = read_pose_graph(SPATIAL, frame="map")
    # Vertex 3 is rotated by 90° about z: its x axis is the y axis of vertex 0.
    np.testing.assert_allclose(np.diag(graph.edges.information_matrices[0]), [2, 1, 3, 5, 4, 6], atol=1e-12)


def test_poses_missing_in_the_file_are_computed_along_the_edges() -> None:
    graph = read_pose_graph(SPATIAL, frame="map")
    assert graph.vertices.ids.tolist() == [0, 3, 4]
    np.testing.assert_allclose(graph.vertices.poses[:, :3], [[0, 0, 0], [1, 2, 3], [1, 3, 3]], atol=1e-12)
    plane = read_pose_graph(PLANE, frame="map")
    np.testing.assert_allclose(plane.vertices.poses[:, :3], [[0, 0, 0], [1, 0, 0], [1, 1, 0]], atol=1e-12)
    assert plane.vertices.fixed.tolist() == [0, 1, 0]


def test_an_edge_to_the_next_id_is_odometry() -> None:
    assert read_pose_graph(SPATIAL, frame="map").edges.kinds.tolist() == [1, 0]


@pytest.mark.parametrize("text", [SPATIAL, PLANE])
def test_a_graph_survives_a_round_trip(text: bytes) -> None:
    graph = read_pose_graph(text, frame="map")
    written = write_pose_graph(graph)
    reread = read_pose_graph(written, frame="map")
    assert to_file(graph, "g2o") == written
    assert (b"SE2" in written) == (text is PLANE)
    np.testing.assert_allclose(reread.vertices.poses, graph.vertices.poses, atol=1e-15)
    np.testing.assert_allclose(reread.edges.information, graph.edges.information, atol=1e-12)
    np.testing.assert_array_equal(reread.vertices.fixed, graph.vertices.fixed)


def test_a_tilted_graph_is_written_as_a_3d_graph() -> None:
    graph = read_pose_graph(PLANE, frame="map")
    tilted = type(graph).from_arrays(
        graph.vertices.ids,
        graph.vertices.stamps_ns,
        se3.exp_se3([0, 0, 0, 0.1, 0, 0]) @ graph.vertices.matrices,
        graph.edges.ends,
        graph.edges.matrices,
        graph.edges.information_matrices,
        graph.edges.kinds,
        frame="map",
    )
    assert b"SE2" not in write_pose_graph(tilted)
