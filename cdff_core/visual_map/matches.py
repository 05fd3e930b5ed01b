# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Matches between the features of an image and the points of keyframes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.dfns.features_matching_2d.interface import (
    FeaturesMatching2DInputs,
    FeaturesMatching2DOutputs,
)
from cdff_core.visual_map.features import ImageFeatures

MatchingDfn = Dfn[Any, FeaturesMatching2DInputs, FeaturesMatching2DOutputs]
#: Focal length with which the noise of directions to keyframes is computed, pixels: that of a camera of VGA
#: size and 70 degrees.
MAP_FOCAL_PX = 450.0


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
        Id of the keyframe.
    rows : ndarray of int, shape (n,)
        Row of the point in its keyframe.
    """

    points_m: FloatArray
    covariances: FloatArray
    features: IntArray
    vertices: IntArray
    rows: IntArray

    def __len__(self) -> int:
        return len(self.points_m)

    @classmethod
    def joined(cls, parts: Sequence[MapMatches]) -> MapMatches:
        """Return the matches with several keyframes; empty without any."""
        if not parts:
            none = np.zeros(0, np.int64)
            return cls(np.zeros((0, 3)), np.zeros((0, 3, 3)), none, none, none)
        return cls(
            np.concatenate([p.points_m for p in parts]),
            np.concatenate([p.covariances for p in parts]),
            np.concatenate([p.features for p in parts]),
            np.concatenate([p.vertices for p in parts]),
            np.concatenate([p.rows for p in parts]),
        )


def match_keyframe(
    match: MatchingDfn,
    features: ImageFeatures,
    keyframe: KeyframePoints,
    vertex: int,
    T_map_keyframe: FloatArray,
    direction_sigma: float,
) -> MapMatches:
    """Return the matches of an image with a keyframe.

    ``direction_sigma`` is the standard deviation, in radians, of the direction of a point from the position
    of the keyframe in the map; the covariance of the depth is that of the keyframe.
    """
    pairs = match.process(
        FeaturesMatching2DInputs(source=features.descriptors, sink=keyframe.descriptors)
    ).matches
    points, sigmas = keyframe.positions_m[pairs[:, 1]], keyframe.depth_sigmas_m[pairs[:, 1]]
    return MapMatches(
        se3.transform_points(T_map_keyframe, points),
        point_covariances(points, sigmas, direction_sigma, T_map_keyframe[:3, :3]),
        pairs[:, 0],
        np.full(len(pairs), vertex, np.int64),
        pairs[:, 1],
    )


def point_covariances(
    points: FloatArray, depth_sigmas: FloatArray, direction_sigma: float, R: FloatArray
) -> FloatArray:
    """Return the covariances (n, 3, 3) of points (n, 3) of a camera, rotated by ``R`` (3, 3)."""
    depths = points[:, 2]
    rays = points / depths[:, None]
    covariances = (depths * direction_sigma)[:, None, None] ** 2 * np.eye(3)
    covariances += depth_sigmas[:, None, None] ** 2 * rays[:, :, None] * rays[:, None, :]
    return np.asarray(R @ covariances @ R.T)
