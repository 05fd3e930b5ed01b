# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Key frames, what was measured between them, and where that puts them."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import LidarMap, PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY
from cdff_core.dfns.pose_graph_optimization._interface import PoseGraphOptimizationInputs

Float = NDArray[np.float64]

_LEAST_SIGMA = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """A place and what was seen from it.

    Attributes
    ----------
    stamp_ns : int
        Of the sweep whose lidar frame it is.
    points_m : ndarray of float32, shape (n, 3)
        In the key frame.
    descriptor : ndarray of float32, shape (d,), or None
        Of LoopDetection; None while the key frame has not ended.
    """

    stamp_ns: int
    points_m: NDArray[np.float32]
    descriptor: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A measured ``T_a_b`` with covariance, and of which kind."""

    T: UncertainTransform
    kind: int

    @property
    def way_m(self) -> float:
        """Distance between the two."""
        return float(np.linalg.norm(self.T.matrix[:3, 3]))


class KeyFrameMap:
    """Places by id, edges by the pair of ids, poses in the frame of the map.

    The map may fall into parts, as long as no loop links them; ``root`` is the place whose part's frame is the map's.
    Between two places there is one edge of each kind at most, the better known, so that driving round and round does
    not make the graph grow.
    """

    def __init__(self) -> None:
        self.frames: dict[int, KeyFrame] = {}
        self.poses: dict[int, Float] = {}
        self.covariances: dict[int, Float] = {}
        self.edges: dict[tuple[int, int, int], Edge] = {}
        self.root: int | None = None
        self.loops_rejected = 0
        self._next = 0

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def point_bytes(self) -> int:
        """Memory of the clouds."""
        return sum(f.points_m.nbytes for f in self.frames.values())

    @property
    def loops(self) -> int:
        """Loop closures in the graph."""
        return sum(kind == LOOP_CLOSURE for _, _, kind in self.edges)

    def begin(self, stamp_ns: int, T_map_key: Float) -> int:
        """Add a place without an edge; the first of all is the root."""
        key = self._add(KeyFrame(stamp_ns, np.zeros((0, 3), np.float32)), T_map_key, np.zeros((6, 6)))
        self.root = key if self.root is None else self.root
        return key

    def follow(self, before: int, stamp_ns: int, T: UncertainTransform) -> int:
        """Add the place that the odometry reached from another one."""
        here = UncertainTransform(self.poses[before], self.covariances[before]) @ T
        assert here.covariance is not None  # both have one
        key = self._add(KeyFrame(stamp_ns, np.zeros((0, 3), np.float32)), here.matrix, here.covariance)
        self.edges[before, key, ODOMETRY] = Edge(T, ODOMETRY)
        return key

    def link(self, a: int, b: int, T: UncertainTransform) -> None:
        """Add a loop, the better known of two that link the same places; a part that it links moves to the root's."""
        rooted = self.part(self.root) if self.root is not None else set()
        if (a in rooted) != (b in rooted):
            inner, outer, T_in_out = (a, b, T.matrix) if a in rooted else (b, a, se3.inverse(T.matrix))
            shift = self.poses[inner] @ T_in_out @ se3.inverse(self.poses[outer])
            for key in self.part(outer):
                self.poses[key] = _rigid(shift @ self.poses[key])
        self._keep_better(a, b, LOOP_CLOSURE, T)

    def unlink(self, key: int) -> None:
        """Take the loops of a place away, for better ones."""
        for edge in [e for e in self.edges if key in e[:2] and e[2] == LOOP_CLOSURE]:
            del self.edges[edge]

    def dissolve(self, key: int, into: int, T_into_key: UncertainTransform) -> None:
        """Remove a place that lies next to an older one; what was measured to it was measured to that."""
        for a, b, kind in [e for e in self.edges if key in e[:2]]:
            edge = self.edges.pop((a, b, kind))
            if into in (a, b):
                continue
            if b == key:
                self._keep_better(a, into, LOOP_CLOSURE, edge.T @ T_into_key.inverse())
            else:
                self._keep_better(into, b, LOOP_CLOSURE, T_into_key @ edge.T)
        del self.frames[key], self.poses[key], self.covariances[key]

    def part(self, key: int | None) -> set[int]:
        """Places linked with one by edges, itself included."""
        return set() if key is None else set(self.ways_m(key))

    def ways_m(self, key: int) -> dict[int, float]:
        """Shortest way along edges from one place to each that can be reached (Dijkstra)."""
        neighbours: dict[int, list[tuple[int, float]]] = {k: [] for k in self.frames}
        for (a, b, _), edge in self.edges.items():
            neighbours[a].append((b, edge.way_m))
            neighbours[b].append((a, edge.way_m))
        ways, heap = {}, [(0.0, key)]
        while heap:
            way, at = heapq.heappop(heap)
            if at in ways:
                continue
            ways[at] = way
            for other, step in neighbours[at]:
                if other not in ways:
                    heapq.heappush(heap, (way + step, other))
        return ways

    def optimise(self, node: Dfn[Any, Any, Any]) -> int:
        """Poses and covariances of the root's part anew; loops that contradict the rest go, and are counted."""
        keys = sorted(self.part(self.root))
        graph = self.graph(keys)
        found = node.process(PoseGraphOptimizationInputs(graph=graph, wanted=np.array(keys, dtype=np.int64)))
        inside = [e for e in self.edges if e[0] in set(keys)]
        rejected = [e for e, weight in zip(inside, found.weights, strict=True) if weight < 0.5]
        for edge in rejected:
            del self.edges[edge]
        self.loops_rejected += len(rejected)
        for key, T, covariance in zip(keys, found.graph.vertices.matrices, found.covariances, strict=True):
            self.poses[key], self.covariances[key] = T, covariance
        return len(rejected)

    def graph(self, keys: Iterable[int] | None = None, *, frame: str = "map", producer: str = "") -> PoseGraph:
        """Places (all where none are named) and the edges between them; the root is held."""
        keys = sorted(self.frames if keys is None else keys)
        inside = set(keys)
        edges = {e: v for e, v in self.edges.items() if e[0] in inside}
        return PoseGraph.from_arrays(
            keys,
            [self.frames[k].stamp_ns for k in keys],
            np.array([self.poses[k] for k in keys]).reshape(-1, 4, 4),
            np.array([e[:2] for e in edges], dtype=np.int64).reshape(-1, 2),
            np.array([e.T.matrix for e in edges.values()]).reshape(-1, 4, 4),
            np.array([_information(e.T) for e in edges.values()]).reshape(-1, 6, 6),
            np.array([e[2] for e in edges], dtype=np.int64),
            frame=frame,
            fixed=[k == self.root for k in keys],
            producer=producer,
        )

    def to_message(self, *, frame: str, sensor: str, producer: str, position: tuple[int, Float] | None) -> LidarMap:
        """All of it as a message."""
        graph = self.graph(frame=frame, producer=producer)
        clouds = [self.frames[int(k)].points_m for k in graph.vertices.ids]
        newest = max((f.stamp_ns for f in self.frames.values()), default=0)
        return LidarMap.from_parts(graph, clouds, sensor=sensor, stamp_ns=newest, position=position, producer=producer)

    def absorb(self, message: LidarMap) -> dict[int, int]:
        """Add the places and edges of a message as a part of their own; return the new id of each.

        The first map ever gives the frame: the vertex that is held in it, or else the first, becomes the root.
        """
        vertices, edges = message.graph.vertices, message.graph.edges
        new: dict[int, int] = {}
        columns = zip(vertices.ids, vertices.stamps_ns, vertices.matrices, message.clouds_m, strict=True)
        for key, stamp_ns, T, points in columns:
            new[int(key)] = self._add(KeyFrame(int(stamp_ns), np.array(points)), T, np.zeros((6, 6)))
        values = zip(edges.ends, edges.matrices, edges.information_matrices, edges.kinds, strict=True)
        for (a, b), T, information, kind in values:
            edge = UncertainTransform(T, np.linalg.inv(information))
            self.edges[new[int(a)], new[int(b)], int(kind)] = Edge(edge, int(kind))
        if self.root is None and new:
            held = vertices.ids[vertices.fixed > 0] if len(vertices.fixed) else vertices.ids[:1]
            self.root = new[int(held[0] if len(held) else vertices.ids[0])]
        return new

    def _add(self, frame: KeyFrame, T: Float, covariance: Float) -> int:
        key, self._next = self._next, self._next + 1
        self.frames[key], self.poses[key], self.covariances[key] = frame, _rigid(T), covariance
        return key

    def _keep_better(self, a: int, b: int, kind: int, T: UncertainTransform) -> None:
        """Add an edge, a below b, unless one of the kind is there that is known better."""
        if a > b:
            a, b, T = b, a, T.inverse()
        before = self.edges.get((a, b, kind))
        if before is None or _spread(T) < _spread(before.T):
            self.edges[a, b, kind] = Edge(T, kind)


def _rigid(T: Float) -> Float:
    return se3.transform(se3.normalise_rotation(T[:3, :3]), T[:3, 3])


def _spread(T: UncertainTransform) -> float:
    assert T.covariance is not None  # edges have one
    return float(np.trace(T.covariance[:3, :3]))


def _information(T: UncertainTransform) -> Float:
    assert T.covariance is not None  # edges have one
    information = np.linalg.inv(T.covariance + _LEAST_SIGMA**2 * np.eye(6))
    return np.asarray(0.5 * (information + information.T))
