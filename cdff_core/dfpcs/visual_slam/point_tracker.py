# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of an image from the points of the newest keyframe, tracked without descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.features_tracking_2d.interface import FeaturesTracking2DInputs, FeaturesTracking2DOutputs
from cdff_core.dfpcs.visual_slam.configuration import PoseGates
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframe
from cdff_core.dfpcs.visual_slam.view import CameraView
from cdff_core.dfpcs.visual_slam.view_locator import LocatedView
from cdff_core.visual_map.camera_pose import CameraPoseSolver
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MapMatches, point_covariances

#: Largest number of tracked points, number of inliers below which descriptors are used, and least ratio of
#: inliers.
_MAX_POINTS, _MIN_INLIERS, _MIN_RATIO = 400, 60, 0.5
#: After this number of successive images that could not be tracked, only one of this many images is tried.
_MAX_FAILURES, _RETRY = 3, 8
_TrackingDfn = Dfn[Any, FeaturesTracking2DInputs, FeaturesTracking2DOutputs]


@dataclass(frozen=True, slots=True, eq=False)
class _Reference:
    key: int
    image: ByteArray
    pixels: FloatArray  # (n, 2), of all points
    rows: IntArray  # (k,), of the points that are tracked
    focal_px: float


class PointTracker:
    """Tracks the points of the newest keyframe in the following images."""

    def __init__(self, track: _TrackingDfn, solver: CameraPoseSolver, gates: PoseGates) -> None:
        self._track, self._solver, self._gates = track, solver, gates
        self.clear()

    def clear(self) -> None:
        """Remove the keyframe."""
        self._reference: _Reference | None = None
        self._failures = 0

    def start(self, key: int, view: CameraView, features: IntArray) -> None:
        """Set the keyframe: the image, and the features of its points in their order."""
        step = -(-len(features) // _MAX_POINTS) or 1
        rows = np.arange(0, len(features), step)
        pixels = view.features.pixels[features]
        self._reference = _Reference(key, view.image, pixels, rows, view.focal_px)

    def locate(
        self, view: CameraView, key: int, keyframe: VisualKeyframe, T_keyframe_camera: FloatArray
    ) -> LocatedView | None:
        """Return the pose relative to a keyframe, searched near a prediction; None if it is unusable.

        None is also returned if the keyframe is not the newest one, or the camera has changed.
        """
        reference = self._reference
        if (
            reference is None
            or reference.key != key
            or reference.image.shape != view.image.shape
            or reference.focal_px != view.focal_px
        ):
            return None
        self._failures += 1  # reset after a success
        if self._failures > _MAX_FAILURES and self._failures % _RETRY:
            return None
        points = keyframe.points.positions_m[reference.rows]
        in_camera = se3.transform_points(se3.inverse(T_keyframe_camera), points)
        guess = view.camera.project(in_camera)
        guess = np.where(np.isfinite(guess), guess, reference.pixels[reference.rows])
        tracking = self._track.process(
            FeaturesTracking2DInputs(
                reference=reference.image,
                image=view.image,
                features=reference.pixels[reference.rows],
                guess=guess,
                warps=_warps(points, in_camera),
            )
        )
        valid = np.flatnonzero(tracking.valid)
        if len(valid) < _MIN_INLIERS:
            return None
        rays = view.camera.rays(tracking.matches[valid])
        features = ImageFeatures(
            tracking.matches[valid], rays[:, :2] / rays[:, 2:], np.zeros((len(valid), 0), np.uint8)
        )
        rows = reference.rows[valid]
        matches = MapMatches(
            points[valid],
            point_covariances(
                points[valid],
                keyframe.points.depth_sigmas_m[rows],
                self._gates.sigma_px / keyframe.focal_px,
                np.eye(3),
            ),
            np.arange(len(valid)),
            np.full(len(valid), key),
            rows,
        )
        try:
            camera_pose = self._solver.solve(features, matches, view.focal_px, T_keyframe_camera, view.shape)
        except RefusedError:
            return None
        if camera_pose.inliers < _MIN_INLIERS or camera_pose.inliers < _MIN_RATIO * len(reference.rows):
            return None
        self._failures = 0
        inliers = np.flatnonzero(camera_pose.fit.inliers)
        return LocatedView(
            key,
            camera_pose.transform(self._gates.correlation),
            {key: (inliers, rows[inliers])},
            camera_pose.inliers,
            camera_pose.inliers / len(reference.rows),
            camera_pose.fit.variance_factor,
            len(reference.rows),
            camera_pose.ambiguity,
            camera_pose.extent,
        )


def _warps(points: FloatArray, in_camera: FloatArray) -> FloatArray:
    """Return the homographies (n, 3, 3) that magnify the patches of points as they come nearer."""
    warps = np.zeros((len(points), 3, 3))
    scales = np.clip(points[:, 2] / np.maximum(in_camera[:, 2], 1e-3), 0.25, 4.0)
    warps[:, 0, 0] = warps[:, 1, 1] = scales
    warps[:, 2, 2] = 1.0
    return warps
