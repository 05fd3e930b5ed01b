# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graphs are inserted as products and read as nodes and edges."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cdff_common.codecs import encode
from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.types import PoseGraph
from dpm_store import Store
from tests.support.store_products import header, put

S = 1_000_000_000
NAMES = {"product": "pose_graph", "type_name": "PoseGraph", "dfpc": "lidar_slam", "port": "graph"}


def random_graph(rng: np.random.Generator) -> PoseGraph:
    n = 6
    poses = np.array([se3.exp_se3(rng.normal(size=6)) for _ in range(n)])
    steps = np.array([se3.inverse(a) @ b for a, b in pairwise(poses)])
    roots = rng.normal(size=(n, 6, 6))
    information = roots @ roots.transpose(0, 2, 1) + np.eye(6)
    information[-1] = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # a prior on the position alone
    ends = [*((i, i + 1) for i in range(n - 1)), (0, 0)]
    return PoseGraph.from_arrays(
        range(n),
        np.arange(n) * S,
        poses,
        ends,
        [*steps, poses[0]],
        information,
        [0, 0, 1, 0, 0, 2],
        frame="site",
        fixed=[1, 0, 0, 0, 0, 0],
    )


def test_a_graph_is_restored_from_its_nodes_and_edges(store: Store, rng: np.random.Generator) -> None:
    graph = random_graph(rng)
    put(store, header(1), encode(graph, "uper"), **NAMES)
    restored = store.pose_graph(header(1).id)
    assert restored.frame == "site"
    for part, name in (
        ("vertices", "ids"),
        ("vertices", "stamps"),
        ("vertices", "fixed"),
        ("edges", "ends"),
        ("edges", "kinds"),
        ("edges", "information"),
    ):
        assert np.array_equal(getattr(getattr(restored, part), name), getattr(getattr(graph, part), name)), (
            name
        )
    assert restored.vertices.matrices == pytest.approx(graph.vertices.matrices, abs=1e-12)
    assert restored.edges.matrices == pytest.approx(graph.edges.matrices, abs=1e-12)


def test_nodes_are_found_by_time(store: Store, rng: np.random.Generator) -> None:
    graph = random_graph(rng)
    put(store, header(1), encode(graph, "uper"), **NAMES)
    result = store.pose_graph_nodes(header(1).id, 2 * S, 4 * S)
    assert [(node.node, node.stamp_ns) for node in result] == [(2, 2 * S), (3, 3 * S), (4, 4 * S)]
    assert result[0].matrix == pytest.approx(graph.vertices.matrices[2], abs=1e-12)


def test_a_measurement_with_unconstrained_directions_has_no_covariance(
    store: Store, rng: np.random.Generator
) -> None:
    put(store, header(1), encode(random_graph(rng), "uper"), **NAMES)
    with store._database.read() as connection:
        rows = connection.exec_driver_sql(
            "SELECT edge, covariance IS NULL FROM pose_graph_edges ORDER BY edge"
        ).all()
    assert [row[0] for row in rows if row[1]] == [5]


def test_a_product_of_another_type_has_no_graph(store: Store) -> None:
    put(store, header(1))
    with pytest.raises(ProductNotFoundError, match="no pose graph"):
        store.pose_graph(header(1).id)


def test_purging_a_graph_removes_its_nodes(store: Store, rng: np.random.Generator) -> None:
    put(store, header(1), encode(random_graph(rng), "uper"), **NAMES)
    store.delete(header(1).id)
    store.purge(header(1).id)
    with pytest.raises(ProductNotFoundError, match="no pose graph"):
        store.pose_graph(header(1).id)
