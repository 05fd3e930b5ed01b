# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of FeatureMatching: describe, match, verify, guide, judge, answer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import (
    CorrespondenceMap2D,
    Matrix3d,
    MatrixXd,
    TransformWithCovariance,
    VisualPointFeatureVector2D,
)
from cdff_core.dfns.cameras_transform_estimation._interface import CamerasTransformEstimationInputs
from cdff_core.dfns.essential_matrix_computation._interface import EssentialMatrixComputationInputs
from cdff_core.dfns.fundamental_matrix_computation._interface import FundamentalMatrixComputationInputs
from cdff_core.dfns.homography_computation._interface import HomographyComputationInputs
from cdff_core.dfpcs.feature_matching._features import FloatArray, Matcher, Pairs, View
from cdff_core.dfpcs.feature_matching._interface import FeatureMatchingInterface
from cdff_core.dfpcs.feature_matching._models import Verified, one_plane_explains
from cdff_core.imaging.two_view import inlier_probabilities


class FeatureMatchingConfig(DfpcConfig):
    """Parameters of the DFNs, and when an answer is to be taken with care."""

    blobs: dict[str, Any] = Field({}, description="Of FeaturesExtraction2D")
    corners: dict[str, Any] = Field({}, description="Of FeaturesExtraction2D")
    describe: dict[str, Any] = Field({}, description="Of FeaturesDescription2D")
    match: dict[str, Any] = Field({}, description="Of FeaturesMatching2D")
    guide: dict[str, Any] = Field({}, description="Of FeaturesMatching2D along epipolar lines")
    track: dict[str, Any] = Field({}, description="Of FeaturesTracking2D")
    fundamental: dict[str, Any] = Field({}, description="Of FundamentalMatrixComputation")
    homography: dict[str, Any] = Field({}, description="Of HomographyComputation")
    essential: dict[str, Any] = Field({}, description="Of EssentialMatrixComputation")
    decompose: dict[str, Any] = Field({}, description="Of CamerasTransformEstimation")
    few_inliers: Annotated[int, Field(ge=8)] = Field(30, description="Inliers below which the matches are DEGRADED")
    planar_share: float = Field(
        0.95, gt=0, le=1, description="Share of inliers on one plane from which the transform is DEGRADED"
    )


class FeatureMatching(FeatureMatchingInterface):
    """Match each right image with the last left one."""

    Config: ClassVar[type[DfpcConfig]] = FeatureMatchingConfig

    config: FeatureMatchingConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        variant = next(i for i in self.description.implementations if i.name == self.implementation)
        slots = {d.dfn_id: self.dfn(d.dfn_id) for d in variant.dfns}
        self._matcher = Matcher(slots)
        self._verify, self._plane = slots["fundamental"], slots["homography"]
        self._essential, self._decompose = slots["essential"], slots["decompose"]
        self._models: dict[str, FloatArray] = {}
        self.forget()
        for name in ("fundamental", "homography", "essential"):
            matrix = f"{name}_matrix" if name != "homography" else name
            self.store.offer(matrix, lambda key=name: self._stored(key, Matrix3d))
            self.store.offer(f"{name}_covariance", lambda key=f"{name}_covariance": self._stored(key, MatrixXd))
        self.store.offer("features", self._features)

    def forget(self) -> None:
        """Forget the images and what was found in them."""
        self._left: View | None = None
        self._waiting: Sample | None = None
        self._models = {}

    def on_left(self, sample: Sample) -> Iterable[Output]:
        """Describe and keep the image; meet the one that waited for it."""
        waiting, self._waiting = self._waiting, None
        try:
            self._left = self._matcher.view(sample)
        except InputError as error:
            self._left = None
            return [self._failed(sample, (sample.id,), f"bad_left:{error}")]
        return () if waiting is None else self.on_right(waiting)

    def on_right(self, sample: Sample) -> Iterable[Output]:
        """Match the image with the left one; without that one it waits."""
        if self._left is None:
            self._waiting = sample
            return []
        self._models = {}
        used = (self._left.sample.id, sample.id)
        try:
            right = self._matcher.view(sample)
            verified = self._verified(self._left, right)
        except InputError as error:
            return [self._failed(sample, used, f"bad_right:{error}")]
        except RefusedError as refusal:
            return [self._failed(sample, used, "no_common_scene", *refusal.reasons)]
        outputs = [self._matches(sample, used, verified)]
        return [*outputs, *self._transform(self._left, right, used, verified)]

    def _verified(self, left: View, right: View) -> Verified:
        """Pairs and the geometry that they agree on; raises RefusedError where they agree on none."""
        first = self._judged(self._matcher.pairs(left, right))
        guided = self._matcher.guided(left, right, first.fundamental_matrix)
        if guided is None or len(guided) <= first.count:
            return first
        second = self._judged(guided, first.planar)
        return second if second.count > first.count else first

    def _judged(self, pairs: Pairs, planar: bool | None = None) -> Verified:
        """Fundamental matrix, homography, and which of them the pairs are to be judged by."""
        lines = self._verify.process(FundamentalMatrixComputationInputs(pairs.left, pairs.right))
        self._keep("fundamental", lines.fundamental_matrix, lines.covariance)
        try:
            plane = self._plane.process(HomographyComputationInputs(pairs.left, pairs.right))
        except RefusedError:
            return Verified.by_lines(pairs, lines, 0.0)
        self._keep("homography", plane.homography, plane.covariance)
        if planar is None:
            planar = one_plane_explains(pairs, lines, plane)
        share = float((plane.inliers & lines.inliers).sum() / lines.inliers.sum())
        return Verified.by_plane(pairs, lines, plane) if planar else Verified.by_lines(pairs, lines, share)

    def _matches(self, sample: Sample, used: tuple[str, ...], v: Verified) -> Output:
        inliers, span = v.inliers, float(np.hypot(*np.ptp(v.pairs.right, axis=0)))
        probabilities = inlier_probabilities(v.residuals[v.agree], v.sigma_px, float(v.agree.mean()), span)
        few = self.config.few_inliers
        reasons = (f"few_inliers:{v.count}<{few}",) if v.count < few else ()
        metrics = {
            "pairs": float(len(v.pairs)), "inliers": float(v.count), "sigma_px": v.sigma_px,
            "planar_share": v.planar_share, "log10_false_alarms": v.log_false_alarms,
        }  # fmt: skip
        status = Status.DEGRADED if reasons else Status.OK
        value = CorrespondenceMap2D.from_arrays(inliers.left, inliers.right, probabilities)
        return self._output("matches", sample, used, value, Quality(status, reasons, metrics=metrics))

    def _transform(self, left: View, right: View, used: tuple[str, ...], v: Verified) -> Iterable[Output]:
        """How the cameras stand to each other; nothing where they are not known, FAILED where the pairs do not say."""
        K, inliers = (left.camera, right.camera), v.inliers
        if K[0] is None or K[1] is None:
            return []
        try:
            model = self._essential.process(EssentialMatrixComputationInputs(inliers.left, inliers.right, K[0], K[1]))
            self._keep("essential", model.essential_matrix, model.covariance)
            found = self._decompose.process(
                CamerasTransformEstimationInputs(model.essential_matrix, inliers.left, inliers.right, K[0], K[1])
            )
        except RefusedError as refusal:
            return [self._output("transform", right.sample, used, None, Quality(Status.FAILED, refusal.reasons))]
        limit = self.config.planar_share
        reasons = ("scale_unknown", *((f"planar:{v.planar_share:.3f}>{limit:g}",) if v.planar_share > limit else ()))
        metrics = {"inliers": float(found.inliers.sum()), "parallax_deg": float(found.parallax_deg)}
        value = TransformWithCovariance.from_transform(
            UncertainTransform(found.transform, found.covariance), parent=self._frame(left.sample, "left"),
            child=self._frame(right.sample, "right"), stamp_ns=right.sample.stamp_ns, producer=self.name,
        )  # fmt: skip
        status = Status.DEGRADED if len(reasons) > 1 else Status.OK
        return [
            self._output(
                "transform", right.sample, used, value, Quality(status, reasons, CovarianceKind.CALIBRATED, metrics)
            )
        ]

    def _output(self, port: str, sample: Sample, used: tuple[str, ...], value: Any, quality: Quality) -> Output:
        t0_ns = min(sample.stamp_ns, self._left.sample.stamp_ns if self._left else sample.stamp_ns)
        frame = self._frame(self._left.sample if self._left else sample, "left")
        child = self._frame(sample, "right") if port == "transform" else None
        return Output(port, value, t0_ns, sample.stamp_ns, frame, child, quality, tuple(i for i in used if i))

    def _failed(self, sample: Sample, used: tuple[str, ...], *reasons: str) -> Output:
        return self._output("matches", sample, used, None, Quality(Status.FAILED, reasons))

    def _frame(self, sample: Sample, side: str) -> str:
        return sample.frame or f"{self.context.robot}/navcam_{side}"

    def _keep(self, name: str, matrix: FloatArray, covariance: FloatArray) -> None:
        self._models |= {name: matrix, f"{name}_covariance": covariance}

    def _stored(self, key: str, kind: type) -> Any:
        return kind(self._models[key]) if key in self._models else None

    def _features(self) -> VisualPointFeatureVector2D | None:
        if self._left is None:
            return None
        descriptors = self._left.descriptors.astype(np.float64)
        return VisualPointFeatureVector2D.from_arrays(self._left.points, descriptors)
