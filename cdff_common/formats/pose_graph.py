# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ``PoseGraph`` messages from and to g2o files.

The information matrix of g2o refers to an error in b, ``Log(T_a_b^-1 X_a^-1 X_b)``, the
matrix of a ``PoseGraph`` to an error in a; they differ by the measured rotation.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.file_source import Readable
from cdff_common.formats.g2o import G2oGraph, read_g2o, write_g2o
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import rotate_covariance, symmetrised
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY, PRIOR

Float = NDArray[np.float64]


def read_pose_graph(source: Readable, *, frame: str) -> PoseGraph:
    """Read a g2o file.

    The pose of a vertex without one is composed from edges, breadth first from the vertices with poses, or
    from the smallest id at the origin. Files have neither stamps nor kinds of edges: stamps are 0, an edge to
    the next id is odometry, others are loop closures.

    Raises
    ------
    CodecError
        If ``read_g2o`` refuses the file.
    """
    g = read_g2o(source)
    ids = np.union1d(g.ids, g.ends)
    measured = g.measured_matrices
    poses_of_file = {int(i): T for i, T in zip(g.ids, g.matrices, strict=True)}
    matrices = _all_poses(ids, poses_of_file, g.ends, measured)
    kinds = np.where(np.abs(g.ends[:, 1] - g.ends[:, 0]) == 1, ODOMETRY, LOOP_CLOSURE)
    kinds[g.ends[:, 0] == g.ends[:, 1]] = PRIOR
    return PoseGraph.from_arrays(
        ids,
        np.zeros(len(ids), np.int64),
        matrices,
        g.ends,
        measured,
        symmetrised(rotate_covariance(g.information, measured[:, :3, :3])),
        kinds,
        frame=frame,
        fixed=np.isin(ids, g.fixed) if len(g.fixed) else None,
    )


def write_pose_graph(graph: PoseGraph) -> bytes:
    """Return a graph in g2o format: planar if all poses lie in the plane z = 0, else spatial."""
    vertices, edges = graph.vertices, graph.edges
    measured = edges.matrices
    information = symmetrised(
        rotate_covariance(edges.information_matrices, np.swapaxes(measured[:, :3, :3], 1, 2))
    )
    out_of_plane = np.array([2, 3, 4])
    scale = np.abs(information).max(initial=0.0)
    is_plane = np.abs(information[:, out_of_plane]).max(initial=0.0) <= 1e-12 * scale and all(
        np.abs(poses[:, 2:5]).max(initial=0.0) < 1e-9 for poses in (vertices.poses, edges.poses)
    )
    fixed = vertices.ids[vertices.fixed != 0] if len(vertices.fixed) else np.zeros(0, np.int64)
    dimension = 2 if is_plane else 3
    return write_g2o(
        G2oGraph(dimension, vertices.ids, vertices.poses, edges.ends, edges.poses, information, fixed)
    )


def _all_poses(
    ids: NDArray[np.int64], poses: dict[int, Float], ends: NDArray[np.int64], measured: Float
) -> Float:
    """Return the poses ``(n, 4, 4)`` of all ids."""
    if len(poses) == len(ids):
        return np.array([poses[int(i)] for i in ids])
    neighbours: dict[int, list[tuple[int, Float]]] = {int(i): [] for i in ids}
    for (a, b), T in zip(ends.tolist(), measured, strict=True):
        if a == b:
            poses.setdefault(a, T)
        else:
            neighbours[a].append((b, T))
            neighbours[b].append((a, se3.inverse(T)))
    queue = deque(sorted(poses))
    for start in ids.tolist():
        if start not in poses and not queue:
            poses[start] = np.eye(4)
            queue.append(start)
        while queue:
            at = queue.popleft()
            for other, T in neighbours[at]:
                if other not in poses:
                    poses[other] = poses[at] @ T
                    queue.append(other)
    matrices = np.array([poses[int(i)] for i in ids])
    return se3.normalise_transform(matrices)
