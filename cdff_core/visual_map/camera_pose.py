# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of a camera from its matches with keyframes: search and refinement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import rotate_covariance
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.perspective_n_point_solving.interface import (
    PerspectiveNPointSolvingInputs,
    PerspectiveNPointSolvingOutputs,
)
from cdff_core.stereo_odometry.motion_hypotheses import MotionHypotheses, SelectedMotion, extent_of
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
    motion : SelectedMotion or None
        The pose among competing ones; None if these were not searched.
    extent : float
        Area of the rectangle around the features that agree with the pose, as a fraction of the image; 1 if
        its size is unknown.
    """

    fit: PoseFit
    inliers: int
    inlier_ratio: float
    motion: SelectedMotion | None = None
    extent: float = 1.0

    @property
    def ambiguity(self) -> float:
        """Plausibility of a competing pose relative to this one."""
        return 0.0 if self.motion is None else self.motion.ambiguity

    @property
    def is_foreign(self) -> BoolArray:
        """Mask (n,) of the matches that agree with a competing pose but not with this one.

        They are, for example, on a moving object.
        """
        if self.motion is None:
            return np.zeros_like(self.fit.inliers)
        return np.asarray(self.motion.other_inliers & ~self.fit.inliers)

    def transform(self, correlation: float) -> UncertainTransform:
        """Return T_map_camera with the covariance of the fit.

        ``correlation`` is the number of matches with one error, as on one object.
        """
        T = se3.inverse(self.fit.T_camera_map)
        scale = correlation * max(self.fit.variance_factor, 1.0)
        covariance = scale * rotate_covariance(self.fit.covariance, T[:3, :3])
        return UncertainTransform(
            T, covariance if self.motion is None else covariance + self.motion.selection_covariance()
        )


class CameraPoseSolver:
    """Perspective pose with outlier rejection, then weighted refinement.

    With ``motions``, the pose of the scene is selected among the poses that different parts of an image
    support: the camera's own arm, or an object that moves, can have more features than the scene.
    """

    def __init__(
        self, solve: SolvingDfn, sigma_px: float, gate: float, motions: MotionHypotheses | None = None
    ) -> None:
        self._solve, self.sigma_px, self.gate, self._motions = solve, sigma_px, gate, motions

    def solve(
        self,
        features: ImageFeatures,
        matches: MapMatches,
        focal_px: float,
        T_map_camera: FloatArray | None = None,
        shape: tuple[int, int] | None = None,
    ) -> CameraPose:
        """Return the pose of a camera of a focal length; ``T_map_camera`` is tested first if given.

        Competing poses are only searched if the ``shape`` of the image is given.

        Raises
        ------
        RefusedError
            ``few_points`` or ``unconstrained`` if the matches do not determine the pose.
        """
        directions = features.directions[matches.features]
        rows, columns = (0, 0) if shape is None else shape
        centre = np.array([0.5 * columns, 0.5 * rows])
        inputs = PerspectiveNPointSolvingInputs(
            points=matches.points_m,
            projections=focal_px * directions + centre,
            camera_matrix=np.array([[focal_px, 0.0, centre[0]], [0.0, focal_px, centre[1]], [0.0, 0.0, 1.0]]),
            guess=None if T_map_camera is None else se3.inverse(T_map_camera),
        )
        motion = None
        if self._motions is not None and shape is not None:
            motion = self._motions.select(inputs, shape, None, is_continued=False)
        fit = fit_pose(
            self._solve.process(inputs).camera if motion is None else motion.scene.pose,
            matches.points_m,
            matches.covariances,
            directions,
            self.sigma_px / focal_px,
            self.gate,
        )
        # A feature that matches several keyframes is one measurement of the image.
        inliers = len(np.unique(matches.features[fit.inliers]))
        extent = 1.0 if shape is None else extent_of(inputs.projections[fit.inliers], shape)
        return CameraPose(fit, inliers, float(fit.inliers.mean()), motion, extent)
