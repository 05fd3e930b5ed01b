# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The controller of the DFPC VisualOdometrySparse: which DFN runs when.

One pass of ``on_stereo`` is the control sequence of ``dfpc.yaml``: assess, anchor or predict, track, reject, measure
disparities, refine, judge, renew the key frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.errors import FrameNotFoundError, InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import FramePair, PoseTrajectory, TransformWithCovariance
from cdff_core.dfns.features_description_2d._interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d._interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d._interface import FeaturesMatching2DInputs
from cdff_core.dfns.features_prediction_2d._interface import FeaturesPrediction2DInputs
from cdff_core.dfns.features_tracking_2d._interface import FeaturesTracking2DInputs
from cdff_core.dfns.gyro_integration._interface import GyroIntegrationInputs
from cdff_core.dfns.image_assessment._interface import ImageAssessmentInputs
from cdff_core.dfns.perspective_n_point_solving._interface import PerspectiveNPointSolvingInputs
from cdff_core.dfns.rectification_refinement._interface import RectificationRefinementInputs
from cdff_core.dfns.stereo_matching_2d._interface import StereoMatching2DInputs
from cdff_core.dfns.stereo_motion_estimation._interface import (
    StereoMotionEstimationInputs,
    StereoMotionEstimationOutputs,
)
from cdff_core.dfns.stereo_triangulation._interface import StereoTriangulationInputs
from cdff_core.dfpcs.visual_odometry_sparse import _verdict as verdict
from cdff_core.dfpcs.visual_odometry_sparse._config import VisualOdometrySparseConfig
from cdff_core.dfpcs.visual_odometry_sparse._felt import Felt
from cdff_core.dfpcs.visual_odometry_sparse._interface import VisualOdometrySparseInterface
from cdff_core.dfpcs.visual_odometry_sparse._linked import LinkedPose
from cdff_core.dfpcs.visual_odometry_sparse._state import Calibration, FloatArray, KeyFrame, Path, View, required


class VisualOdometrySparse(VisualOdometrySparseInterface):
    """Motion of a rectified stereo camera from points tracked against a key frame."""

    Config = VisualOdometrySparseConfig
    config: VisualOdometrySparseConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything seen, offer the local store."""
        self.assessment, self.extraction = self.dfn("assessment"), self.dfn("extraction")
        self.stereo_matching, self.refinement = self.dfn("stereo_matching"), self.dfn("refinement")
        self.triangulation = self.dfn("triangulation")
        self.prediction, self.tracking = self.dfn("prediction"), self.dfn("tracking")
        self.describing, self.matching = self.dfn("description"), self.dfn("matching")
        self.pnp, self.motion = self.dfn("pnp"), self.dfn("motion")
        if "seed" not in self.config.pnp:
            self.pnp.configure(self.pnp.config.model_copy(update={"seed": self.context.seed}))
        c = self.config
        self._parent, self._child = f"{self.context.robot}/vo", f"{self.context.robot}/navcam_left"
        self._gyro = self.dfn("gyro")
        self._felt = Felt(self._integrate, int(c.felt_memory_s * 1e9))
        self._path = Path(c.trajectory_length, self._felt.increment)
        self._calibration = Calibration(c.sigma_calibration_walk_px)
        self._key: KeyFrame | None = None
        self._before: list[tuple[KeyFrame, LinkedPose]] = []  # older key frames with the motion to the one after each
        self._last: View | None = None
        self._lost, self._gaps, self._gap_open = 0, 0, False
        self.store.offer("keyframe", lambda: self._key and self._key.view.pair)
        self.store.offer("trajectory", lambda: self._path.trajectory(self._parent, self._child))

    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Locate the camera at one pair; always one output."""
        try:
            view = self._take(sample)
            repeated, sharpness = self._assess(view)
            if repeated and self._path:
                return [self._repeat(view)]
            if self._key is None:
                return [self._begin(view, sharpness)]
            return [self._follow(view, self._key, sharpness)]
        except RefusedError as refusal:
            return [self._output(sample.stamp_ns, (sample.id,), None, Quality(Status.FAILED, refusal.reasons))]
        except InputError as error:
            return [self._output(sample.stamp_ns, (sample.id,), None, Quality(Status.FAILED, (f"input:{error}",)))]

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Keep the wheels' pose: it tells where to look."""
        self._felt.add_pose(sample.stamp_ns, sample.value.transform.matrix)
        return ()

    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Keep the angular rate: it tells how far the picture has turned."""
        self._felt.add_rate(sample.stamp_ns, np.asarray(sample.value.gyro, np.float64))
        return ()

    def get_trajectory(self) -> PoseTrajectory:
        """All poses since the start or reset, with covariance."""
        trajectory: PoseTrajectory = self.store.get("trajectory")
        return trajectory

    def _take(self, sample: Sample) -> View:
        if not isinstance(sample.value, FramePair):
            raise InputError(f"stereo: got a {type(sample.value).__name__}, expected a FramePair")
        view = View.of(sample.value, sample.stamp_ns, sample.id)
        if self._last is not None and view.stamp_ns <= self._last.stamp_ns:
            raise RefusedError("stamps must rise", [f"stamp_not_after:{self._last.stamp_ns}"])
        if self._last is not None and not view.is_of_camera(self._last):
            self._forget_camera()
        self._mount(view)
        return view

    def _forget_camera(self) -> None:
        """Another image size, camera matrix or baseline: of what is known, only the path applies to what comes."""
        self._key, self._before, self._last = None, [], None
        self._calibration = Calibration(self.config.sigma_calibration_walk_px)
        self._lost, self._gap_open = 0, False

    def _mount(self, view: View) -> None:
        """Learn how the camera sits on the robot, and the gyro: of what is not known, nothing is felt."""
        robot = self.context.robot
        mount = view.pair.left.T_robot_sensor
        try:
            mount = mount or self.context.frames.lookup(f"{robot}/base", self._child, view.stamp_ns)
            self._felt.T_left_base = se3.inverse(mount.matrix)
            T_base_imu = self.context.frames.lookup(f"{robot}/base", f"{robot}/imu", view.stamp_ns).matrix
            self._felt.R_left_imu = self._felt.T_left_base[:3, :3] @ T_base_imu[:3, :3]
        except FrameNotFoundError:
            return

    def _integrate(self, stamps_ns: list[int], rates: list[FloatArray], begin_ns: int, end_ns: int) -> FloatArray:
        """``R_imu1_imu2``; raises RefusedError where the rates leave a gap."""
        interval_ns = np.array([begin_ns, end_ns], dtype=np.int64)
        inputs = GyroIntegrationInputs(np.array(stamps_ns, np.int64), np.array(rates), np.zeros(3), interval_ns)
        R: FloatArray = self._gyro.process(inputs).rotation
        return R

    def _assess(self, view: View) -> tuple[bool, float]:
        """Whether the pair is the last one again, and how sharp it is; raises RefusedError on empty images."""
        last, self._last = self._last, view
        left, right = (
            self.assessment.process(ImageAssessmentInputs(image=image, previous=previous))
            for image, previous in (
                (view.left, None if last is None else last.left),
                (view.right, None if last is None else last.right),
            )
        )
        verdict.judge_images(left, right, self.config.limits)
        return bool(left.change[0] == 0.0), float(min(left.sharpness[0], right.sharpness[0]))

    def _repeat(self, view: View) -> Output:
        """The very same images: the camera is frozen, or simulated at rest; the last pose is all there is to say."""
        pose = self._path.repeated(view.stamp_ns)
        quality = Quality(Status.DEGRADED, ("repeated_image",), CovarianceKind.FORMAL, {"gaps": float(self._gaps)})
        return self._output(view.stamp_ns, (view.sample_id,), pose, quality)

    def _begin(self, view: View, sharpness: float) -> Output:
        """Anchor at the first usable pair, the origin; of another camera on the way, where it is expected by now."""
        changed = bool(self._path)
        pose = self._path.across_gap(view.stamp_ns) if changed else UncertainTransform.identity()
        self._key, reasons = self._anchor(view, self._unlinked(pose), sharpness)
        reasons += verdict.blur_reasons(sharpness, None, self.config.limits)
        if changed:
            self._gaps += 1
            reasons.append("camera_changed")
        self._path.measured(view.stamp_ns, pose, after_gap=changed)
        metrics = {"features": float(len(self._key.features)), "sharpness": sharpness, "gaps": float(self._gaps)}
        return self._output(view.stamp_ns, (view.sample_id,), pose, self._quality(reasons, metrics))

    def _unlinked(self, pose: UncertainTransform) -> LinkedPose:
        return LinkedPose.unlinked(pose, len(self._calibration.mean_px))

    def _anchor(self, view: View, pose: LinkedPose, sharpness: float) -> tuple[KeyFrame, list[str]]:
        """Make a key frame of a pair, with doubts about it; raises RefusedError where left and right differ."""
        found = self.extraction.process(FeaturesExtraction2DInputs(image=view.left))
        paired = self.stereo_matching.process(StereoMatching2DInputs(view.left, view.right, found.features))
        doubts = verdict.judge_stereo(paired.disparities[paired.valid], len(found.features), self.config.limits)
        features, disparities = found.features[paired.valid], paired.disparities[paired.valid]
        field = self.refinement.process(
            RectificationRefinementInputs(features, disparities, view.camera_matrix, paired.row_offsets[paired.valid])
        )
        self._calibration.hand_over(field.open_covariance)
        disparities = disparities + field.corrections
        corrected = disparities + field.basis @ self._calibration.mean_px
        ahead = corrected >= self.config.limits.min_disparity_px
        triangulated = self.triangulation.process(
            StereoTriangulationInputs(features[ahead], corrected[ahead], view.camera_matrix, view.baseline)
        )
        return KeyFrame(
            view, pose, features[ahead], disparities[ahead], paired.slopes[paired.valid][ahead], field.basis[ahead],
            triangulated.points, sharpness,
        ), doubts  # fmt: skip

    def _follow(self, view: View, key: KeyFrame, sharpness: float) -> Output:
        """Locate the camera against the key frame; re-anchor when that fails ``patience`` times in a row."""
        c, felt = self.config, float(self._path.is_felt(view.stamp_ns))
        try:
            T_now_key = se3.inverse(self._path.predict(view.stamp_ns)) @ key.pose.matrix
            refined, metrics, reasons = self._locate(view, key, T_now_key)
        except RefusedError:
            self._lost += 1
            if self._lost >= c.patience:
                self._key, _ = self._anchor(view, self._unlinked(self._path.across_gap(view.stamp_ns)), sharpness)
                self._gaps, self._gap_open, self._lost = self._gaps + 1, True, 0
                self._before = []
            raise
        reasons += verdict.blur_reasons(sharpness, key.sharpness, c.limits)
        reasons += ["gap"] if self._gap_open else []
        motion, renew = LinkedPose.of_motion(refined), metrics["inliers"] < c.keyframe_survival * len(key.features)
        change = refined.calibration - self._calibration.mean_px
        linked = key.pose.corrected(change) @ motion
        if renew and self._before:
            linked = self._refine(view, motion, change)
        pose = linked.stated(refined.calibration_covariance)
        self._calibration.note(refined.calibration, refined.calibration_covariance)
        self._path.measured(view.stamp_ns, pose, after_gap=self._gap_open)
        self._lost, self._gap_open = 0, False
        if renew:
            try:
                self._key, _ = self._anchor(view, linked, sharpness)
                self._before = [*self._before, (key, motion)][1 - c.window :] if c.window > 1 else []
            except RefusedError as doubt:
                reasons += doubt.reasons
        offset_px, decentring_px = (float(p) for p in self._calibration.mean_px)
        metrics |= {"sharpness": sharpness, "gaps": float(self._gaps), "felt": felt}
        metrics |= {"disparity_offset_px": offset_px, "decentring_px": decentring_px}
        return self._output(view.stamp_ns, (key.view.sample_id, view.sample_id), pose, self._quality(reasons, metrics))

    def _refine(self, view: View, motion: LinkedPose, change: FloatArray) -> LinkedPose:
        """``T_vo_now`` of a coming key frame, seen from the older ones of the window too where they still show enough.

        From the youngest to the oldest: what is known of the way from there, and what the images say of it at once.
        """
        self._before = [
            (replace(old, pose=old.pose.corrected(change)), T_old_next.corrected(change))
            for old, T_old_next in self._before
        ]
        estimate = motion
        for old, T_old_next in reversed(self._before):
            estimate = T_old_next @ estimate
            try:
                refined, _, doubts = self._locate(view, old, se3.inverse(estimate.matrix))
            except RefusedError:
                continue
            if not doubts:
                estimate = estimate.fused(LinkedPose.of_motion(refined))
        return self._before[0][0].pose @ estimate

    def _locate(
        self, view: View, key: KeyFrame, T_now_key: FloatArray
    ) -> tuple[StereoMotionEstimationOutputs, dict[str, float], list[str]]:
        """The motion from a key frame by tracking, outlier rejection, stereo matching and refinement.

        Raises RefusedError where it cannot be stood for.
        """
        tracked, matches, visible = self._track(view, key, T_now_key)
        try:
            T_now_key, agreeing = self._agree(view, key, tracked, matches, T_now_key)
        except RefusedError:
            T_now_key = self._search(view, key)
            tracked, matches, visible = self._track(view, key, T_now_key)
            T_now_key, agreeing = self._agree(view, key, tracked, matches, T_now_key)
        if len(tracked) < 0.5 * visible:
            again, again_matches, _ = self._track(view, key, T_now_key)
            if len(again) > len(tracked):
                tracked, matches = again, again_matches
                T_now_key, agreeing = self._agree(view, key, tracked, matches, T_now_key)
        candidates, matches = tracked[agreeing], matches[agreeing]
        predicted = self._predict(view, key, T_now_key)
        expected = predicted.disparities[candidates]
        field = self.refinement.process(RectificationRefinementInputs(matches, expected, view.camera_matrix))
        shift = field.corrections + field.basis @ self._calibration.mean_px
        paired = self.stereo_matching.process(
            StereoMatching2DInputs(view.left, view.right, matches, expected - shift, predicted.slopes[candidates])
        )
        least = max(self.config.limits.min_inliers, int(self.config.limits.min_pairing_fraction * len(candidates)))
        required(int(paired.valid.sum()), least, "stereo_mismatch")
        kept, ok = candidates[paired.valid], paired.valid
        reference = np.column_stack([key.features[kept], key.disparities[kept]])
        current = np.column_stack([matches[ok], paired.disparities[ok] + field.corrections[ok]])
        refined = self.motion.process(
            StereoMotionEstimationInputs(
                reference, current, view.camera_matrix, view.baseline, se3.inverse(T_now_key),
                key.basis[kept], field.basis[ok], self._calibration.mean_px, self._calibration.covariance_px2,
            )
        )  # fmt: skip
        counts = {"features": len(key.features), "visible": visible, "tracked": len(tracked)}
        metrics = verdict.motion_metrics(refined, reference[:, 2], counts, self.config.limits)
        reasons = verdict.judge_motion(metrics, self.config.limits)
        return refined, metrics, reasons

    def _predict(self, view: View, key: KeyFrame, T_now_key: FloatArray) -> Any:
        return self.prediction.process(
            FeaturesPrediction2DInputs(key.points, T_now_key, view.camera_matrix, view.baseline, view.left, key.slopes)
        )

    def _track(self, view: View, key: KeyFrame, T_now_key: FloatArray) -> tuple[Any, FloatArray, int]:
        """Indices of the key frame's points that were found, where, and how many were expected to be visible."""
        expected = self._predict(view, key, T_now_key)
        visible = np.flatnonzero(expected.visible)
        found = self.tracking.process(
            FeaturesTracking2DInputs(
                key.view.left,
                view.left,
                key.features[visible],
                expected.features[visible],
                expected.warps[visible],
            )
        )
        return visible[found.valid], found.matches[found.valid], len(visible)

    def _search(self, view: View, key: KeyFrame) -> FloatArray:
        """``T_now_key`` without a prediction, by descriptors: after a jolt, or where images were dropped."""
        found = self.extraction.process(FeaturesExtraction2DInputs(image=view.left))
        before = self.describing.process(FeaturesDescription2DInputs(key.view.left, key.features))
        now = self.describing.process(FeaturesDescription2DInputs(view.left, found.features))
        candidates, corners = np.flatnonzero(before.valid), found.features[now.valid]
        matched = self.matching.process(
            FeaturesMatching2DInputs(before.descriptors[candidates], now.descriptors[now.valid])
        )
        pairs = matched.matches
        return self._agree(view, key, candidates[pairs[:, 0]], corners[pairs[:, 1]], None)[0]

    def _agree(
        self, view: View, key: KeyFrame, tracked: Any, matches: FloatArray, guess: FloatArray | None
    ) -> tuple[FloatArray, Any]:
        """``T_now_key`` that most tracked points agree on, and which do."""
        solved = self.pnp.process(
            PerspectiveNPointSolvingInputs(key.points[tracked], matches, view.camera_matrix, guess)
        )
        return solved.camera, solved.inliers

    def _quality(self, reasons: list[str], metrics: dict[str, float]) -> Quality:
        status = Status.DEGRADED if reasons else Status.OK
        # What a gap adds is a guess, whatever the rest was held against.
        kind = CovarianceKind.FORMAL if self._gaps else CovarianceKind(self.config.covariance_kind)
        return Quality(status, tuple(reasons), kind, metrics)

    def _output(
        self, stamp_ns: int, inputs: tuple[str, ...], pose: UncertainTransform | None, quality: Quality
    ) -> Output:
        value = None
        if pose is not None:
            value = TransformWithCovariance.from_transform(
                pose, parent=self._parent, child=self._child, stamp_ns=stamp_ns, producer=self.name
            )
        named = tuple(dict.fromkeys(i for i in inputs if i))
        return Output("pose", value, stamp_ns, stamp_ns, self._parent, self._child, quality, named)
