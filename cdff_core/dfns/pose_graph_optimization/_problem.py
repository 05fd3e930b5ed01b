# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graph as arrays for a solver, and its residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE
from cdff_core.dfns.pose_graph_optimization._elimination import Elimination, analyse
from cdff_core.dfns.pose_graph_optimization._linearisation import squared_errors

#: Unknowns of a pose in a planar and in a spatial graph, rows of x y z rx ry rz.
_PLANAR, _SPATIAL = np.array([0, 1, 5]), np.arange(6)
#: Ratio to the largest eigenvalue below which a negative eigenvalue is a rounding error.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Pose graph as arrays, one row for each edge or vertex.

    Attributes
    ----------
    vertex_a, vertex_b : ndarray of int64, shape (m,)
        Rows of the vertices a and b of each edge; equal for a prior.
    measured : ndarray, shape (m, 4, 4)
        ``T_a_b``; for a prior ``T_frame_a``.
    information : ndarray, shape (m, d, d)
        Information of ``Log(measured^-1 X_a^-1 X_b)``, positive semi-definite.
    is_loop : ndarray of bool, shape (m,)
    fixed : ndarray of int64, shape (g,)
        Rows of the fixed vertices.
    rows : ndarray of int64, shape (d,)
        Unknowns of a pose, rows of x y z rx ry rz: three in a planar graph, else all.
    free : ndarray of int64, shape (f,)
        Rows of the other vertices.
    position : ndarray of int64, shape (n,)
        Position of each vertex in the order of elimination, -1 if it is fixed.
    slot, is_a_later : ndarray, shape (m,)
        Block of each edge between free vertices, and whether its row is vertex a.
    elimination : Elimination
        Order and structure of the normal equations.
    components, repaired : int
        Number of connected components and of repaired information matrices.
    """

    vertex_a: IntArray
    vertex_b: IntArray
    measured: FloatArray
    information: FloatArray
    is_loop: BoolArray
    fixed: IntArray
    rows: IntArray
    free: IntArray
    position: IntArray
    slot: IntArray
    is_a_later: BoolArray
    elimination: Elimination
    components: int
    repaired: int

    @property
    def is_prior(self) -> BoolArray:
        """Mask of the edges that measure a pose in the frame of the graph."""
        return np.asarray(self.vertex_a == self.vertex_b)

    def squared_errors(self, poses: FloatArray) -> FloatArray:
        """Return ``e' Omega e`` of each edge ``(m,)`` at poses ``(n, 4, 4)``."""
        return squared_errors(
            poses, self.vertex_a, self.vertex_b, self.measured, self.information, tuple(self.rows.tolist())
        )


def make_problem(graph: PoseGraph) -> Problem:
    """Return the optimisation problem of a graph.

    Raises
    ------
    InputError
        If there are no vertices, or an information matrix is not finite or not symmetric.
    """
    ids, ends = graph.vertices.ids, graph.edges.ends
    if not len(ids):
        raise InputError("pose graph: no vertices, expected at least one")
    order = np.argsort(ids)
    a, b = (order[np.searchsorted(ids[order], ends[:, i])] for i in (0, 1))
    measured = graph.edges.matrices
    # The information of the message is in the axes of a, that of the solver in the axes of b: it is rotated
    # by the measured rotation.
    J = np.zeros((len(ends), 6, 6))
    J[:, :3, :3] = J[:, 3:, 3:] = measured[:, :3, :3]
    information_a = graph.edges.information_matrices
    _check_information(information_a, ends)
    information = np.swapaxes(J, 1, 2) @ information_a @ J
    information = 0.5 * (information + np.swapaxes(information, 1, 2))
    rows = _PLANAR if _is_planar(graph, information) else _SPATIAL
    information, repaired = _repair_information(information[:, rows[:, None], rows])
    components, label = connected_components(
        coo_matrix((np.ones(len(a)), (a, b)), shape=(len(ids), len(ids))), directed=False
    )
    fixed = _fixed_rows(graph, a[a == b], int(components), label)
    free = np.setdiff1d(np.arange(len(ids)), fixed)
    unknown = np.full(len(ids), -1)
    unknown[free] = np.arange(len(free))
    is_pair = (a != b) & (unknown[a] >= 0) & (unknown[b] >= 0)
    elimination = analyse(len(free), unknown[a[is_pair]], unknown[b[is_pair]])
    position = np.full(len(ids), -1)
    position[free] = elimination.position
    slot, is_a_later = np.full(len(a), -1), np.zeros(len(a), np.bool_)
    slot[is_pair], is_a_later[is_pair] = elimination.slot, elimination.is_first_later
    return Problem(
        vertex_a=a,
        vertex_b=b,
        measured=measured,
        information=information,
        is_loop=graph.edges.kinds == LOOP_CLOSURE,
        fixed=fixed,
        rows=rows,
        free=free,
        position=position,
        slot=slot,
        is_a_later=is_a_later,
        elimination=elimination,
        components=int(components),
        repaired=repaired,
    )


def _check_information(information: FloatArray, ends: IntArray) -> None:
    """Raise InputError if an information matrix is not finite or not symmetric."""
    scale = np.abs(information).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(information - np.swapaxes(information, 1, 2)).max(axis=(1, 2), initial=0.0)
    is_invalid = ~np.isfinite(scale) | (asymmetry > 1e-6 * scale)
    if is_invalid.any():
        a, b = ends[int(np.argmax(is_invalid))]
        raise InputError(f"information of the edge {a} to {b}: expected a finite symmetric 6x6 matrix")


def _is_planar(graph: PoseGraph, information: FloatArray) -> bool:
    """Return whether poses, measurements and information all lie in the plane z = 0."""
    out_of_plane = np.array([2, 3, 4])
    scale = np.abs(information).max(initial=0.0)
    return bool(
        np.abs(information[:, out_of_plane]).max(initial=0.0) <= 1e-12 * scale
        and np.abs(graph.edges.poses[:, 2:5]).max(initial=0.0) < 1e-9
        and np.abs(graph.vertices.poses[:, 2:5]).max(initial=0.0) < 1e-9
    )


def _repair_information(information: FloatArray) -> tuple[FloatArray, int]:
    """Return positive semi-definite information matrices and the number of repaired ones.

    The coupling of translation and rotation, the usual cause of indefinite matrices in published graphs, is
    removed. Remaining negative eigenvalues are set to 0.
    """
    if not len(information):
        return information, 0
    if _are_definite(information):
        return information, 0
    smallest, largest = np.linalg.eigvalsh(information)[:, [0, -1]].T
    is_indefinite = smallest < -_ROUNDING * np.maximum(largest, 0.0)
    if not is_indefinite.any():
        return information, 0
    repaired = information.copy()
    split = 3 if information.shape[1] == 6 else 2
    blocks = repaired[is_indefinite]
    blocks[:, :split, split:] = blocks[:, split:, :split] = 0.0
    values, vectors = np.linalg.eigh(blocks)
    repaired[is_indefinite] = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return repaired, int(is_indefinite.sum())


def _are_definite(information: FloatArray) -> bool:
    """Return whether all matrices have Cholesky factors, which is faster than computing eigenvalues."""
    try:
        np.linalg.cholesky(information)
    except np.linalg.LinAlgError:
        return False
    return True


def _fixed_rows(graph: PoseGraph, with_prior: IntArray, components: int, label: IntArray) -> IntArray:
    """Return the rows of the fixed vertices; in a component without a fixed vertex and prior, the smallest id
    is fixed.

    ``with_prior`` are the rows of the vertices with a prior, ``label (n,)`` the component of each vertex.
    """
    is_fixed = graph.vertices.fixed
    fixed = np.flatnonzero(is_fixed) if len(is_fixed) else np.zeros(0, np.int64)
    has_gauge = np.zeros(components, np.bool_)
    has_gauge[label[fixed]] = True
    has_gauge[label[with_prior]] = True
    order = np.argsort(graph.vertices.ids, kind="stable")
    smallest_id = order[np.unique(label[order], return_index=True)[1]]  # row of the smallest id per component
    return np.sort(np.concatenate([fixed, smallest_id[~has_gauge]]))
