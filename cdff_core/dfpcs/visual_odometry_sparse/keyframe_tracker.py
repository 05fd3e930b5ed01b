# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion from a keyframe to a view: track, reject outliers, measure disparities, refine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.features_description_2d.interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d.interface import FeaturesMatching2DInputs
from cdff_core.dfns.features_prediction_2d.interface import (
    FeaturesPrediction2DInputs,
    FeaturesPrediction2DOutputs,
)
from cdff_core.dfns.features_tracking_2d.interface import FeaturesTracking2DInputs
from cdff_core.dfns.perspective_n_point_solving.interface import PerspectiveNPointSolvingInputs
from cdff_core.dfns.rectification_refinement.interface import RectificationRefinementInputs
from cdff_core.dfns.stereo_matching_2d.interface import StereoMatching2DInputs
from cdff_core.dfns.stereo_motion_estimation.interface import (
    StereoMotionEstimationInputs,
    StereoMotionEstimationOutputs,
)
from cdff_core.dfpcs.visual_odometry_sparse import quality
from cdff_core.dfpcs.visual_odometry_sparse.calibration import DisparityCalibration
from cdff_core.dfpcs.visual_odometry_sparse.keyframe import Keyframe
from cdff_core.dfpcs.visual_odometry_sparse.stereo_view import StereoView

#: Motion, its metrics, and its deficiencies as reasons.
Located = tuple[StereoMotionEstimationOutputs, dict[str, float], list[str]]
Indices = NDArray[np.int64]


class KeyframeTracker:
    """Locates views relative to keyframes."""

    def __init__(self, dfn: Callable[[str], Dfn[Any, Any, Any]], calibration: DisparityCalibration) -> None:
        self._extraction, self._description = dfn("extraction"), dfn("description")
        self._matching, self._pnp = dfn("matching"), dfn("pnp")
        self._prediction, self._tracking = dfn("prediction"), dfn("tracking")
        self._stereo_matching, self._refinement = dfn("stereo_matching"), dfn("refinement")
        self._motion, self._calibration = dfn("motion"), calibration

    def set_seed(self, seed: int) -> None:
        """Set the seed of the outlier rejection."""
        self._pnp.configure(self._pnp.config.model_copy(update={"seed": seed}))

    def locate(self, view: StereoView, keyframe: Keyframe, T_current_keyframe: FloatArray) -> Located:
        """Return the motion since a keyframe, searched near the prediction ``T_current_keyframe`` (4, 4).

        Raises RefusedError if it cannot be estimated.
        """
        tracked, matches, visible = self._track(view, keyframe, T_current_keyframe)
        try:
            T_current_keyframe, inliers = self._solve_pose(
                view, keyframe, tracked, matches, T_current_keyframe
            )
        except RefusedError:
            T_current_keyframe = self._search(view, keyframe)
            tracked, matches, visible = self._track(view, keyframe, T_current_keyframe)
            T_current_keyframe, inliers = self._solve_pose(
                view, keyframe, tracked, matches, T_current_keyframe
            )
        if len(tracked) < 0.5 * visible:
            retracked, retracked_matches, _ = self._track(view, keyframe, T_current_keyframe)
            if len(retracked) > len(tracked):
                tracked, matches = retracked, retracked_matches
                T_current_keyframe, inliers = self._solve_pose(
                    view, keyframe, tracked, matches, T_current_keyframe
                )
        refined, disparities = self._refine(
            view, keyframe, tracked[inliers], matches[inliers], T_current_keyframe
        )
        counts = {"features": len(keyframe.features), "visible": visible, "tracked": len(tracked)}
        metrics = quality.motion_metrics(refined, disparities, counts)
        return refined, metrics, quality.motion_reasons(metrics)

    def _predict(
        self, view: StereoView, keyframe: Keyframe, T_current_keyframe: FloatArray
    ) -> FeaturesPrediction2DOutputs:
        out: FeaturesPrediction2DOutputs = self._prediction.process(
            FeaturesPrediction2DInputs(
                points=keyframe.points,
                pose=T_current_keyframe,
                camera_matrix=view.camera_matrix,
                baseline=view.baseline,
                image=view.left,
                slopes=keyframe.slopes,
            )
        )
        return out

    def _track(
        self, view: StereoView, keyframe: Keyframe, T_current_keyframe: FloatArray
    ) -> tuple[Indices, FloatArray, int]:
        """Return indices and pixels of the tracked points, and the number of points in view."""
        expected = self._predict(view, keyframe, T_current_keyframe)
        visible = np.flatnonzero(expected.visible)
        out = self._tracking.process(
            FeaturesTracking2DInputs(
                reference=keyframe.view.left,
                image=view.left,
                features=keyframe.features[visible],
                guess=expected.features[visible],
                warps=expected.warps[visible],
            )
        )
        return visible[out.valid], out.matches[out.valid], len(visible)

    def _solve_pose(
        self,
        view: StereoView,
        keyframe: Keyframe,
        tracked: Indices,
        matches: FloatArray,
        guess: FloatArray | None,
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return ``T_current_keyframe`` and the mask of the tracked points that agree with it."""
        out = self._pnp.process(
            PerspectiveNPointSolvingInputs(
                points=keyframe.points[tracked],
                projections=matches,
                camera_matrix=view.camera_matrix,
                guess=guess,
            )
        )
        return out.camera, out.inliers

    def _search(self, view: StereoView, keyframe: Keyframe) -> FloatArray:
        """Return ``T_current_keyframe`` by descriptors, without a prediction."""
        detected = self._extraction.process(FeaturesExtraction2DInputs(image=view.left)).features
        reference = self._description.process(
            FeaturesDescription2DInputs(image=keyframe.view.left, features=keyframe.features)
        )
        current = self._description.process(FeaturesDescription2DInputs(image=view.left, features=detected))
        candidates, corners = np.flatnonzero(reference.valid), detected[current.valid]
        pairs = self._matching.process(
            FeaturesMatching2DInputs(
                source=reference.descriptors[candidates], sink=current.descriptors[current.valid]
            )
        ).matches
        return self._solve_pose(view, keyframe, candidates[pairs[:, 0]], corners[pairs[:, 1]], None)[0]

    def _refine(
        self,
        view: StereoView,
        keyframe: Keyframe,
        candidates: Indices,
        matches: FloatArray,
        T_current_keyframe: FloatArray,
    ) -> tuple[StereoMotionEstimationOutputs, FloatArray]:
        """Measure disparities around their prediction, then refine motion, covariance and calibration.

        Return the result, and the disparities (k,) of its points in the keyframe.
        """
        predicted = self._predict(view, keyframe, T_current_keyframe)
        expected = predicted.disparities[candidates]
        field = self._refinement.process(
            RectificationRefinementInputs(
                features=matches, disparities=expected, camera_matrix=view.camera_matrix
            )
        )
        offsets = field.corrections + field.basis @ self._calibration.mean_px
        matched = self._stereo_matching.process(
            StereoMatching2DInputs(
                left=view.left,
                right=view.right,
                features=matches,
                guess=expected - offsets,
                slopes=predicted.slopes[candidates],
            )
        )
        valid = matched.valid
        min_matched = max(quality.MIN_INLIERS, int(quality.MIN_PAIRING_FRACTION * len(candidates)))
        quality.require(int(valid.sum()), min_matched, "stereo_mismatch")
        points = candidates[valid]
        refined = self._motion.process(
            StereoMotionEstimationInputs(
                reference=np.column_stack([keyframe.features[points], keyframe.disparities[points]]),
                current=np.column_stack(
                    [matches[valid], matched.disparities[valid] + field.corrections[valid]]
                ),
                camera_matrix=view.camera_matrix,
                baseline=view.baseline,
                guess=se3.inverse(T_current_keyframe),
                reference_basis=keyframe.basis[points],
                current_basis=field.basis[valid],
                calibration=self._calibration.mean_px,
                calibration_covariance=self._calibration.covariance_px2,
            )
        )
        return refined, keyframe.disparities[points]
