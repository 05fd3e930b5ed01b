# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction of a predicted state by the motion of the texture of a body since the previous image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, ByteArray, FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_tracking_2d.interface import FeaturesTracking2DInputs
from cdff_core.dfns.measured_pose_refinement.interface import MeasuredPoseRefinementInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.image_fit import search_range_px
from cdff_core.object_models.measured_correction import PointOffsets, require_count
from cdff_core.object_models.rendering import Window, body_window, render
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState

#: Least distance of a feature from the outline of the body, and margin of the image windows around the
#: features, px.
_INSIDE_PX, _MARGIN_PX = 4, 48
#: Least number of tracked points.
_MIN_POINTS = 12
#: Smallest side of an image window in which features are searched, px.
_MIN_SIDE_PX = 33


@dataclass(frozen=True, slots=True, eq=False)
class SeenBody:
    """A grey image (r, c) with the state of the body in it."""

    image: ByteArray
    state: TrackedState


@dataclass(frozen=True, slots=True, eq=False)
class TextureFit:
    """A corrected state, the fraction of the tracked points that agree with it, and their number."""

    state: TrackedState
    agreement: float
    points: int


class TextureFitter:
    """Fit of a state to points of the surface that are tracked from the previous image.

    The points are where the previous pose puts them, so that they measure the motion since then, not the
    pose: the error of the previous pose is part of the state, with its correlation (stochastic cloning,
    Roumeliotis and Burdick 2002, doi:10.1109/ROBOT.2002.1014801).

    Parameters
    ----------
    detect, track, refine : Dfn
        FeaturesExtraction2D, FeaturesTracking2D and MeasuredPoseRefinement.
    max_range_px : float
        Largest distance of a tracked point from its prediction.
    """

    def __init__(
        self,
        detect: Dfn[Any, Any, Any],
        track: Dfn[Any, Any, Any],
        refine: Dfn[Any, Any, Any],
        max_range_px: float,
    ) -> None:
        self._detect, self._track, self._refine = detect, track, refine
        self._max_range_px = max_range_px

    def fit(
        self,
        model: ModelPreparationOutputs,
        seen_body: SeenBody,
        predicted: TrackedState,
        transition: FloatArray,
        image: ByteArray,
        camera_matrix: FloatArray,
    ) -> TextureFit:
        """Return the state corrected with a grey image (r, c), which is later than that of ``seen_body``.

        Parameters
        ----------
        transition : ndarray, shape (20, 20)
            Derivative of the errors of the predicted state with respect to those of the previous one.

        Raises
        ------
        RefusedError
            ``few_features:n`` or ``behind_camera``.
        """
        features, points_m = self._features(model, seen_body, camera_matrix)
        camera = _window(camera_matrix, image)
        in_camera = se3.transform_points(predicted.T, points_m)
        is_ahead = in_camera[:, 2] > 1e-3 * max(float(in_camera[:, 2].max(initial=0.0)), 1e-9)
        features, points_m, in_camera = features[is_ahead], points_m[is_ahead], in_camera[is_ahead]
        pixels = in_camera[:, :2] / in_camera[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        matches, is_valid = self._track_features(seen_body.image, image, features, pixels)
        count = int(np.count_nonzero(is_valid))
        tracked = f"{count} of {len(features)} features of the body were tracked"
        require_count(count, _MIN_POINTS, tracked, "few_features")
        point_offsets = PointOffsets.of_matches(points_m[is_valid], pixels[is_valid], matches[is_valid])
        prior = relative_prior(seen_body.state, predicted, transition)
        outputs = self._refine.process(
            MeasuredPoseRefinementInputs(
                points=point_offsets.points,
                pixels=point_offsets.pixels,
                normals=point_offsets.normals,
                offsets=point_offsets.offsets,
                camera_matrix=camera_matrix,
                pose=predicted.T,
                limit_px=search_range_px(
                    model, predicted.T, prior[:6, :6], camera_matrix, self._max_range_px
                ),
                prior_covariance=prior,
            )
        )
        state = predicted.corrected(outputs.correction[6:], outputs.covariance[6:, 6:])
        return TextureFit(state, outputs.agreement, int(np.count_nonzero(is_valid)))

    def _features(
        self, model: ModelPreparationOutputs, seen_body: SeenBody, camera_matrix: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return features (n, 2) of the body in the previous image, and their points (n, 3) in the frame of
        the body.
        """
        row, column, window = body_window(
            model.drawn_vertices, seen_body.state.T, _window(camera_matrix, seen_body.image)
        )
        if min(window.rows, window.columns) < _MIN_SIDE_PX:
            return np.zeros((0, 2)), np.zeros((0, 3))
        depth_m = render(model.drawn_vertices, model.drawn_triangles, seen_body.state.T, window).depth_m
        part_of_image = seen_body.image[row : row + window.rows, column : column + window.columns]
        detection = self._detect.process(
            FeaturesExtraction2DInputs(
                image=np.ascontiguousarray(part_of_image), mask=inner_pixels(np.isfinite(depth_m))
            )
        )
        u, v = np.rint(detection.features).astype(np.int64).T
        z = depth_m[v, u]
        x, y = (detection.features - [window.cx, window.cy]).T
        in_camera = np.stack([x / window.fx * z, y / window.fy * z, z], axis=1)
        return detection.features + np.array([column, row]), se3.transform_points(
            se3.inverse(seen_body.state.T), in_camera
        )

    def _track_features(
        self, previous: ByteArray, image: ByteArray, features: FloatArray, pixels: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Track features of the previous image; return their positions (n, 2), and which are valid (n,).

        ``pixels`` (n, 2) are the predicted positions.
        """
        if not len(features) or previous.shape != image.shape:
            return pixels, np.zeros(len(features), bool)
        all_pixels = np.concatenate([features, pixels])
        limit = np.array(image.shape[::-1])
        low = np.clip(np.floor(all_pixels.min(axis=0)) - _MARGIN_PX, 0, limit - _MIN_SIDE_PX).astype(int)
        high = np.clip(np.ceil(all_pixels.max(axis=0)) + _MARGIN_PX, low + _MIN_SIDE_PX, limit).astype(int)
        part = np.s_[low[1] : high[1], low[0] : high[0]]
        outputs = self._track.process(
            FeaturesTracking2DInputs(
                reference=np.ascontiguousarray(previous[part]),
                image=np.ascontiguousarray(image[part]),
                features=features - low,
                guess=pixels - low,
            )
        )
        return outputs.matches + low, np.asarray(outputs.valid)


def relative_prior(previous: TrackedState, predicted: TrackedState, transition: FloatArray) -> FloatArray:
    """Return the joint covariance (26, 26) of two errors.

    The first six components are the error of the motion since the previous pose: the error of the predicted
    pose minus the error of the previous pose, rotated with the body. The other 20 are the error of the
    predicted state. ``transition`` (20, 20) is the derivative of the predicted state's errors with respect
    to the previous ones.
    """
    R = predicted.T[:3, :3] @ previous.T[:3, :3].T
    joint = np.zeros((STATE_ERROR_DIM + 6, STATE_ERROR_DIM + 6))
    joint[:STATE_ERROR_DIM, :STATE_ERROR_DIM] = predicted.covariance
    joint[:STATE_ERROR_DIM, STATE_ERROR_DIM:] = transition @ previous.covariance[:, :6]
    joint[STATE_ERROR_DIM:, :STATE_ERROR_DIM] = joint[:STATE_ERROR_DIM, STATE_ERROR_DIM:].T
    joint[STATE_ERROR_DIM:, STATE_ERROR_DIM:] = previous.covariance[:6, :6]
    jacobian = np.zeros((6 + STATE_ERROR_DIM, STATE_ERROR_DIM + 6))
    jacobian[:6, :6] = np.eye(6)
    jacobian[:6, STATE_ERROR_DIM:] = -np.kron(np.eye(2), R)
    jacobian[6:, :STATE_ERROR_DIM] = np.eye(STATE_ERROR_DIM)
    return np.asarray(jacobian @ joint @ jacobian.T)


def _window(camera_matrix: FloatArray, image: ByteArray) -> Window:
    K = camera_matrix
    return Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *image.shape)


def inner_pixels(mask: BoolArray) -> BoolArray:
    """Return the pixels of a mask that are farther than ``_INSIDE_PX`` from its outline."""
    import cv2

    side = 2 * _INSIDE_PX + 1
    eroded = cv2.erode(
        mask.astype(np.uint8), np.ones((side, side), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=1
    )
    return np.asarray(eroded, bool)
