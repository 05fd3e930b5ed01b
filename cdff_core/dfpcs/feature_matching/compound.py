# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of FeatureMatching: describe, match, verify, guide, accept, publish."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import (
    CorrespondenceMap2D,
    Matrix3d,
    MatrixXd,
    TransformWithCovariance,
    VisualPointFeatureVector2D,
)
from cdff_core.dfns.cameras_transform_estimation.interface import CamerasTransformEstimationInputs
from cdff_core.dfns.essential_matrix_computation.interface import EssentialMatrixComputationInputs
from cdff_core.dfns.fundamental_matrix_computation.interface import FundamentalMatrixComputationInputs
from cdff_core.dfns.homography_computation.interface import HomographyComputationInputs
from cdff_core.dfpcs.feature_matching.features import (
    SEARCHED_POINTS,
    FeatureMatcher,
    FeatureView,
    FloatArray,
    PointPairs,
)
from cdff_core.dfpcs.feature_matching.interface import FeatureMatchingInterface
from cdff_core.dfpcs.feature_matching.two_view_models import VerifiedPairs, is_planar
from cdff_core.imaging.two_view import inlier_probabilities

#: Number of inliers below which the matches are DEGRADED.
_GOOD_INLIERS = 30
#: Ratio of inliers on one plane above which the transform is DEGRADED.
_MAX_PLANAR_RATIO = 0.95
#: Ratio of the squared error of the pose to that of the next best pose above which the transform is
#: DEGRADED.
_MAX_AMBIGUITY = 0.8
#: Standard deviation of the direction of the translation above which no direction is stated.
_MAX_DIRECTION_SIGMA_DEG = 10.0
#: Models and the store items of their matrices.
_MATRIX_ITEMS = {
    "fundamental": "fundamental_matrix",
    "homography": "homography",
    "essential": "essential_matrix",
}


class FeatureMatching(FeatureMatchingInterface):
    """Match each right image with the last left one."""

    def setup(self) -> None:
        """Create the DFNs; offer the store items."""
        variant = next(i for i in self.description.implementations if i.name == self.implementation)
        slots = {d.dfn_id: self.dfn(d.dfn_id) for d in variant.dfns}
        self._matcher = FeatureMatcher(slots)
        self._fundamental, self._homography = slots["fundamental"], slots["homography"]
        self._essential, self._decompose = slots["essential"], slots["decompose"]
        self._models: dict[str, FloatArray] = {}
        self.forget()
        for name, item in _MATRIX_ITEMS.items():
            self.store.offer(item, partial(self._model, name, Matrix3d))
            self.store.offer(f"{name}_covariance", partial(self._model, f"{name}_covariance", MatrixXd))
        self.store.offer("features", self._features)

    def forget(self) -> None:
        """Clear the images and the models."""
        self._left: FeatureView | None = None
        self._waiting: Sample | None = None
        self._models = {}

    def on_left(self, sample: Sample) -> Iterable[Output]:
        """Describe and store the image; match the right image that waited for it."""
        waiting, self._waiting = self._waiting, None
        try:
            self._left = self._matcher.view(sample)
        except InputError as error:
            self._left = None
            return [self._failed(sample, (sample.id,), f"bad_left:{error}")]
        return () if waiting is None else self.on_right(waiting)

    def on_right(self, sample: Sample) -> Iterable[Output]:
        """Match the image with the left one; without a left image it waits."""
        if self._left is None:
            self._waiting = sample
            return []
        self._models = {}
        input_ids = (self._left.sample.id, sample.id)
        try:
            right = self._matcher.view(sample)
            verified, unguided = self._match(self._left, right)
        except InputError as error:
            return [self._failed(sample, input_ids, f"bad_right:{error}")]
        except RefusedError as refusal:
            return [self._failed(sample, input_ids, "no_common_scene", *refusal.reasons)]
        outputs = [self._matches(sample, input_ids, verified)]
        return [*outputs, *self._transform(self._left, right, input_ids, verified, unguided.inliers)]

    def _match(self, left: FeatureView, right: FeatureView) -> tuple[VerifiedPairs, VerifiedPairs]:
        """Return all verified pairs, and the pairs that were found before the search along epipolar lines;
        raises RefusedError if the pairs have no common geometry.
        """
        try:
            verified = self._verify(self._matcher.match(left, right))
        except RefusedError:
            if max(len(left.points), len(right.points)) <= SEARCHED_POINTS:
                raise
            verified = self._verify(self._matcher.match(left, right, limit=None))
        guided = self._matcher.match_along_lines(left, right, verified.fundamental_matrix)
        if guided is None or len(guided) <= verified.count:
            return verified, verified
        verified_guided = self._verify(guided, verified)
        return (verified_guided if verified_guided.count > verified.count else verified), verified

    def _verify(self, pairs: PointPairs, previous: VerifiedPairs | None = None) -> VerifiedPairs:
        """Fit a fundamental matrix and a homography, and verify the pairs with the better model.

        With ``previous``, the fits start at its models, and the same kind of model verifies the pairs.
        """
        guesses = (previous.fundamental_matrix, previous.homography) if previous else (None, None)
        lines = self._fundamental.process(
            FundamentalMatrixComputationInputs(source=pairs.left, sink=pairs.right, guess=guesses[0])
        )
        self._store_model("fundamental", lines.fundamental_matrix, lines.covariance)
        if previous and not previous.planar:
            return VerifiedPairs.from_lines(pairs, lines, previous.homography)
        try:
            plane = self._homography.process(
                HomographyComputationInputs(source=pairs.left, sink=pairs.right, guess=guesses[1])
            )
        except RefusedError:
            return VerifiedPairs.from_lines(pairs, lines)
        self._store_model("homography", plane.homography, plane.covariance)
        if previous or is_planar(pairs, lines, plane):
            return VerifiedPairs.from_plane(pairs, lines, plane)
        return VerifiedPairs.from_lines(pairs, lines, plane.homography)

    def _matches(self, sample: Sample, input_ids: tuple[str, ...], v: VerifiedPairs) -> Output:
        """Return the verified correspondences with their inlier probabilities."""
        inliers, span = v.inliers, float(np.hypot(*np.ptp(v.pairs.right, axis=0)))
        probabilities = inlier_probabilities(v.residuals[v.agrees], v.sigma_px, float(v.agrees.mean()), span)
        reasons = [f"few_inliers:{v.count}<{_GOOD_INLIERS}"] if v.count < _GOOD_INLIERS else []
        metrics = {
            "pairs": len(v.pairs),
            "inliers": v.count,
            "sigma_px": v.sigma_px,
            "planar_ratio": v.planar_ratio,
            "log10_false_alarms": v.log_false_alarms,
        }
        value = CorrespondenceMap2D.from_arrays(inliers.left, inliers.right, probabilities)
        return self._output(
            "matches", sample, input_ids, value, Quality.from_reasons(reasons, metrics=metrics)
        )

    def _transform(
        self,
        left: FeatureView,
        right: FeatureView,
        input_ids: tuple[str, ...],
        v: VerifiedPairs,
        inliers: PointPairs,
    ) -> Iterable[Output]:
        """Return the relative pose of the cameras if both are known; FAILED if it is undetermined.

        It is estimated from pairs found without the epipolar lines (``inliers``): wrong pairs found near the
        lines of a model, as on a repeated pattern, agree with its errors.
        """
        K = (left.camera, right.camera)
        if K[0] is None or K[1] is None:
            return []
        try:
            model = self._essential.process(
                EssentialMatrixComputationInputs(
                    source=inliers.left, sink=inliers.right, source_camera=K[0], sink_camera=K[1]
                )
            )
            self._store_model("essential", model.essential_matrix, model.covariance)
            pose = self._decompose.process(
                CamerasTransformEstimationInputs(
                    essential_matrix=model.essential_matrix,
                    source=inliers.left,
                    sink=inliers.right,
                    source_camera=K[0],
                    sink_camera=K[1],
                )
            )
        except RefusedError as refusal:
            return [self._output("transform", right.sample, input_ids, None, Quality.from_error(refusal))]
        sigma_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1])))
        limits = (
            ("planar", v.planar_ratio, _MAX_PLANAR_RATIO),
            ("ambiguous", model.ambiguity, _MAX_AMBIGUITY),
            ("small_baseline", sigma_deg, _MAX_DIRECTION_SIGMA_DEG),
        )
        reasons = [f"{name}:{value:.3g}>{limit:g}" for name, value, limit in limits if value > limit]
        metrics = {
            "inliers": float(pose.inliers.sum()),
            "parallax_deg": pose.parallax_deg,
            "direction_sigma_deg": sigma_deg,
            "ambiguity": model.ambiguity,
        }
        covariance = pose.covariance
        if sigma_deg > _MAX_DIRECTION_SIGMA_DEG:
            covariance = _without_direction(pose.transform, covariance)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(pose.transform, covariance),
            parent=self._frame(left.sample, "left"),
            child=self._frame(right.sample, "right"),
            stamp_ns=right.sample.stamp_ns,
            producer=self.name,
        )
        status = Status.DEGRADED if reasons else Status.OK
        quality = Quality(status, ("scale_unknown", *reasons), CovarianceKind.FORMAL, metrics)
        return [self._output("transform", right.sample, input_ids, value, quality)]

    def _output(
        self, port: str, sample: Sample, input_ids: tuple[str, ...], value: Any, quality: Quality
    ) -> Output:
        t0_ns = min(sample.stamp_ns, self._left.sample.stamp_ns if self._left else sample.stamp_ns)
        frame = self._frame(self._left.sample if self._left else sample, "left")
        child = self._frame(sample, "right") if port == "transform" else None
        return Output(port, value, t0_ns, sample.stamp_ns, frame, child, quality, input_ids)

    def _failed(self, sample: Sample, input_ids: tuple[str, ...], *reasons: str) -> Output:
        return self._output("matches", sample, input_ids, None, Quality.failed(*reasons))

    def _frame(self, sample: Sample, side: str) -> str:
        return sample.frame or f"{self.context.robot}/navcam_{side}"

    def _store_model(self, name: str, matrix: FloatArray, covariance: FloatArray) -> None:
        self._models |= {name: matrix, f"{name}_covariance": covariance}

    def _model(self, key: str, kind: type) -> Any:
        return kind(self._models[key]) if key in self._models else None

    def _features(self) -> VisualPointFeatureVector2D | None:
        if self._left is None:
            return None
        descriptors = self._left.descriptors.astype(np.float64)
        return VisualPointFeatureVector2D.from_arrays(self._left.points, descriptors)


def _without_direction(transform: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of a transform if any direction of its unit translation is as likely.

    The difference of a uniformly distributed unit vector from the stated one t has ``I / 3 + t t'``.
    """
    t, result = transform[:3, 3], np.zeros((6, 6))
    result[:3, :3] = np.eye(3) / 3.0 + np.outer(t, t)
    result[3:, 3:] = covariance[3:, 3:]
    return result
