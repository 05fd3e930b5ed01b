# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loop closures between visual maps: the points of one keyframe are located among those of another."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.interfaces.registry import Registry
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.map_merging.loop_closure import InterRobotCloser
from cdff_core.visual_map.camera_pose import CameraPose, CameraPoseSolver
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MAP_FOCAL_PX, match_keyframe

#: Largest angle between the optical axes of compared keyframes.
_MAX_ANGLE_RAD = np.radians(60.0)
#: Gates of a closure, as those of a loop of visual_slam: the focal length is that of all visual maps.
_SIGMA_PX, _GATE, _CORRELATION = 0.7, 4.2, 4.0
_MIN_INLIERS, _MIN_INLIER_RATIO = 30, 0.12


class VisualCloser(InterRobotCloser[KeyframePoints]):
    """Matches the descriptors of two keyframes and estimates their relative pose (P3P, RANSAC, refinement).

    The relative pose is estimated in both directions; a difference of more than the gate is refused.
    """

    def __init__(self, config: MergingConfig) -> None:
        super().__init__(config)
        registry = Registry.default()
        self._match = registry.make_dfn("FeaturesMatching2D", "MutualRatio")
        self._match.configure({})
        solve = registry.make_dfn("PerspectiveNPointSolving", "P3pRansac")
        solve.configure({"threshold_px": 6.0, "max_iterations": 500})
        self._solver = CameraPoseSolver(solve, _SIGMA_PX, _GATE)

    def is_comparable(self, T_site_first: FloatArray, T_site_second: FloatArray) -> bool:
        """Return whether the optical axes of two keyframes have similar directions."""
        cosine = float(T_site_first[:3, 2] @ T_site_second[:3, 2])
        return cosine > float(np.cos(_MAX_ANGLE_RAD))

    def relative_pose(self, first: KeyframePoints, second: KeyframePoints) -> UncertainTransform | None:
        """Return ``T_first_second``; None if too few points agree, or the two directions differ."""
        try:
            T_first_second, T_second_first = self._locate(second, first), self._locate(first, second)
        except RefusedError as error:
            self.refusals[next(iter(error.reasons), "not_located").split(":")[0]] += 1
            return None
        difference = (T_first_second @ T_second_first).matrix
        covariance = (T_first_second @ T_second_first).covariance
        assert covariance is not None  # of the fits
        if np.abs(difference[:3, 3]).max() > _GATE * np.sqrt(np.diag(covariance)[:3].max()):
            self.refusals["contradictory"] += 1
            return None
        return T_first_second

    def _locate(self, view: KeyframePoints, keyframe: KeyframePoints) -> UncertainTransform:
        """Return ``T_keyframe_view`` from the directions of the points of ``view``; raises RefusedError."""
        directions = view.positions_m[:, :2] / view.positions_m[:, 2:]
        features = ImageFeatures(MAP_FOCAL_PX * directions, directions, view.descriptors)
        matches = match_keyframe(self._match, features, keyframe, 0, np.eye(4), _SIGMA_PX / MAP_FOCAL_PX)
        if len(matches) < _MIN_INLIERS:
            raise RefusedError("too few matches", [f"few_matches:{len(matches)}<{_MIN_INLIERS}"])
        pose: CameraPose = self._solver.solve(features, matches, MAP_FOCAL_PX)
        if pose.inliers < _MIN_INLIERS or pose.inlier_ratio < _MIN_INLIER_RATIO:
            raise RefusedError("too few points agree", [f"few_inliers:{pose.inliers}<{_MIN_INLIERS}"])
        return pose.transform(_CORRELATION)
