# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chordal initial poses against dense least squares over the entries of the rotations and translations."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY, PRIOR
from cdff_core.dfns.pose_graph_optimization._chordal import chordal_poses
from cdff_core.dfns.pose_graph_optimization._problem import make_problem

#: Edges from fixed to free, free to free in both directions, free to fixed, between fixed, and a prior.
ENDS = [(0, 1), (1, 2), (3, 2), (3, 0), (4, 1), (0, 5), (3, 3), (2, 4)]
KINDS = [ODOMETRY, ODOMETRY, LOOP_CLOSURE, LOOP_CLOSURE, ODOMETRY, ODOMETRY, PRIOR, LOOP_CLOSURE]
FIXED = [True, False, False, False, False, True]
WEIGHTS = np.array([1.0, 0.5, 2.0, 1.5, 0.25, 3.0, 0.75, 0.0])


def graph(seed: int) -> PoseGraph:
    rng = np.random.default_rng(seed)
    poses = se3.exp_se3(rng.normal(size=(6, 6)))
    exact = [poses[a] if a == b else se3.inverse(poses[a]) @ poses[b] for a, b in ENDS]
    measured = np.array(exact) @ se3.exp_se3(0.1 * rng.normal(size=(len(ENDS), 6)))
    information = np.array([np.diag(rng.uniform(0.5, 5.0, 6)) for _ in ENDS])
    return PoseGraph.from_arrays(
        range(6), [0] * 6, poses, ENDS, measured, information, KINDS, frame="map", fixed=FIXED
    )


def nearest_rotation(M: np.ndarray) -> np.ndarray:
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def dense(g: PoseGraph) -> np.ndarray:
    """Return the poses by two dense problems, with the mean information of each edge's measurement frame."""
    Z, poses, free_vertices = g.edges.matrices, g.vertices.matrices, [1, 2, 3, 4]
    problem = make_problem(g)  # only for the information of the edges in its axes
    kappa = WEIGHTS * np.diagonal(problem.information, axis1=1, axis2=2)[:, 3:].mean(axis=1)
    tau = WEIGHTS * np.diagonal(problem.information, axis1=1, axis2=2)[:, :3].mean(axis=1)
    A, B = np.zeros((9 * len(ENDS), 9 * 4)), np.zeros(9 * len(ENDS))
    for m, (a, b) in enumerate(ENDS):
        rows, root = slice(9 * m, 9 * m + 9), np.sqrt(kappa[m])
        times = np.kron(np.eye(3), Z[m, :3, :3].T)  # of a rotation's entries, row by row: R_a -> R_a R_ab
        if a == b:
            A[rows, 9 * free_vertices.index(a) : 9 * free_vertices.index(a) + 9] = root * np.eye(9)
            B[rows] = root * Z[m, :3, :3].ravel()
            continue
        for vertex, block in ((b, np.eye(9)), (a, -times)):
            if vertex in free_vertices:
                A[rows, 9 * free_vertices.index(vertex) : 9 * free_vertices.index(vertex) + 9] = root * block
            else:
                B[rows] -= root * block @ poses[vertex, :3, :3].ravel()
    solution = np.linalg.lstsq(A, B, rcond=None)[0].reshape(4, 3, 3)
    R = poses[:, :3, :3].copy()
    R[free_vertices] = [nearest_rotation(M) for M in solution]
    A, B = np.zeros((3 * len(ENDS), 12)), np.zeros(3 * len(ENDS))
    for m, (a, b) in enumerate(ENDS):
        rows, root = slice(3 * m, 3 * m + 3), np.sqrt(tau[m])
        B[rows] = root * (Z[m, :3, 3] if a == b else R[a] @ Z[m, :3, 3])
        for vertex, sign in ((b, 1.0), (a, -1.0)) if a != b else ((b, 1.0),):
            if vertex in free_vertices:
                k = 3 * free_vertices.index(vertex)
                A[rows, k : k + 3] += sign * root * np.eye(3)
            else:
                B[rows] -= sign * root * poses[vertex, :3, 3]
    t = poses[:, :3, 3].copy()
    t[free_vertices] = np.linalg.lstsq(A, B, rcond=None)[0].reshape(4, 3)
    return se3.transform(R, t)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_poses_are_those_of_two_dense_least_squares_problems(seed: int) -> None:
    g = graph(seed)
    poses = chordal_poses(make_problem(g), g.vertices.matrices, WEIGHTS)
    np.testing.assert_allclose(poses, dense(g), atol=1e-6)


def test_exact_measurements_give_the_true_poses_from_any_poses_of_free_vertices(
    rng: np.random.Generator,
) -> None:
    true = se3.exp_se3(rng.normal(size=(6, 6)))
    exact = [true[a] if a == b else se3.inverse(true[a]) @ true[b] for a, b in ENDS]
    initial = true.copy()
    initial[1:5] = se3.exp_se3(rng.normal(size=(4, 6)))
    g = PoseGraph.from_arrays(
        range(6), [0] * 6, initial, ENDS, exact, np.tile(np.eye(6), (len(ENDS), 1, 1)), KINDS, frame="map",
        fixed=FIXED,
    )  # fmt: skip
    np.testing.assert_allclose(chordal_poses(make_problem(g), initial, np.ones(len(ENDS))), true, atol=1e-6)


def test_poses_of_fixed_vertices_are_unchanged() -> None:
    g = graph(3)
    poses = chordal_poses(make_problem(g), g.vertices.matrices, WEIGHTS)
    np.testing.assert_array_equal(poses[[0, 5]], g.vertices.matrices[[0, 5]])
