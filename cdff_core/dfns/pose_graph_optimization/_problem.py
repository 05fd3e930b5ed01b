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
from cdff_common.geometry import se3
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE

#: Rows of a plane graph in x y z rx ry rz.
_PLANE = np.array([0, 1, 5])
_SPACE = np.arange(6)
#: Ratio to the largest eigenvalue below which a negative eigenvalue is rounding noise.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Arrays of the optimisation problem.

    Attributes
    ----------
    first, second : ndarray of int64, shape (m,)
        Rows of the vertices a and b of each edge; equal for a prior.
    measured : ndarray, shape (m, 4, 4)
        ``T_a_b``, of a prior ``T_frame_a``.
    information : ndarray, shape (m, d, d)
        Information of ``Log(measured^-1 X_a^-1 X_b)``, positive semi-definite.
    is_loop : ndarray of bool, shape (m,)
    held : ndarray of int64, shape (g,)
        Rows of the fixed vertices.
    rows : ndarray of int64, shape (d,)
        The unknowns of a pose in x y z rx ry rz: three in the plane, else all.
    components, repaired : int
        Number of connected components and of repaired information matrices.
    """

    first: IntArray
    second: IntArray
    measured: FloatArray
    information: FloatArray
    is_loop: BoolArray
    held: IntArray
    rows: IntArray
    components: int
    repaired: int

    @property
    def is_prior(self) -> BoolArray:
        """Return which edges measure one pose in the graph's frame."""
        return np.asarray(self.first == self.second)

    def errors(self, poses: FloatArray) -> FloatArray:
        """Errors ``(m, 6)`` of the edges at poses ``(n, 4, 4)``."""
        between = se3.inverse(poses[self.first]) @ poses[self.second]
        between[self.is_prior] = poses[self.first[self.is_prior]]
        return se3.log_se3(se3.inverse(self.measured) @ between)

    def squared(self, errors: FloatArray) -> FloatArray:
        """``e' Omega e`` of each edge ``(m,)``."""
        e = errors[:, self.rows]
        return np.asarray(np.einsum("mi,mij,mj->m", e, self.information, e))


def problem_of(graph: PoseGraph) -> Problem:
    """Return the arrays of a graph.

    Raises
    ------
    InputError
        If there are no vertices, or an information matrix is not finite or not symmetric.
    """
    ids, ends = graph.vertices.ids, graph.edges.ends
    if not len(ids):
        raise InputError("pose graph: no vertices, expected some")
    order = np.argsort(ids)
    first, second = (order[np.searchsorted(ids[order], ends[:, i])] for i in (0, 1))
    measured = graph.edges.matrices
    # The message has the information of an error in a, the solver of one in b: rotate by the measured
    # rotation.
    J = np.zeros((len(ends), 6, 6))
    J[:, :3, :3] = J[:, 3:, 3:] = measured[:, :3, :3]
    given = _checked(graph.edges.information_matrices, ends)
    information = np.swapaxes(J, 1, 2) @ given @ J
    information = 0.5 * (information + np.swapaxes(information, 1, 2))
    rows = _PLANE if _is_plane(graph, information) else _SPACE
    repaired, count = _repaired(information[:, rows[:, None], rows])
    parts, label = _parts(len(ids), first, second)
    return Problem(
        first,
        second,
        measured,
        repaired,
        graph.edges.kinds == LOOP_CLOSURE,
        _held(graph, first, second, parts, label),
        rows,
        parts,
        count,
    )


def _checked(information: FloatArray, ends: IntArray) -> FloatArray:
    scale = np.abs(information).max(axis=(1, 2), initial=0.0)
    skewed = np.abs(information - np.swapaxes(information, 1, 2)).max(axis=(1, 2), initial=0.0)
    bad = ~np.isfinite(scale) | (skewed > 1e-6 * scale)
    if bad.any():
        a, b = ends[int(np.argmax(bad))]
        raise InputError(f"information of the edge {a} to {b}: expected a finite symmetric 6x6 matrix")
    return information


def _is_plane(graph: PoseGraph, information: FloatArray) -> bool:
    """Return whether poses, measurements and information all lie in the plane z = 0."""
    out = np.array([2, 3, 4])
    scale = np.abs(information).max(initial=0.0)
    return bool(
        np.abs(information[:, out]).max(initial=0.0) <= 1e-12 * scale
        and np.abs(graph.edges.poses[:, 2:5]).max(initial=0.0) < 1e-9
        and np.abs(graph.vertices.poses[:, 2:5]).max(initial=0.0) < 1e-9
    )


def _repaired(information: FloatArray) -> tuple[FloatArray, int]:
    """Return positive semi-definite matrices and the number of repaired ones.

    In published graphs the coupling of translation and rotation is the usual cause of indefinite matrices,
    and is removed. Remaining negative eigenvalues are set to 0.
    """
    if not len(information):
        return information, 0
    least, largest = np.linalg.eigvalsh(information)[:, [0, -1]].T
    bad = least < -_ROUNDING * np.maximum(largest, 0.0)
    if not bad.any():
        return information, 0
    fixed = information.copy()
    split = 3 if information.shape[1] == 6 else 2
    blocks = fixed[bad]
    blocks[:, :split, split:] = blocks[:, split:, :split] = 0.0
    values, vectors = np.linalg.eigh(blocks)
    fixed[bad] = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return fixed, int(bad.sum())


def _parts(n: int, first: IntArray, second: IntArray) -> tuple[int, IntArray]:
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    return int(count), label


def _held(graph: PoseGraph, first: IntArray, second: IntArray, parts: int, label: IntArray) -> IntArray:
    """Return fixed vertices, and the smallest id of each component without a fixed vertex or prior."""
    fixed = graph.vertices.fixed
    held = np.flatnonzero(fixed) if len(fixed) else np.zeros(0, np.int64)
    tied = np.zeros(parts, np.bool_)
    tied[label[held]] = True
    tied[label[first[first == second]]] = True
    order = np.argsort(graph.vertices.ids, kind="stable")
    leading = order[np.unique(label[order], return_index=True)[1]]  # the least id of each part
    return np.sort(np.concatenate([held, leading[~tied]]))
