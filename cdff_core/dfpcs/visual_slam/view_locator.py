# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of an image relative to keyframes of the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_core.dfpcs.visual_slam.configuration import PoseGates
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframeMap
from cdff_core.stereo_odometry.motion_hypotheses import MAX_AMBIGUITY
from cdff_core.visual_map.camera_pose import CameraPoseSolver
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MapMatches, MatchingDfn, match_keyframe

#: Fraction of the image below which an object, of which no competing pose is known, can be all that agrees
#: with the pose: that of the smaller of two motions whose selection is just certain.
_MIN_EXTENT = MAX_AMBIGUITY / (1.0 + MAX_AMBIGUITY)


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
    ambiguity : float
        Plausibility of a competing pose relative to this one.
    extent : float
        Area of the rectangle around the features that agree with the pose, as a fraction of the image.
    foreign : ndarray of int, shape (k,)
        Rows of the features that agree with a competing pose only; empty for tracked points.
    """

    reference: int
    T_reference_camera: UncertainTransform
    shared: dict[int, tuple[IntArray, IntArray]]
    inliers: int
    inlier_ratio: float
    variance_factor: float
    tracked: int = 0
    ambiguity: float = 0.0
    extent: float = 1.0
    foreign: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

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
            "ambiguity": self.ambiguity,
            "extent": self.extent,
        }

    def reasons(self) -> list[str]:
        """Return the reasons against the pose: it may be that of an object, or of the robot's own arm."""
        reasons = {
            f"competing_motion:{self.ambiguity:.2f}>{MAX_AMBIGUITY:.2f}": self.ambiguity > MAX_AMBIGUITY,
            f"small_extent:{self.extent:.2f}<{_MIN_EXTENT:.2f}": self.extent < _MIN_EXTENT,
        }
        return [reason for reason, applies in reasons.items() if applies]


class ViewLocator:
    """Matches images with keyframes and estimates their poses."""

    def __init__(self, match: MatchingDfn, solver: CameraPoseSolver, gates: PoseGates) -> None:
        self._match, self._solver, self._gates = match, solver, gates

    def locate(
        self,
        features: ImageFeatures,
        focal_px: float,
        keyframes: VisualKeyframeMap,
        keys: Sequence[int],
        guess: FloatArray | None = None,
        min_inliers: int | None = None,
        shape: tuple[int, int] | None = None,
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
        shape : tuple of int, optional
            Rows and columns of the image: poses that compete are then searched.

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
        camera_pose = self._solver.solve(features, matches, focal_px, guess, shape)
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
            ambiguity=camera_pose.ambiguity,
            extent=camera_pose.extent,
            foreign=np.unique(matches.features[camera_pose.is_foreign]),
        )
