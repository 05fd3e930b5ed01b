# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of a camera from its matches with keyframes: search and refinement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import rotate_covariance
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.perspective_n_point_solving.interface import (
    PerspectiveNPointSolvingInputs,
    PerspectiveNPointSolvingOutputs,
)
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MapMatches
from cdff_core.visual_map.pose_fit import PoseFit, fit_pose

SolvingDfn = Dfn[Any, PerspectiveNPointSolvingInputs, PerspectiveNPointSolvingOutputs]


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Pose of a camera in the map.

    Attributes
    ----------
    fit : PoseFit
    inliers : int
        Number of different features whose match agrees with the pose.
    inlier_ratio : float
        Ratio of the matches that agree with the pose.
    """

    fit: PoseFit
    inliers: int
    inlier_ratio: float

    def transform(self, correlation: float) -> UncertainTransform:
        """Return T_map_camera with the covariance of the fit.

        ``correlation`` is the number of matches with one error, as on one object.
        """
        T = se3.inverse(self.fit.T_camera_map)
        scale = correlation * max(self.fit.variance_factor, 1.0)
        return UncertainTransform(T, scale * rotate_covariance(self.fit.covariance, T[:3, :3]))


class CameraPoseSolver:
    """Perspective pose with outlier rejection, then weighted refinement."""

    def __init__(self, solve: SolvingDfn, sigma_px: float, gate: float) -> None:
        self._solve, self.sigma_px, self.gate = solve, sigma_px, gate

    def solve(
        self,
        features: ImageFeatures,
        matches: MapMatches,
        focal_px: float,
        T_map_camera: FloatArray | None = None,
    ) -> CameraPose:
        """Return the pose of a camera of a focal length; ``T_map_camera`` is tested first if given.

        Raises
        ------
        RefusedError
            ``few_points`` or ``unconstrained`` if the matches do not determine the pose.
        """
        directions = features.directions[matches.features]
        start = self._solve.process(
            PerspectiveNPointSolvingInputs(
                points=matches.points_m,
                projections=focal_px * directions,
                camera_matrix=np.diag([focal_px, focal_px, 1.0]),
                guess=None if T_map_camera is None else se3.inverse(T_map_camera),
            )
        )
        fit = fit_pose(
            start.camera,
            matches.points_m,
            matches.covariances,
            directions,
            self.sigma_px / focal_px,
            self.gate,
        )
        # A feature that matches several keyframes is one measurement of the image.
        inliers = len(np.unique(matches.features[fit.inliers]))
        return CameraPose(fit, inliers, float(fit.inliers.mean()))
