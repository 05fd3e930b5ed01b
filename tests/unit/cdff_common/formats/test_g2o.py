# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""g2o pose graphs: planar and spatial graphs in the same columns, and errors for malformed files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_common.formats.format_detection import detect
from cdff_common.formats.g2o import G2oGraph, lifted_se2, plane_se2, read_g2o, write_g2o
from cdff_common.geometry import se3


def spatial_graph(rng: np.random.Generator) -> G2oGraph:
    poses = np.hstack(
        [rng.normal(size=(4, 3)), se3.quaternion_xyzw_from_matrix(se3.exp_so3(rng.normal(size=(4, 3))))]
    )
    half = rng.normal(size=(5, 6, 6))
    ends = np.array([[0, 1], [1, 2], [2, 7], [7, 0], [1, 1]])
    ids = np.array([0, 1, 2, 7])
    return G2oGraph(
        3, ids, poses, ends, poses[[0, 1, 2, 3, 0]], half @ half.transpose(0, 2, 1), np.array([0])
    )


def assert_same(a: G2oGraph, b: G2oGraph) -> None:
    assert a.dimension == b.dimension
    for name in ("ids", "ends", "fixed"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for name in ("poses", "measurements", "information"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0, atol=1e-14)


def test_a_3d_graph_with_a_prior_survives_a_round_trip(rng: np.random.Generator) -> None:
    graph = spatial_graph(rng)
    data = write_g2o(graph)
    assert detect(data) == "g2o"
    assert_same(read_g2o(data), graph)


def test_a_2d_graph_survives_a_round_trip_and_is_converted_to_3d(rng: np.random.Generator) -> None:
    text = b"VERTEX_SE2 0 0 0 0\nFIX 0\nEDGE_SE2 0 1 1 2 0.5 11 12 13 22 23 33\nEDGE_PRIOR_SE2 0 0 0 0.1 1 0 0 1 0 1\n"
    graph = read_g2o(text)
    assert (graph.dimension, graph.ids.tolist()) == (2, [0])
    assert graph.ends.tolist() == [[0, 1], [0, 0]]
    np.testing.assert_allclose(graph.measured_matrices[0][:3, :3], se3.exp_so3([0, 0, 0.5]), atol=1e-15)
    expected = np.zeros((6, 6))
    expected[np.ix_([0, 1, 5], [0, 1, 5])] = [[11, 12, 13], [12, 22, 23], [13, 23, 33]]
    np.testing.assert_array_equal(graph.information[0], expected)
    assert_same(read_g2o(write_g2o(graph)), graph)


def test_rotations_survive_the_conversion_to_3d(rng: np.random.Generator) -> None:
    planar_poses = np.column_stack([rng.normal(size=(50, 2)), rng.uniform(-np.pi, np.pi, 50)])
    np.testing.assert_allclose(plane_se2(lifted_se2(planar_poses)), planar_poses, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "no line"),
        (b"VERTEX_SE2 0 0 0\n", "line 1: 3 numbers, expected 4"),
        (b"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 1 0 0\n", "vertex 0 is repeated"),
        (b"VERTEX_SE2 0 0 0 0\nEDGE_SE2_XY 0 1 1 2 1 0 1\n", "line 2: 'EDGE_SE2_XY'"),
        (b"VERTEX_SE2 0 0 nan 0\n", "line 1: a number that is not finite"),
        (b"VERTEX_SE2 0 0 x 0\n", "VERTEX_SE2"),
        (b"VERTEX_SE2 a 0 0 0\n", "vertex 'a'"),
        (b"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 2\n", "unit length"),
        (b"VERTEX_SE2 0 0 0 0\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n", "planar and spatial"),
        (b"PARAMS_SE3OFFSET 0 1 0 0 0 0 0 1\n", "offset"),
    ],
)
def test_a_malformed_line_is_refused_with_the_reason(text: bytes, reason: str) -> None:
    with pytest.raises(CodecError, match=reason):
        read_g2o(text)


def test_wrong_numbers_of_columns_are_refused(rng: np.random.Generator) -> None:
    g = spatial_graph(rng)
    with pytest.raises(InputError, match=r"expected \(n, 7\)"):
        write_g2o(G2oGraph(3, g.ids[:2], g.poses, g.ends, g.measurements, g.information, g.fixed))
    with pytest.raises(InputError, match="dimension 4"):
        write_g2o(G2oGraph(4, g.ids, g.poses, g.ends, g.measurements, g.information, g.fixed))


@pytest.mark.parametrize(
    ("name", "dimension", "vertices", "edges", "missing"),
    [
        ("intel", 2, 1728, 2512, 0),
        ("kitti_05", 2, 0, 2826, 2761),
        ("parking-garage", 3, 1661, 6275, 0),
        ("smallGrid3D", 3, 125, 297, 0),
        ("sphere2500", 3, 2500, 4949, 0),
    ],
)
def test_published_graphs_are_read(
    real_data: Callable[[str], Path], name: str, dimension: int, vertices: int, edges: int, missing: int
) -> None:
    graph = read_g2o(real_data(f"posegraphs/{name}.g2o"))
    assert (graph.dimension, len(graph.ids), len(graph.ends)) == (dimension, vertices, edges)
    assert len(np.setdiff1d(graph.ends, graph.ids)) == missing
    assert_same(read_g2o(write_g2o(graph)), graph)
