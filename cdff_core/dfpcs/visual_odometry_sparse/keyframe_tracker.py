# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion from a keyframe to a view: track, reject outliers, measure disparities, refine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cdff_common.arrays import IntArray
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
from cdff_core.dfns.perspective_n_point_solving.interface import (
    PerspectiveNPointSolvingInputs,
    PerspectiveNPointSolvingOutputs,
)
from cdff_core.dfns.rectification_refinement.interface import RectificationRefinementInputs
from cdff_core.dfns.stereo_matching_2d.interface import StereoMatching2DInputs
from cdff_core.dfns.stereo_motion_estimation.interface import (
    StereoMotionEstimationInputs,
    StereoMotionEstimationOutputs,
)
from cdff_core.dfpcs.visual_odometry_sparse import quality
from cdff_core.dfpcs.visual_odometry_sparse.competing_motions import CompetingMotions
from cdff_core.dfpcs.visual_odometry_sparse.keyframe import Keyframe
from cdff_core.dfpcs.visual_odometry_sparse.tracked_points import LostPoints, TrackedPoints
from cdff_core.imaging.disparity_calibration import DisparityCalibration
from cdff_core.stereo_odometry.limits import require
from cdff_core.stereo_odometry.motion_hypotheses import MotionHypotheses, SelectedMotion
from cdff_core.stereo_odometry.motion_prior import MotionBounds
from cdff_core.stereo_odometry.stereo_view import StereoView

#: Area of lost points relative to that of the found points above which another motion is searched for.
_SEARCH_LOST_RATIO = 0.3
#: Motion, its metrics, and its deficiencies as reasons.
Located = tuple[StereoMotionEstimationOutputs, dict[str, float], list[str]]


class KeyframeTracker:
    """Locates views relative to keyframes."""

    def __init__(
        self,
        dfn: Callable[[str], Dfn[Any, Any, Any]],
        pnp: tuple[Dfn[Any, Any, Any], Dfn[Any, Any, Any]],
        calibration: DisparityCalibration,
    ) -> None:
        self._extraction, self._description = dfn("extraction"), dfn("description")
        self._matching, self._pnp = dfn("matching"), pnp[0]
        self._hypotheses, self._competing = MotionHypotheses(*pnp), CompetingMotions()
        self._prediction, self._tracking = dfn("prediction"), dfn("tracking")
        self._stereo_matching, self._refinement = dfn("stereo_matching"), dfn("refinement")
        self._motion, self._calibration = dfn("motion"), calibration

    def locate(
        self,
        view: StereoView,
        keyframe: Keyframe,
        T_current_keyframe: FloatArray,
        bounds: MotionBounds | None = None,
        *,
        is_continued: bool = False,
    ) -> Located:
        """Return the motion since a keyframe, searched near the prediction ``T_current_keyframe`` (4, 4).

        ``bounds`` is the motion by wheels or gyro since the keyframe, if measured; ``is_continued`` is true
        if the prediction continues a known velocity. Raises RefusedError if the motion cannot be estimated.
        """
        select = partial(
            self._select_motion, view, keyframe, T_current_keyframe, bounds, is_continued=is_continued
        )
        tracked = self._track(view, keyframe, T_current_keyframe)
        try:
            motion = select(tracked)
        except RefusedError:
            select = partial(
                self._select_motion, view, keyframe, T_current_keyframe, bounds, is_continued=False
            )
            tracked = self._track(
                view, keyframe, self._search(view, keyframe, np.arange(len(keyframe.points)))
            )
            motion = select(tracked)
        if not motion.others and tracked.count < 0.5 * tracked.visible:
            points_of_second_search = self._track(view, keyframe, motion.scene.pose)
            with suppress(RefusedError):
                motion_of_second_selection = select(points_of_second_search)
                if points_of_second_search.count_scene(motion_of_second_selection) > tracked.count:
                    tracked, motion = points_of_second_search, motion_of_second_selection
        elapsed_s = 1e-9 * (view.stamp_ns - keyframe.view.stamp_ns)
        continued = self._competing.predict(elapsed_s)
        competing = [other.pose for other in motion.others] or continued
        if others := competing or self._motions_of_lost_points(view, keyframe, tracked, motion):
            # The tracker finds a point only near its predicted pixel, so it runs once with each motion.
            poses = [motion.scene.pose, *others]
            merged = TrackedPoints.merged([self._track(view, keyframe, pose) for pose in poses])
            with suppress(RefusedError):
                motion_of_second_selection = select(merged, competing=continued)
                if competing or any(other.is_distinct for other in motion_of_second_selection.others):
                    tracked, motion = merged, motion_of_second_selection
        predicted_features = self._predict(view, keyframe, motion.scene.pose)
        agreeing = np.isin(np.arange(len(keyframe.points)), tracked.points[motion.scene.inliers])
        motion = self._competing.update(
            motion, keyframe.features, predicted_features.visible, agreeing, elapsed_s
        )
        inliers = tracked.first_of_each(motion.scene.inliers)
        refined_motion, disparities = self._refine(
            view, keyframe, tracked.points[inliers], tracked.matches[inliers], motion.scene.pose
        )
        refined_motion = _with_covariance(refined_motion, motion.selection_covariance())
        counts = {
            "features": len(keyframe.features),
            "visible": tracked.visible,
            "tracked": tracked.count,
            "other_motion_points": tracked.count_others(motion),
        }
        lost_points = LostPoints.of_motion(keyframe, predicted_features, tracked, motion)
        metrics = quality.motion_metrics(refined_motion, disparities, counts) | quality.hypothesis_metrics(
            motion
        )
        metrics["lost_ratio"] = lost_points.ratio(view.left.shape, only_still=True)
        return refined_motion, metrics, quality.motion_reasons(metrics)

    def _predict(
        self, view: StereoView, keyframe: Keyframe, T_current_keyframe: FloatArray
    ) -> FeaturesPrediction2DOutputs:
        """Predict position and appearance of the features of a keyframe in the current view."""
        prediction: FeaturesPrediction2DOutputs = self._prediction.process(
            FeaturesPrediction2DInputs(
                points=keyframe.points,
                pose=T_current_keyframe,
                camera_matrix=view.camera_matrix,
                baseline=view.baseline,
                image=view.left,
                slopes=keyframe.slopes,
            )
        )
        return prediction

    def _track(self, view: StereoView, keyframe: Keyframe, T_current_keyframe: FloatArray) -> TrackedPoints:
        """Return the points tracked near their predicted pixels, without those on the robot."""
        expected = self._predict(view, keyframe, T_current_keyframe)
        visible = np.flatnonzero(expected.visible & view.is_on_scene(expected.features))
        out = self._tracking.process(
            FeaturesTracking2DInputs(
                reference=keyframe.view.left,
                image=view.left,
                features=keyframe.features[visible],
                guess=expected.features[visible],
                warps=expected.warps[visible],
            )
        )
        valid = out.valid & view.is_on_scene(out.matches)
        return TrackedPoints(visible[valid], out.matches[valid], len(visible))

    def _select_motion(
        self,
        view: StereoView,
        keyframe: Keyframe,
        guess: FloatArray,
        bounds: MotionBounds | None,
        tracked: TrackedPoints,
        *,
        is_continued: bool,
        competing: Sequence[FloatArray] = (),
    ) -> SelectedMotion:
        """Return the motion of the scene, selected among the motions of the tracked points; raises
        RefusedError.
        """
        inputs = PerspectiveNPointSolvingInputs(
            points=keyframe.points[tracked.points],
            projections=tracked.matches,
            camera_matrix=view.camera_matrix,
            guess=guess,
        )
        rows, columns = view.left.shape
        return self._hypotheses.select(
            inputs, (rows, columns), bounds, is_continued=is_continued, competing=competing
        )

    def _motions_of_lost_points(
        self, view: StereoView, keyframe: Keyframe, tracked: TrackedPoints, motion: SelectedMotion
    ) -> list[FloatArray]:
        """Return the motion (4, 4), or none, of the points that the motion of the scene does not find.

        In a static scene, lost points are scattered; those of a whole region moved differently.
        """
        predicted_features = self._predict(view, keyframe, motion.scene.pose)
        lost_points = LostPoints.of_motion(keyframe, predicted_features, tracked, motion)
        is_still_lost = lost_points.ratio(view.left.shape, only_still=True) > quality.MAX_LOST_RATIO
        if not is_still_lost and lost_points.ratio(view.left.shape) <= _SEARCH_LOST_RATIO:
            return []
        try:
            return [
                self._search(
                    view, keyframe, np.flatnonzero(lost_points.is_lost & view.is_on_scene(lost_points.pixels))
                )
            ]
        except RefusedError:
            return []

    def _search(self, view: StereoView, keyframe: Keyframe, points: IntArray) -> FloatArray:
        """Return ``T_current_keyframe`` of some points of a keyframe by descriptors, without a prediction."""
        detected = self._extraction.process(
            FeaturesExtraction2DInputs(image=view.left, mask=view.left_mask)
        ).features
        reference = self._description.process(
            FeaturesDescription2DInputs(image=keyframe.view.left, features=keyframe.features[points])
        )
        current = self._description.process(FeaturesDescription2DInputs(image=view.left, features=detected))
        candidates, corners = points[reference.valid], detected[current.valid]
        pairs = self._matching.process(
            FeaturesMatching2DInputs(
                source=reference.descriptors[reference.valid], sink=current.descriptors[current.valid]
            )
        ).matches
        solution: PerspectiveNPointSolvingOutputs = self._pnp.process(
            PerspectiveNPointSolvingInputs(
                points=keyframe.points[candidates[pairs[:, 0]]],
                projections=corners[pairs[:, 1]],
                camera_matrix=view.camera_matrix,
            )
        )
        return solution.camera

    def _refine(
        self,
        view: StereoView,
        keyframe: Keyframe,
        candidates: IntArray,
        matches: FloatArray,
        T_current_keyframe: FloatArray,
    ) -> tuple[StereoMotionEstimationOutputs, FloatArray]:
        """Measure disparities around their prediction, then refine motion, covariance and calibration.

        Return the result, and the disparities (k,) of its points in the keyframe.
        """
        predicted_features = self._predict(view, keyframe, T_current_keyframe)
        expected = predicted_features.disparities[candidates]
        field = self._refinement.process(
            RectificationRefinementInputs(
                features=matches, disparities=expected, camera_matrix=view.camera_matrix
            )
        )
        offsets = field.corrections + field.basis @ self._calibration.mean_px
        stereo_matches = self._stereo_matching.process(
            StereoMatching2DInputs(
                left=view.left,
                right=view.right,
                features=matches,
                guess=expected - offsets,
                slopes=predicted_features.slopes[candidates],
            )
        )
        valid = stereo_matches.valid & view.is_on_scene(matches, stereo_matches.disparities)
        min_matched = max(quality.MIN_INLIERS, int(quality.MIN_PAIRING_FRACTION * len(candidates)))
        require(int(valid.sum()), min_matched, "stereo_mismatch")
        points = candidates[valid]
        refined_motion = self._motion.process(
            StereoMotionEstimationInputs(
                reference=np.column_stack([keyframe.features[points], keyframe.disparities[points]]),
                current=np.column_stack(
                    [matches[valid], stereo_matches.disparities[valid] + field.corrections[valid]]
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
        return refined_motion, keyframe.disparities[points]


def _with_covariance(
    motion: StereoMotionEstimationOutputs, added_covariance: FloatArray
) -> StereoMotionEstimationOutputs:
    """Return a motion with an additional covariance (6, 6), [x y z rx ry rz]."""
    return replace(
        motion,
        covariance=motion.covariance + added_covariance,
        noise_covariance=motion.noise_covariance + added_covariance,
    )
