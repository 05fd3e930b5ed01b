# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion from a keyframe to a view: track, reject outliers, measure disparities, refine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import BoolArray
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
from cdff_core.dfpcs.visual_odometry_sparse.calibration import DisparityCalibration
from cdff_core.dfpcs.visual_odometry_sparse.keyframe import Keyframe
from cdff_core.dfpcs.visual_odometry_sparse.motion_hypotheses import MotionHypotheses, SelectedMotion
from cdff_core.dfpcs.visual_odometry_sparse.motion_prior import MotionBounds
from cdff_core.dfpcs.visual_odometry_sparse.stereo_view import StereoView

#: Motion, its metrics, and its deficiencies as reasons.
Located = tuple[StereoMotionEstimationOutputs, dict[str, float], list[str]]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPoints:
    """Points of a keyframe that were tracked to an image; a point can have several positions."""

    points: Indices  # (n,), rows of the keyframe
    matches: FloatArray  # (n, 2), columns and rows in the image, pixels
    visible: int  # number of points predicted inside the image

    @classmethod
    def merged(cls, parts: Sequence[TrackedPoints]) -> TrackedPoints:
        """Return the union of several results; positions of a point that agree to 0.5 px are merged."""
        points = np.concatenate([part.points for part in parts])
        matches = np.concatenate([part.matches for part in parts])
        rows = np.column_stack([points, np.rint(2.0 * matches)])
        first = np.sort(np.unique(rows, axis=0, return_index=True)[1])
        return cls(points[first], matches[first], max(part.visible for part in parts))

    def first_of_each(self, selected: BoolArray) -> Indices:
        """Return the rows (k,) of a mask (n,), for each point of the keyframe only its first one."""
        rows = np.flatnonzero(selected)
        return rows[np.sort(np.unique(self.points[rows], return_index=True)[1])]

    @property
    def count(self) -> int:
        """Number of points of the keyframe that were tracked."""
        return len(np.unique(self.points))

    def count_others(self, motion: SelectedMotion) -> int:
        """Return the number of points that agree with competing motions only."""
        return len(np.setdiff1d(self.points[motion.other_inliers], self.points[motion.scene.inliers]))

    def count_scene(self, motion: SelectedMotion) -> int:
        """Return the number of tracked points that may belong to the scene."""
        return self.count - self.count_others(motion)


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
        self._hypotheses = MotionHypotheses(*pnp)
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

        ``bounds`` are the standard deviations of the prediction if wheels or gyro measured it;
        ``is_continued`` is true if the prediction continues a known velocity. Raises RefusedError if the
        motion cannot be estimated.
        """
        select = partial(
            self._select_motion, view, keyframe, T_current_keyframe, bounds, is_continued=is_continued
        )
        tracked = self._track(view, keyframe, T_current_keyframe)
        try:
            motion = select(tracked)
        except RefusedError:
            # The bounds of wheels or gyro hold for the prediction, not for the pose that the search found.
            select = partial(
                self._select_motion, view, keyframe, T_current_keyframe, bounds, is_continued=False
            )
            tracked = self._track(view, keyframe, self._search(view, keyframe))
            motion = select(tracked)
        if motion.others:
            # The tracker finds a point only near its predicted pixel, so it runs once with each motion.
            poses = [motion.scene.pose, *[other.pose for other in motion.others]]
            merged = TrackedPoints.merged([self._track(view, keyframe, pose) for pose in poses])
            with suppress(RefusedError):
                tracked, motion = merged, select(merged)
        elif tracked.count < 0.5 * tracked.visible:
            retracked = self._track(view, keyframe, motion.scene.pose)
            with suppress(RefusedError):
                reselected = select(retracked)
                if retracked.count_scene(reselected) > tracked.count:
                    tracked, motion = retracked, reselected
        inliers = tracked.first_of_each(motion.scene.inliers)
        refined, disparities = self._refine(
            view, keyframe, tracked.points[inliers], tracked.matches[inliers], motion.scene.pose
        )
        refined = _with_covariance(refined, motion.selection_covariance())
        counts = {
            "features": len(keyframe.features),
            "visible": tracked.visible,
            "tracked": tracked.count,
            "other_motion_points": tracked.count_others(motion),
        }
        metrics = quality.motion_metrics(refined, disparities, counts) | quality.hypothesis_metrics(motion)
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
    ) -> SelectedMotion:
        """Return the motion of the scene among those of the tracked points; raises RefusedError."""
        inputs = PerspectiveNPointSolvingInputs(
            points=keyframe.points[tracked.points],
            projections=tracked.matches,
            camera_matrix=view.camera_matrix,
            guess=guess,
        )
        rows, columns = view.left.shape
        return self._hypotheses.select(inputs, (rows, columns), bounds, is_continued=is_continued)

    def _search(self, view: StereoView, keyframe: Keyframe) -> FloatArray:
        """Return ``T_current_keyframe`` by descriptors, without a prediction."""
        detected = self._extraction.process(
            FeaturesExtraction2DInputs(image=view.left, mask=view.left_mask)
        ).features
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
        out: PerspectiveNPointSolvingOutputs = self._pnp.process(
            PerspectiveNPointSolvingInputs(
                points=keyframe.points[candidates[pairs[:, 0]]],
                projections=corners[pairs[:, 1]],
                camera_matrix=view.camera_matrix,
            )
        )
        return out.camera

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
        valid = matched.valid & view.is_on_scene(matches, matched.disparities)
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


def _with_covariance(
    refined: StereoMotionEstimationOutputs, added: FloatArray
) -> StereoMotionEstimationOutputs:
    """Return a motion with an additional covariance (6, 6), [x y z rx ry rz]."""
    return replace(
        refined,
        covariance=refined.covariance + added,
        noise_covariance=refined.noise_covariance + added,
    )
