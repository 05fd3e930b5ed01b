# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graphs as rows of nodes and edges, read as a whole or by time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from cdff_common.errors import ProductNotFoundError
from dpm_store.engine import schema
from dpm_store.engine.database import Database

if TYPE_CHECKING:
    from cdff_common.types import PoseGraph

#: ASN.1 type of pose graphs.
TYPE_NAME = "PoseGraph"
_KINDS = ("odometry", "loop_closure", "prior")
#: An information matrix with a larger condition number has no covariance.
_SINGULAR = 1e14

Rows = tuple[list[dict[str, Any]], list[dict[str, Any]]]


@dataclass(frozen=True, slots=True)
class PoseGraphNode:
    """A node of a stored pose graph: ``matrix`` is ``T_frame_node`` (4, 4)."""

    product_id: str
    node: int
    frame: str
    stamp_ns: int
    matrix: NDArray[np.float64]


def rows_of(product_id: str, graph: PoseGraph) -> Rows:
    """Return the rows of nodes and of edges."""
    v, e = graph.vertices, graph.edges
    fixed = v.fixed if len(v.fixed) else np.zeros(len(v.ids), np.uint8)
    nodes = [
        {
            "product_id": product_id,
            "node": int(node),
            "frame": graph.frame,
            "stamp_ns": int(stamp_ns),
            "matrix": matrix.astype("<f8").tobytes(),
            "covariance": None,
            "fixed": bool(is_fixed),
        }
        for node, stamp_ns, matrix, is_fixed in zip(v.ids, v.stamps_ns, v.matrices, fixed, strict=True)
    ]
    edges = [
        {
            "product_id": product_id,
            "edge": number,
            "from_node": int(ends[0]),
            "to_node": int(ends[1]),
            "kind": _KINDS[kind] if kind < len(_KINDS) else str(kind),
            "matrix": matrix.astype("<f8").tobytes(),
            "covariance": _covariance(information),
            "information": information.astype("<f8").tobytes(),
        }
        for number, (ends, matrix, information, kind) in enumerate(
            zip(e.ends, e.matrices, e.information_matrices, e.kinds, strict=True)
        )
    ]
    return nodes, edges


def read(database: Database, product_id: str) -> PoseGraph:
    """Return the pose graph of a product; raises ProductNotFoundError for a product of another type."""
    from cdff_common.types import PoseGraph

    n, e = schema.pose_graph_nodes.c, schema.pose_graph_edges.c
    with database.read() as connection:
        nodes = connection.execute(
            select(schema.pose_graph_nodes).where(n.product_id == product_id).order_by(n.node)
        ).all()
        edges = connection.execute(
            select(schema.pose_graph_edges).where(e.product_id == product_id).order_by(e.edge)
        ).all()
    if not nodes:
        raise ProductNotFoundError(f"no pose graph {product_id[:64]!r}")
    return PoseGraph.from_arrays(
        [row.node for row in nodes],
        [row.stamp_ns for row in nodes],
        _matrices([row.matrix for row in nodes], 4),
        np.array([[row.from_node, row.to_node] for row in edges], dtype=np.int64).reshape(-1, 2),
        _matrices([row.matrix for row in edges], 4),
        _matrices([row.information for row in edges], 6),
        [_kind(row.kind) for row in edges],
        frame=nodes[0].frame,
        fixed=[row.fixed for row in nodes],
    )


def nodes_between(database: Database, product_id: str, t0_ns: int, t1_ns: int) -> tuple[PoseGraphNode, ...]:
    """Return the nodes of a graph in an interval of time, ends included, in the order of time."""
    n = schema.pose_graph_nodes.c
    statement = select(schema.pose_graph_nodes).where(
        n.product_id == product_id, n.stamp_ns.between(t0_ns, t1_ns)
    )
    with database.read() as connection:
        rows = connection.execute(statement.order_by(n.stamp_ns, n.node)).all()
    return tuple(
        PoseGraphNode(row.product_id, row.node, row.frame, row.stamp_ns, _matrices([row.matrix], 4)[0])
        for row in rows
    )


def delete_in(connection: Connection, product_id: str) -> None:
    """Remove the nodes and edges of a product whose payload is purged."""
    for table in (schema.pose_graph_nodes, schema.pose_graph_edges):
        connection.execute(table.delete().where(table.c.product_id == product_id))


def _kind(name: str) -> int:
    return _KINDS.index(name) if name in _KINDS else int(name)


def _covariance(information: NDArray[np.float64]) -> bytes | None:
    """Return the inverse; None if the measurement leaves a direction unconstrained."""
    if not np.isfinite(information).all() or np.linalg.cond(information) > _SINGULAR:
        return None
    return bytes(np.linalg.inv(information).astype("<f8").tobytes())


def _matrices(blobs: list[bytes], size: int) -> NDArray[np.float64]:
    return np.frombuffer(b"".join(blobs), "<f8").reshape(-1, size, size)
