# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Key frames: those of the map, and those of the drive on it."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import PoseGraph, PoseTrajectory
from cdff_common.types.pose_graph_ext import PRIOR


class KeyFrames:
    """Poses on the map, a way apart.

    Parameters
    ----------
    way_m : float
        Between key frames of the drive.
    """

    def __init__(self, way_m: float) -> None:
        self._way_m = way_m
        self._map: PoseGraph | None = None
        self._stamps: list[int] = []
        self._poses: list[UncertainTransform] = []

    def take(self, graph: PoseGraph) -> None:
        """Keep the key frames of the map; they replace those that came before."""
        self._map = graph

    def localised(self, stamp_ns: int, pose: UncertainTransform) -> None:
        """Make a pose of the drive a key frame if it is far enough from the last one."""
        last = self._poses[-1].matrix if self._poses else None
        if last is None or np.linalg.norm(pose.matrix[:3, 3] - last[:3, 3]) >= self._way_m:
            self._stamps.append(stamp_ns)
            self._poses.append(pose)

    @property
    def places_m(self) -> se3.FloatArray:
        """Positions ``(n, 3)`` of the map's key frames."""
        return np.zeros((0, 3)) if self._map is None else self._map.vertices.poses[:, :3]

    def trajectory(self, frame: str, child: str) -> PoseTrajectory | None:
        """Key frames of the drive; None before the first."""
        if not self._poses:
            return None
        covariances = np.array([p.covariance for p in self._poses])
        matrices = np.array([p.matrix for p in self._poses])
        return PoseTrajectory.from_arrays(self._stamps, matrices, covariances, parent=frame, child=child)

    def graph(self, frame: str) -> PoseGraph | None:
        """All key frames: those of the map with its edges, then those of the drive, each with a prior on the map."""
        if self._map is None and not self._poses:
            return None
        known = self._map
        n = len(self._poses)
        own = np.array([p.matrix for p in self._poses]).reshape(-1, 4, 4)
        information = np.array([np.linalg.inv(p.covariance) for p in self._poses]).reshape(-1, 6, 6)
        first = 0 if known is None or not len(known.vertices.ids) else int(known.vertices.ids.max()) + 1
        ids = first + np.arange(n)
        ends = np.column_stack([ids, ids])
        kinds = np.full(n, PRIOR)
        if known is None:
            return PoseGraph.from_arrays(ids, self._stamps, own, ends, own, information, kinds, frame=frame)
        v, e = known.vertices, known.edges
        return PoseGraph.from_arrays(
            np.concatenate([v.ids, ids]), np.concatenate([v.stamps_ns, np.array(self._stamps, dtype=np.int64)]),
            np.concatenate([v.matrices, own]), np.concatenate([e.ends, ends]), np.concatenate([e.matrices, own]),
            np.concatenate([e.information_matrices, information]), np.concatenate([e.kinds, kinds]), frame=frame,
        )  # fmt: skip
