# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Matches between the features of an image and the points of the most similar keyframes of a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import PoseGraph, VisualMap
from cdff_core.dfns.features_matching_2d.interface import (
    FeaturesMatching2DInputs,
    FeaturesMatching2DOutputs,
)
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.place_index import PlaceIndex

MatchingDfn = Dfn[Any, FeaturesMatching2DInputs, FeaturesMatching2DOutputs]


@dataclass(frozen=True, slots=True, eq=False)
class MapMatches:
    """Pairs of a map point and a feature.

    Attributes
    ----------
    points_m, covariances : ndarray, shapes (n, 3) and (n, 3, 3)
        Points in the map, metres, and the covariance of their measurement.
    features : ndarray of int, shape (n,)
        Row of the feature.
    vertices : ndarray of int, shape (n,)
        Row of the keyframe.
    """

    points_m: FloatArray
    covariances: FloatArray
    features: IntArray
    vertices: IntArray

    def __len__(self) -> int:
        return len(self.points_m)


class MapMatcher:
    """Map with its place index."""

    def __init__(
        self, value: VisualMap, match: MatchingDfn, clusters: int, direction_sigma: float, seed: int
    ) -> None:
        self.frame = value.frame
        self.points_m = value.points_m
        self.poses = np.array(value.graph.vertices.matrices).reshape(-1, 4, 4)
        self.pose_covariances = _prior_covariances(value.graph)
        self._keyframes, self._match = value.keyframes, match
        self._direction_sigma = direction_sigma
        self._index = PlaceIndex([k.descriptors for k in self._keyframes], clusters, seed)

    def match(self, features: ImageFeatures, candidates: int) -> MapMatches:
        """Return the matches with the most similar keyframes."""
        parts = [
            self._with_keyframe(features, v) for v in self._index.nearest(features.descriptors, candidates)
        ]
        if not parts:
            return MapMatches(
                np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64)
            )
        return MapMatches(
            np.concatenate([p.points_m for p in parts]),
            np.concatenate([p.covariances for p in parts]),
            np.concatenate([p.features for p in parts]),
            np.concatenate([p.vertices for p in parts]),
        )

    def _with_keyframe(self, features: ImageFeatures, vertex: int) -> MapMatches:
        keyframe, T = self._keyframes[vertex], self.poses[vertex]
        pairs = self._match.process(
            FeaturesMatching2DInputs(source=features.descriptors, sink=keyframe.descriptors)
        ).matches
        points, sigmas = keyframe.positions_m[pairs[:, 1]], keyframe.depth_sigmas_m[pairs[:, 1]]
        depths = points[:, 2]
        rays = points / depths[:, None]
        # Across the ray: the feature and the rotation of the keyframe; along it: the depth.
        rotation = np.sqrt(np.trace(self.pose_covariances[vertex][3:, 3:]) / 3.0)
        across = depths * np.hypot(self._direction_sigma, rotation)
        covariances = across[:, None, None] ** 2 * np.eye(3)
        covariances += sigmas[:, None, None] ** 2 * rays[:, :, None] * rays[:, None, :]
        R = T[:3, :3]
        return MapMatches(
            se3.transform_points(T, points),
            R @ covariances @ R.T,
            pairs[:, 0],
            np.full(len(pairs), vertex, np.int64),
        )


def _prior_covariances(graph: PoseGraph) -> FloatArray:
    """Return the covariances (n, 6, 6) of the vertices from their priors; 0 without one."""
    covariances = np.zeros((len(graph.vertices.ids), 6, 6))
    rows = {int(v): i for i, v in enumerate(graph.vertices.ids)}
    edges = graph.edges
    for (a, b), information in zip(edges.ends.tolist(), edges.information_matrices, strict=True):
        if a == b:
            covariances[rows[a]] = np.linalg.inv(information)
    return covariances
