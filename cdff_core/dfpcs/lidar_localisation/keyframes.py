# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes of the map and of the current run."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import information_from_covariance
from cdff_common.types import PoseGraph, PoseTrajectory
from cdff_common.types.pose_graph_ext import PRIOR


class Keyframes:
    """Keyframes of the map, and keyframes of the run at a minimum distance from each other."""

    def __init__(self, distance_m: float) -> None:
        self._distance_m = distance_m
        self._map: PoseGraph | None = None
        self._stamps: list[int] = []
        self._poses: list[UncertainTransform] = []

    def set_map(self, graph: PoseGraph) -> None:
        """Replace the keyframes of the map."""
        self._map = graph

    def add_pose(self, stamp_ns: int, pose: UncertainTransform) -> None:
        """Add a pose of the run as a keyframe if it is far enough from the last one."""
        last = self._poses[-1].matrix if self._poses else None
        if last is None or np.linalg.norm(pose.matrix[:3, 3] - last[:3, 3]) >= self._distance_m:
            self._stamps.append(stamp_ns)
            self._poses.append(pose)

    @property
    def positions_m(self) -> se3.FloatArray:
        """Positions ``(n, 3)`` of the keyframes of the map."""
        return np.zeros((0, 3)) if self._map is None else self._map.vertices.poses[:, :3]

    def trajectory(self, frame: str, child: str) -> PoseTrajectory | None:
        """Return the keyframes of the run; None before the first one."""
        if not self._poses:
            return None
        covariances = np.array([p.covariance for p in self._poses])
        matrices = np.array([p.matrix for p in self._poses])
        return PoseTrajectory.from_arrays(self._stamps, matrices, covariances, parent=frame, child=child)

    def graph(self, frame: str) -> PoseGraph | None:
        """Return keyframes and edges of the map, and the keyframes of the run with priors in the map."""
        if self._map is None and not self._poses:
            return None
        n = len(self._poses)
        run_poses = np.array([p.matrix for p in self._poses]).reshape(-1, 4, 4)
        information = information_from_covariance(
            np.array([p.covariance for p in self._poses]).reshape(-1, 6, 6)
        )
        last_id = -1 if self._map is None else max(self._map.vertices.ids, default=-1)
        ids = last_id + 1 + np.arange(n)
        keyframe_pairs = np.column_stack([ids, ids])
        kinds = np.full(n, PRIOR)
        if self._map is None:
            return PoseGraph.from_arrays(
                ids, self._stamps, run_poses, keyframe_pairs, run_poses, information, kinds, frame=frame
            )
        v, e = self._map.vertices, self._map.edges
        return PoseGraph.from_arrays(
            np.concatenate([v.ids, ids]),
            np.concatenate([v.stamps_ns, np.array(self._stamps, dtype=np.int64)]),
            np.concatenate([v.matrices, run_poses]),
            np.concatenate([e.ends, keyframe_pairs]),
            np.concatenate([e.matrices, run_poses]),
            np.concatenate([e.information_matrices, information]),
            np.concatenate([e.kinds, kinds]),
            frame=frame,
        )
