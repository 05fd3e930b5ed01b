# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graphs of the wire from and to g2o.

g2o's information is of an error in b, ``Log(T_a_b^-1 X_a^-1 X_b)``; that of a ``PoseGraph`` is of one in a. One is the
other turned by the measured rotation.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.g2o import G2oGraph, read_g2o, write_g2o
from cdff_common.formats.source import Readable
from cdff_common.geometry import se3
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY, PRIOR

Float = NDArray[np.float64]


def read_pose_graph(source: Readable, *, frame: str) -> PoseGraph:
    """Read a g2o file.

    Vertices that only edges name are placed along these, breadth first from the vertices that have poses, else from
    the least id at the origin. Files have no stamps and no kinds of edges: stamps are 0, an edge to the next id is
    odometry, others are loop closures.

    Raises
    ------
    CodecError
        As ``read_g2o``.
    """
    g = read_g2o(source)
    ids = np.union1d(g.ids, g.ends)
    measured = g.measured_matrices
    known = {int(i): T for i, T in zip(g.ids, g.matrices, strict=True)}
    matrices = _placed(ids, known, g.ends, measured)
    kinds = np.where(np.abs(g.ends[:, 1] - g.ends[:, 0]) == 1, ODOMETRY, LOOP_CLOSURE)
    kinds[g.ends[:, 0] == g.ends[:, 1]] = PRIOR
    return PoseGraph.from_arrays(
        ids, np.zeros(len(ids), np.int64), matrices, g.ends, measured, _turned(g.information, measured), kinds,
        frame=frame, fixed=np.isin(ids, g.fixed) if len(g.fixed) else None,
    )  # fmt: skip


def write_pose_graph(graph: PoseGraph) -> bytes:
    """Bytes of a graph as g2o: plane where nothing leaves the plane z = 0, else spatial."""
    vertices, edges = graph.vertices, graph.edges
    measured = edges.matrices
    information = _turned(edges.information_matrices, np.swapaxes(measured, 1, 2))
    out = np.array([2, 3, 4])
    scale = np.abs(information).max(initial=0.0)
    is_plane = np.abs(information[:, out]).max(initial=0.0) <= 1e-12 * scale and all(
        np.abs(poses[:, 2:5]).max(initial=0.0) < 1e-9 for poses in (vertices.poses, edges.poses)
    )
    fixed = vertices.ids[vertices.fixed != 0] if len(vertices.fixed) else np.zeros(0, np.int64)
    dimension = 2 if is_plane else 3
    return write_g2o(G2oGraph(dimension, vertices.ids, vertices.poses, edges.ends, edges.poses, information, fixed))


def _turned(information: Float, matrices: Float) -> Float:
    """``J Omega J'`` with the rotations of ``matrices`` on the diagonal of J."""
    J = np.zeros((len(matrices), 6, 6))
    J[:, :3, :3] = J[:, 3:, 3:] = matrices[:, :3, :3]
    turned = J @ information @ np.swapaxes(J, 1, 2)
    return 0.5 * (turned + np.swapaxes(turned, 1, 2))


def _placed(ids: NDArray[np.int64], known: dict[int, Float], ends: NDArray[np.int64], measured: Float) -> Float:
    """Poses ``(n, 4, 4)`` of all ids."""
    if len(known) == len(ids):
        return np.array([known[int(i)] for i in ids])
    neighbours: dict[int, list[tuple[int, Float]]] = {int(i): [] for i in ids}
    for (a, b), T in zip(ends.tolist(), measured, strict=True):
        if a == b:
            known.setdefault(a, T)
        else:
            neighbours[a].append((b, T))
            neighbours[b].append((a, se3.inverse(T)))
    queue = deque(sorted(known))
    for start in ids.tolist():
        if start not in known and not queue:
            known[start] = np.eye(4)
            queue.append(start)
        while queue:
            at = queue.popleft()
            for other, T in neighbours[at]:
                if other not in known:
                    known[other] = known[at] @ T
                    queue.append(other)
    matrices = np.array([known[int(i)] for i in ids])
    return se3.transform(se3.normalise_rotation(matrices[:, :3, :3]), matrices[:, :3, 3])
