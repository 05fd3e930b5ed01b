# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes of a camera with their points, and the links between points of different keyframes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import PoseGraph, VisualMap
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY, PRIOR
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.keyframe_graph.graph import KeyframeGraph
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.keyframe_points import StereoMeasurement
from cdff_core.visual_map.matches import MAP_FOCAL_PX

#: Smallest standard deviations of a pose in an exported map, metres and radians.
_MIN_SIGMAS = np.repeat([1e-3, 1e-3], 3)


@dataclass(frozen=True, slots=True, eq=False)
class VisualKeyframe:
    """Points of a camera at one pose, whose frame is the frame of the keyframe."""

    stamp_ns: int
    points: KeyframePoints
    focal_px: float
    median_depth_m: float
    stereo: StereoMeasurement | None = None

    @classmethod
    def of_points(
        cls,
        stamp_ns: int,
        points: KeyframePoints,
        focal_px: float,
        stereo: StereoMeasurement | None = None,
    ) -> VisualKeyframe:
        """Return the keyframe of measured points."""
        median_depth_m = float(np.median(points.positions_m[:, 2])) if len(points) else 1.0
        return cls(stamp_ns, points, focal_px, median_depth_m, stereo)

    def features(self) -> ImageFeatures:
        """Return the points as features of an image."""
        directions = self.points.positions_m[:, :2] / self.points.positions_m[:, 2:]
        return ImageFeatures(self.focal_px * directions, directions, self.points.descriptors)


class VisualKeyframeMap(KeyframeGraph[VisualKeyframe]):
    """Graph of keyframes with points.

    Attributes
    ----------
    links : dict
        For each linked pair of keyframes a < b the rows (n, 2) of common points in a and b.
    """

    def __init__(self) -> None:
        super().__init__()
        self.links: dict[tuple[int, int], IntArray] = {}
        self._linked: dict[int, set[int]] = {}

    def link(self, a: int, b: int, rows_a: IntArray, rows_b: IntArray) -> None:
        """Set the common points of two keyframes."""
        rows = np.column_stack([rows_a, rows_b] if a < b else [rows_b, rows_a])
        self.links[min(a, b), max(a, b)] = rows
        self._linked.setdefault(a, set()).add(b)
        self._linked.setdefault(b, set()).add(a)

    def unlink(self, a: int, b: int) -> None:
        """Remove the common points of two keyframes."""
        self.links.pop((min(a, b), max(a, b)), None)
        self._linked.get(a, set()).discard(b)
        self._linked.get(b, set()).discard(a)

    def linked_with(self, key: int) -> dict[int, int]:
        """Return the number of points in common with each linked keyframe."""
        return {k: len(self.links[min(k, key), max(k, key)]) for k in self._linked.get(key, ())}

    def neighbours(self, key: int, count: int) -> list[int]:
        """Return the linked keyframes with most common points, or successors in the graph without any."""
        shared = self.linked_with(key)
        if not shared:
            shared = {(b if a == key else a): 0 for a, b, _ in self.edges if key in (a, b) and a != b}
        return sorted(shared, key=lambda k: (-shared[k], k))[:count]

    def optimise(self, optimiser: Dfn[Any, Any, Any]) -> int:
        """Optimise the root's component; rejected loops also lose their common points."""
        loops = {e[:2] for e in self.edges if e[2] == LOOP_CLOSURE}
        rejected = super().optimise(optimiser)
        connected = {(min(a, b), max(a, b)) for a, b, _ in self.edges}
        for a, b in loops:
            if (min(a, b), max(a, b)) not in connected:
                self.unlink(a, b)
        return rejected

    def replace_by(self, key: int, older: int, T_older_key: UncertainTransform) -> None:
        """Remove a keyframe: its edges become loop closures of an older one; its points are discarded."""
        for other in list(self._linked.get(key, ())):
            self.unlink(key, other)
        super().replace_by(key, older, T_older_key)

    def edge_covariance(self, a: int, b: int) -> FloatArray:
        """Return the covariance of ``T_a_b`` of the best edge between two keyframes, or of ``T_map_b``."""
        edges = [
            T if ends == (a, b) else T.inverse()
            for (*ends_list, _), T in self.edges.items()
            if (ends := tuple(ends_list)) in ((a, b), (b, a))
        ]
        covariances = [T.covariance for T in edges if T.covariance is not None]
        if not covariances:
            return self.covariances[b]
        return min(covariances, key=lambda c: float(np.trace(c[:3, :3])))

    def adjust(self, poses: dict[int, FloatArray], fixed: Collection[int]) -> None:
        """Set adjusted poses, and the edges between adjusted keyframes and from them to fixed keyframes."""
        for key, T in poses.items():
            self.poses[key] = se3.normalise_transform(T)
        known = set(poses) | set(fixed)
        for (a, b, kind), T_edge in list(self.edges.items()):
            if a in known and b in known and (a in poses or b in poses) and self.has_link(a, b):
                T_a_b = se3.normalise_transform(se3.inverse(self.poses[a]) @ self.poses[b])
                self.edges[a, b, kind] = UncertainTransform(T_a_b, T_edge.covariance)
        self._distances = None

    def has_link(self, a: int, b: int) -> bool:
        """Return whether two keyframes have common points."""
        return (min(a, b), max(a, b)) in self.links

    def to_message(self, keys: Collection[int], *, frame: str, sensor: str, producer: str) -> VisualMap:
        """Return the map of some keyframes; each has a prior with the covariance of its pose."""
        graph = self.to_graph(keys, frame=frame, producer=producer)
        ids = [int(k) for k in graph.vertices.ids]
        covariances = np.array([self.covariances[k] for k in ids]).reshape(-1, 6, 6)
        covariances = covariances + np.diag(_MIN_SIGMAS**2)
        edges = graph.edges
        graph = PoseGraph.from_arrays(
            graph.vertices.ids,
            graph.vertices.stamps_ns,
            graph.vertices.matrices,
            np.concatenate([edges.ends.reshape(-1, 2), np.column_stack([ids, ids]).reshape(-1, 2)]),
            np.concatenate([edges.matrices, graph.vertices.matrices]),
            np.concatenate([edges.information_matrices, np.linalg.inv(covariances)]),
            np.concatenate([edges.kinds, np.full(len(ids), PRIOR)]),
            frame=frame,
            fixed=graph.vertices.fixed,
            producer=producer,
        )
        return VisualMap.from_parts(
            graph,
            [self.keyframes[k].points for k in ids],
            sensor=sensor,
            stamp_ns=max((self.keyframes[k].stamp_ns for k in ids), default=0),
            descriptor_type="ROOT_SIFT",
            producer=producer,
        )

    def add_message(self, message: VisualMap) -> dict[int, int]:
        """Add a map as a separate component; return the new id of each keyframe by its id in the message."""
        stamps_ns = message.graph.vertices.stamps_ns.tolist()
        keyframes = [
            VisualKeyframe.of_points(stamp_ns, points, MAP_FOCAL_PX)
            for stamp_ns, points in zip(stamps_ns, message.keyframes, strict=True)
        ]
        new_ids = self.insert_graph(message.graph, keyframes)
        self._connect_by_frame(message.graph, new_ids)
        return new_ids

    def _connect_by_frame(self, graph: PoseGraph, new_ids: dict[int, int]) -> None:
        """Add edges from the first vertex to vertices that no edge connects with it: their relative poses
        are known from the frame of the map.

        The covariance of each is that of the priors of both vertices, exact without one.
        """
        edges = graph.edges
        priors = dict.fromkeys(new_ids.values(), np.diag(_MIN_SIGMAS**2))
        for (a, b), information in zip(edges.ends.tolist(), edges.information_matrices, strict=True):
            if a == b:
                priors[new_ids[a]] = np.linalg.inv(information)
        if not new_ids:
            return
        first = next(iter(new_ids.values()))
        connected = self.component(first)
        origin = UncertainTransform(self.poses[first], priors[first]).inverse()
        for key, covariance in priors.items():
            if key not in connected:
                self.edges[first, key, ODOMETRY] = origin @ UncertainTransform(self.poses[key], covariance)
                self.covariances[key] = covariance
        self._distances = None
