# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of an image relative to keyframes of the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_core.dfpcs.visual_slam.configuration import PoseGates
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframeMap
from cdff_core.visual_map.camera_pose import CameraPoseSolver, SolvingDfn
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MapMatches, MatchingDfn, match_keyframe


@dataclass(frozen=True, slots=True, eq=False)
class LocatedView:
    """Pose of an image in the frame of a keyframe.

    Attributes
    ----------
    reference : int
        Id of the keyframe.
    T_reference_camera : UncertainTransform
    shared : dict
        For each matched keyframe the rows of the features and of its points that agree with the pose.
    inliers : int
        Number of different features that agree with the pose.
    inlier_ratio, variance_factor : float
    tracked : int
        Number of points that were tracked without descriptors; 0 for matches.
    """

    reference: int
    T_reference_camera: UncertainTransform
    shared: dict[int, tuple[IntArray, IntArray]]
    inliers: int
    inlier_ratio: float
    variance_factor: float
    tracked: int = 0

    def overlap(self, points: int) -> float:
        """Return the fraction of the points of the keyframe, or of the
        tracked points, that the image shows.
        """
        return self.inliers / max(self.tracked or points, 1)

    def metrics(self) -> dict[str, float]:
        """Return the metrics of a pose."""
        return {
            "inliers": float(self.inliers),
            "inlier_ratio": self.inlier_ratio,
            "variance_factor": self.variance_factor,
            "tracked": float(self.tracked),
        }


class ViewLocator:
    """Matches images with keyframes and estimates their poses."""

    def __init__(self, match: MatchingDfn, solve: SolvingDfn, gates: PoseGates) -> None:
        self._match, self._gates = match, gates
        self._solver = CameraPoseSolver(solve, gates.sigma_px, gates.gate)

    def locate(
        self,
        features: ImageFeatures,
        focal_px: float,
        keyframes: VisualKeyframeMap,
        keys: Sequence[int],
        guess: FloatArray | None = None,
        min_inliers: int | None = None,
    ) -> LocatedView:
        """Return the pose relative to the first of several keyframes of the same component.

        Parameters
        ----------
        keys : sequence of int
            Keyframes that are matched with the image.
        guess : ndarray, shape (4, 4), optional
            First estimate of ``T_first_camera``.
        min_inliers : int, optional
            By default that of the configuration.

        Raises
        ------
        RefusedError
            With the reasons against the best pose.
        """
        T_reference = se3.inverse(keyframes.poses[keys[0]])
        matches = MapMatches.joined(
            [
                match_keyframe(
                    self._match,
                    features,
                    keyframes.keyframes[key].points,
                    key,
                    se3.normalise_transform(T_reference @ keyframes.poses[key]),
                    self._gates.sigma_px / keyframes.keyframes[key].focal_px,
                )
                for key in keys
            ]
        )
        limit = self._gates.min_inliers if min_inliers is None else min_inliers
        if len(matches) < limit:
            raise RefusedError(
                f"{len(matches)} matches, expected at least {limit}", [f"few_matches:{len(matches)}<{limit}"]
            )
        camera_pose = self._solver.solve(features, matches, focal_px, guess)
        reasons = []
        if camera_pose.inliers < limit:
            reasons.append(f"few_inliers:{camera_pose.inliers}<{limit}")
        if camera_pose.inlier_ratio < self._gates.min_inlier_ratio:
            reasons.append(f"low_inlier_ratio:{camera_pose.inlier_ratio:.2f}<{self._gates.min_inlier_ratio}")
        if reasons:
            raise RefusedError("the image does not fit the keyframes", reasons)
        inliers = camera_pose.fit.inliers
        shared = {}
        for key in np.unique(matches.vertices[inliers]).tolist():
            rows = np.flatnonzero(inliers & (matches.vertices == key))
            shared[key] = (matches.features[rows], matches.rows[rows])
        return LocatedView(
            keys[0],
            camera_pose.transform(self._gates.correlation),
            shared,
            camera_pose.inliers,
            camera_pose.inlier_ratio,
            camera_pose.fit.variance_factor,
        )
