# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction of a predicted state by a rendering of the body in the light of the Sun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_tracking_2d.interface import FeaturesTracking2DInputs
from cdff_core.dfns.lit_body_rendering.interface import LitBodyRenderingInputs, LitBodyRenderingOutputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.image_fit import search_range_px
from cdff_core.object_models.measured_correction import PointOffsets, corrected_state, require_count
from cdff_core.object_models.texture_fit import inner_pixels
from cdff_core.object_models.tracked_state import TrackedState

#: Renderings of an image, least number of tracked points, and of lit pixels.
_ROUNDS, _MIN_POINTS, _MIN_LIT = 3, 12, 200
#: Smallest part of an image in which features are searched, px.
_MIN_SIDE_PX = 33


@dataclass(frozen=True, slots=True, eq=False)
class ShadingFit:
    """A corrected state and how well the image agrees with its rendering.

    Attributes
    ----------
    state : TrackedState
    distance : float
        Squared Mahalanobis distance of the correction from the prediction.
    agreement : float
        Fraction of the tracked points that agree with the state.
    points : int
    correlation : float
        Of the image with the last rendering, on the body.
    """

    state: TrackedState
    distance: float
    agreement: float
    points: int
    correlation: float


class ShadingFitter:
    """Fit of a state to an image by points that are tracked from a rendering to the image.

    Parameters
    ----------
    render, detect, track, refine : Dfn
        LitBodyRendering, FeaturesExtraction2D, FeaturesTracking2D and MeasuredPoseRefinement.
    max_range_px : float
        Largest distance of a tracked point from its prediction.
    """

    def __init__(
        self,
        render: Dfn[Any, Any, Any],
        detect: Dfn[Any, Any, Any],
        track: Dfn[Any, Any, Any],
        refine: Dfn[Any, Any, Any],
        max_range_px: float,
    ) -> None:
        self._render, self._detect, self._track, self._refine = render, detect, track, refine
        self._max_range_px = max_range_px

    def fit(
        self,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        image: ByteArray,
        camera_matrix: FloatArray,
        sun: FloatArray,
    ) -> ShadingFit:
        """Return the state corrected by the light and the shadows in a grey image.

        Parameters
        ----------
        model, predicted, camera_matrix
            As in ``ImageFitter.fit``.
        image : ndarray of uint8, shape (r, c)
            Grey levels, without lens distortion.
        sun : ndarray, shape (3,)
            Vector to the Sun in the frame of the camera, of any length above 0.

        Raises
        ------
        RefusedError
            ``dark:n<m`` or ``few_features:n<m``, with the number of lit pixels or of tracked points, or
            ``behind_camera``.
        """
        state = predicted
        for _ in range(_ROUNDS):
            rendered = self._rendered(model, state, image, camera_matrix, sun)
            features, points_m = self._features(rendered, state.T, camera_matrix)
            matches, is_valid = self._matches(rendered.rendering, image, features)
            count = int(np.count_nonzero(is_valid))
            found = f"{count} of {len(features)} points were tracked from the rendering to the image"
            require_count(count, _MIN_POINTS, found, "few_features")
            point_offsets = PointOffsets.of_matches(points_m[is_valid], features[is_valid], matches[is_valid])
            limit_px = search_range_px(
                model, state.T, state.covariance[:6, :6], camera_matrix, self._max_range_px
            )
            state, outputs = corrected_state(
                self._refine, state, predicted, point_offsets, camera_matrix, limit_px
            )
        correlation = self._rendered(model, state, image, camera_matrix, sun).correlation
        distance = state.squared_distance(predicted)
        return ShadingFit(state, distance, outputs.agreement, count, correlation)

    def _rendered(
        self,
        model: ModelPreparationOutputs,
        state: TrackedState,
        image: ByteArray,
        camera_matrix: FloatArray,
        sun: FloatArray,
    ) -> LitBodyRenderingOutputs:
        """Return the rendering at a state; raises RefusedError if the body is dark or out of view."""
        rendered: LitBodyRenderingOutputs = self._render.process(
            LitBodyRenderingInputs(
                image=image,
                camera_matrix=camera_matrix,
                pose=state.T,
                vertices=model.drawn_vertices,
                triangles=model.drawn_triangles,
                sun=sun,
            )
        )
        lit = f"{rendered.lit_pixels} pixels of the body are in the light of the Sun"
        require_count(rendered.lit_pixels, _MIN_LIT, lit, "dark")
        return rendered

    def _features(
        self, rendered: LitBodyRenderingOutputs, T_camera_model: FloatArray, camera_matrix: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return features (n, 2) of the rendering and their points (n, 3) in the frame of the model."""
        is_body = np.isfinite(rendered.depth)
        # The detector distributes the features over its image: only the part with the body.
        rows, columns = (np.flatnonzero(is_body.any(axis=axis)) for axis in (1, 0))
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        if min(rendered.rendering[part].shape) < _MIN_SIDE_PX:
            return np.zeros((0, 2)), np.zeros((0, 3))
        features = self._detect.process(
            FeaturesExtraction2DInputs(
                image=np.ascontiguousarray(rendered.rendering[part]), mask=inner_pixels(is_body[part])
            )
        ).features
        features = features + np.array([columns[0], rows[0]])
        u, v = np.rint(features).astype(np.int64).T
        z = rendered.depth[v, u]
        K = camera_matrix
        x, y = (features - [K[0, 2], K[1, 2]]).T
        in_camera = np.stack([x / K[0, 0] * z, y / K[1, 1] * z, z], axis=1)
        return features, se3.transform_points(se3.inverse(T_camera_model), in_camera)

    def _matches(
        self, rendering: ByteArray, image: ByteArray, features: FloatArray
    ) -> tuple[FloatArray, np.ndarray]:
        """Return the positions (n, 2) of features in the image, and their mask (n,)."""
        if not len(features):
            return features, np.zeros(0, bool)
        outputs = self._track.process(
            FeaturesTracking2DInputs(reference=rendering, image=image, features=features, guess=features)
        )
        return outputs.matches, np.asarray(outputs.valid)
