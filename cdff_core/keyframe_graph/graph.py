# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes and the pose graph between them."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import information_from_covariance
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY, PRIOR
from cdff_core.dfns.pose_graph_optimization.interface import PoseGraphOptimizationInputs

logger = logging.getLogger(__name__)

Float = NDArray[np.float64]
#: Keyframe a, keyframe b and kind of an edge ``T_a_b``.
EdgeKey = tuple[int, int, int]

#: Minimum standard deviation of an edge in the exported graph, so that its covariance can be inverted.
_MIN_SIGMA = 1e-4
#: Weight below which the robust optimisation has rejected an edge.
_REJECTED_WEIGHT = 0.5


class Keyframe(Protocol):
    """Measurements at one pose of the sensor, whose frame is the frame of the keyframe."""

    @property
    def stamp_ns(self) -> int:
        """Time of the keyframe."""


K = TypeVar("K", bound=Keyframe)


class KeyframeGraph(Generic[K]):
    """Keyframes by id, their poses in the map frame, and edges by pair of ids and kind.

    The graph may have several connected components until loop closures connect them; the component of
    ``root`` defines the map frame. A pair of keyframes has at most one edge of each kind, the one with the
    smallest covariance, so that repeated passes do not make the graph grow.
    """

    def __init__(self) -> None:
        self.keyframes: dict[int, K] = {}
        self.poses: dict[int, Float] = {}
        self.covariances: dict[int, Float] = {}
        self.edges: dict[EdgeKey, UncertainTransform] = {}
        self.root: int | None = None
        self.loops_rejected = 0
        self._next_id = 0
        self._distances: tuple[dict[int, int], Any] | None = None

    def __len__(self) -> int:
        return len(self.keyframes)

    @property
    def linked(self) -> set[int]:
        """Keyframes connected with the root, whose poses in the map frame are known."""
        return self.component(self.root)

    @property
    def first_ns(self) -> int:
        """Stamp of the oldest keyframe."""
        return min(keyframe.stamp_ns for keyframe in self.keyframes.values())

    @property
    def last_ns(self) -> int:
        """Stamp of the newest keyframe."""
        return max(keyframe.stamp_ns for keyframe in self.keyframes.values())

    @property
    def loop_count(self) -> int:
        """Number of loop closures in the graph."""
        return sum(1 for _ in self.loop_closures())

    def loop_closures(self) -> Iterator[tuple[int, int, UncertainTransform]]:
        """Yield both keyframes and ``T_a_b`` of each loop closure in the graph."""
        return ((a, b, T) for (a, b, kind), T in self.edges.items() if kind == LOOP_CLOSURE)

    def pose(self, key: int) -> UncertainTransform:
        """Return ``T_map_keyframe``."""
        return UncertainTransform(self.poses[key], self.covariances[key])

    def distance_m(self, key: int, position_m: Float) -> float:
        """Return the distance of a keyframe from a position (3,) in the map frame."""
        return float(np.linalg.norm(self.poses[key][:3, 3] - position_m))

    def insert_component(self, keyframe: K, T_map_keyframe: Float) -> int:
        """Add a keyframe without an edge and return its id; the first keyframe of all becomes the root."""
        key = self._add(keyframe, T_map_keyframe, np.zeros((6, 6)))
        self.root = key if self.root is None else self.root
        return key

    def insert_successor(self, previous: int, keyframe: K, T_previous_keyframe: UncertainTransform) -> int:
        """Add a keyframe with an odometry edge from the previous one and return its id."""
        pose = self.pose(previous) @ T_previous_keyframe
        assert pose.covariance is not None  # both factors have one
        key = self._add(keyframe, pose.matrix, pose.covariance)
        self.edges[previous, key, ODOMETRY] = T_previous_keyframe
        return key

    def add_loop(self, a: int, b: int, T_a_b: UncertainTransform) -> None:
        """Add a loop closure; if it connects two components, one is transformed to satisfy it.

        The component of the root keeps its poses, otherwise that of ``a``.
        """
        if b not in self.component(a):
            fixed, moved, T_fixed_moved = a, b, T_a_b.matrix
            if b in self.component(self.root):
                fixed, moved, T_fixed_moved = b, a, se3.inverse(T_a_b.matrix)
            correction = self.poses[fixed] @ T_fixed_moved @ se3.inverse(self.poses[moved])
            for key in self.component(moved):
                self.poses[key] = se3.normalise_transform(correction @ self.poses[key])
        self._add_loop_edge(a, b, T_a_b)

    def remove_loops(self, key: int) -> None:
        """Remove the loop closures of a keyframe."""
        for a, b, kind in list(self.edges):
            if key in (a, b) and kind == LOOP_CLOSURE:
                del self.edges[a, b, kind]
        self._distances = None

    def replace_by(self, key: int, older: int, T_older_key: UncertainTransform) -> None:
        """Remove a keyframe: its edges become loop closures of an older keyframe, and its points are
        discarded.

        Odometry edges also become loop closures: they then contain ``T_older_key``, which a wrong loop may
        have given, and only loop closures can be rejected by the robust optimisation.
        """
        for a, b, kind in [(a, b, kind) for a, b, kind in self.edges if key in (a, b)]:
            T_a_b = self.edges.pop((a, b, kind))
            if older in (a, b):
                continue
            if b == key:
                self._add_loop_edge(a, older, T_a_b @ T_older_key.inverse())
            else:
                self._add_loop_edge(older, b, T_older_key @ T_a_b)
        del self.keyframes[key], self.poses[key], self.covariances[key]
        self._distances = None

    def component(self, key: int | None) -> set[int]:
        """Return the keyframes connected with a keyframe, including itself; empty for None."""
        return set() if key is None else set(self.path_lengths_m(key))

    def path_lengths_m(self, key: int) -> dict[int, float]:
        """Return the length of the shortest path along edges to each connected keyframe, metres."""
        from scipy.sparse.csgraph import dijkstra

        rows, graph = self._distance_graph()
        lengths = dijkstra(graph, directed=False, indices=rows[key])
        return {k: float(lengths[row]) for k, row in rows.items() if np.isfinite(lengths[row])}

    def optimise(self, optimiser: Dfn[Any, Any, Any]) -> int:
        """Optimise the component of the root; return the number of loop closures removed as contradictory."""
        keys = sorted(self.component(self.root))
        solution = optimiser.process(
            PoseGraphOptimizationInputs(graph=self.to_graph(keys), wanted=np.array(keys, dtype=np.int64))
        )
        edges = [(a, b, kind) for a, b, kind in self.edges if a in set(keys)]
        rejected = [edge for edge, w in zip(edges, solution.weights, strict=True) if w < _REJECTED_WEIGHT]
        for edge in rejected:
            del self.edges[edge]
        self._distances = None
        self.loops_rejected += len(rejected)
        if not solution.converged:
            logger.warning(
                "pose graph of %d keyframes: no convergence after %d iterations",
                len(keys),
                solution.iterations,
            )
        matrices = solution.graph.vertices.matrices
        for key, T, covariance in zip(keys, matrices, solution.covariances, strict=True):
            self.poses[key], self.covariances[key] = T, covariance
        return len(rejected)

    def to_graph(
        self, keys: Iterable[int] | None = None, *, frame: str = "map", producer: str = ""
    ) -> PoseGraph:
        """Return a graph of some keyframes (default: all) and the edges between them; the root is fixed."""
        keys = sorted(self.keyframes if keys is None else keys)
        inside = set(keys)
        edges = {(a, b, kind): T for (a, b, kind), T in self.edges.items() if a in inside}
        covariances = np.array([T.covariance for T in edges.values()])
        return PoseGraph.from_arrays(
            keys,
            [self.keyframes[k].stamp_ns for k in keys],
            np.array([self.poses[k] for k in keys]).reshape(-1, 4, 4),
            np.array([(a, b) for a, b, _ in edges], dtype=np.int64).reshape(-1, 2),
            np.array([T.matrix for T in edges.values()]).reshape(-1, 4, 4),
            information_from_covariance(covariances.reshape(-1, 6, 6), _MIN_SIGMA),
            np.array([kind for _, _, kind in edges], dtype=np.int64),
            frame=frame,
            fixed=[k == self.root for k in keys],
            producer=producer,
        )

    def insert_graph(self, graph: PoseGraph, keyframes: Sequence[K]) -> dict[int, int]:
        """Add a graph with the keyframe of each vertex as a separate component; return the new ids.

        Priors of vertices are omitted. In an empty map the fixed vertex of the graph, or else its first one,
        becomes the root.
        """
        vertices, edges = graph.vertices, graph.edges
        new_ids: dict[int, int] = {}
        for key, T, keyframe in zip(vertices.ids, vertices.matrices, keyframes, strict=True):
            new_ids[int(key)] = self._add(keyframe, T, np.zeros((6, 6)))
        values = zip(edges.ends, edges.matrices, edges.information_matrices, edges.kinds, strict=True)
        for (a, b), T, information, kind in values:
            if kind != PRIOR:
                self.edges[new_ids[int(a)], new_ids[int(b)], int(kind)] = UncertainTransform(
                    T, np.linalg.inv(information)
                )
        if self.root is None and new_ids:
            fixed = vertices.ids[vertices.fixed > 0] if len(vertices.fixed) else vertices.ids[:1]
            self.root = new_ids[int(fixed[0] if len(fixed) else vertices.ids[0])]
        return new_ids

    def _add(self, keyframe: K, T_map_keyframe: Float, covariance: Float) -> int:
        key, self._next_id = self._next_id, self._next_id + 1
        self.keyframes[key] = keyframe
        self.poses[key], self.covariances[key] = se3.normalise_transform(T_map_keyframe), covariance
        self._distances = None
        return key

    def _add_loop_edge(self, a: int, b: int, T_a_b: UncertainTransform) -> None:
        """Add a loop closure with a < b, unless the existing one has a smaller covariance."""
        if a > b:
            a, b, T_a_b = b, a, T_a_b.inverse()
        existing = self.edges.get((a, b, LOOP_CLOSURE))
        if existing is None or _position_variance(T_a_b) < _position_variance(existing):
            self.edges[a, b, LOOP_CLOSURE] = T_a_b
            self._distances = None

    def _distance_graph(self) -> tuple[dict[int, int], Any]:
        """Return the row of each keyframe and the sparse matrix of edge lengths, cached."""
        from scipy.sparse import csr_matrix

        if self._distances is None:
            rows = {key: row for row, key in enumerate(self.keyframes)}
            lengths: dict[tuple[int, int], float] = {}
            for (a, b, _), T in self.edges.items():
                pair = (rows[min(a, b)], rows[max(a, b)])
                length_m = float(np.linalg.norm(T.matrix[:3, 3]))
                lengths[pair] = min(length_m, lengths.get(pair, np.inf))
            edge_rows = np.array(list(lengths), dtype=np.int64).reshape(-1, 2)
            values = np.array(list(lengths.values()))
            self._distances = (
                rows,
                csr_matrix((values, (edge_rows[:, 0], edge_rows[:, 1])), shape=(len(rows),) * 2),
            )
        return self._distances


def _position_variance(T: UncertainTransform) -> float:
    assert T.covariance is not None  # edges have one
    return float(np.trace(T.covariance[:3, :3]))
