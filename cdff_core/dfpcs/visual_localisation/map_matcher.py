# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Matches between the features of an image and the points of the most similar keyframes of a map."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.types import PoseGraph, VisualMap
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MapMatches, MatchingDfn, match_keyframe
from cdff_core.visual_map.place_index import PlaceIndex


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
        rows = self._index.nearest(features.descriptors, candidates)
        return MapMatches.joined([self._with_keyframe(features, int(v)) for v in rows])

    def _with_keyframe(self, features: ImageFeatures, vertex: int) -> MapMatches:
        """Return the matches of the image with one keyframe of the map."""
        # Across the ray: the feature and the rotation of the keyframe; along it: the depth.
        rotation = np.sqrt(np.trace(self.pose_covariances[vertex][3:, 3:]) / 3.0)
        return match_keyframe(
            self._match,
            features,
            self._keyframes[vertex],
            vertex,
            self.poses[vertex],
            float(np.hypot(self._direction_sigma, rotation)),
        )


def _prior_covariances(graph: PoseGraph) -> FloatArray:
    """Return the covariances (n, 6, 6) of the vertices from their priors; 0 for a vertex without a prior."""
    covariances = np.zeros((len(graph.vertices.ids), 6, 6))
    rows = {int(v): i for i, v in enumerate(graph.vertices.ids)}
    edges = graph.edges
    for (a, b), information in zip(edges.ends.tolist(), edges.information_matrices, strict=True):
        if a == b:
            covariances[rows[a]] = np.linalg.inv(information)
    return covariances
