# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualOdometryDense: assess, initialise or predict, align, accept, replace the keyframe."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import FramePair, PoseTrajectory
from cdff_core.dfns.photometric_motion_estimation.interface import PhotometricMotionEstimationOutputs
from cdff_core.dfpcs.visual_odometry_dense.attitude import AttitudeFixes
from cdff_core.dfpcs.visual_odometry_dense.configuration import VisualOdometryDenseConfig
from cdff_core.dfpcs.visual_odometry_dense.interface import VisualOdometryDenseInterface
from cdff_core.dfpcs.visual_odometry_dense.keyframe import CALIBRATION, Keyframe, KeyframeAligner
from cdff_core.dfpcs.visual_odometry_dense.quality import alignment_metrics, alignment_reasons
from cdff_core.stereo_odometry.camera_path import CameraPath
from cdff_core.stereo_odometry.consider_state import ConsiderState
from cdff_core.stereo_odometry.gaps import Gaps
from cdff_core.stereo_odometry.image_acceptance import assess_pair
from cdff_core.stereo_odometry.limits import blur_reasons
from cdff_core.stereo_odometry.motion_prior import CAMERAS, MotionPrior
from cdff_core.stereo_odometry.stereo_view import StereoView


class VisualOdometryDense(VisualOdometryDenseInterface):
    """Motion of a rectified stereo camera from dense pixels aligned to a keyframe."""

    Config = VisualOdometryDenseConfig
    config: VisualOdometryDenseConfig

    def setup(self) -> None:
        """Create the DFNs and an empty path; offer the store items."""
        self._parent = f"{self.context.robot}/vo"
        self._child = self.context.sensor_frame("navcam_left", *CAMERAS)
        dfn = cache(self.dfn)
        self._assessment = dfn("assessment")
        self._aligner = KeyframeAligner(dfn, self._seeded("pnp"))
        self._prior = MotionPrior(dfn("gyro"))
        self._path = CameraPath(self._prior.increment)
        self._attitude = AttitudeFixes()
        self._keyframe: Keyframe | None = None
        self._last: StereoView | None = None
        self._gaps = Gaps()
        self.store.offer("keyframe", lambda: self._keyframe and self._keyframe.view.pair)
        self.store.offer("trajectory", lambda: self._path.trajectory(self._parent, self._child))

    def _seeded(self, dfn_id: str) -> Dfn[Any, Any, Any]:
        """Return the DFN of a slot, with the seed of the context unless its parameters contain one."""
        node = self.dfn(dfn_id)
        if "seed" not in self.slot_parameters(dfn_id):
            node.configure(node.config.model_copy(update={"seed": self.context.seed}))
        return node

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Buffer a pose of the wheel odometry for the prediction."""
        self._prior.add_pose(sample.stamp_ns, sample.value.transform)
        return ()

    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Buffer an angular rate for the prediction."""
        self._prior.add_rate(sample.stamp_ns, np.asarray(sample.value.gyro, np.float64))
        return ()

    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Store an attitude fix for the next pair."""
        self._attitude.add(sample.stamp_ns, sample.value.transform)
        return ()

    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Locate the camera at a pair; the output is FAILED if the pair is refused."""
        try:
            view = self._view_of(sample)
            previous, self._last = self._last, view
            is_repeated, sharpness = assess_pair(self._assessment, view, previous)
            if is_repeated and not self._path.is_empty:
                return [self._repeat(view)]
            if self._keyframe is None:
                return [self._initialise(view, sharpness)]
            return [self._align(view, self._keyframe, sharpness)]
        except RefusedError as refusal:
            quality = Quality.from_error(refusal)
        except InputError as error:
            quality = Quality.failed(f"input:{error}")
        return [self._output(sample.stamp_ns, (sample.id,), None, quality)]

    def get_trajectory(self) -> PoseTrajectory:
        """Return all poses since the start or reset, with covariance."""
        trajectory: PoseTrajectory = self.store.get("trajectory")
        return trajectory

    def _view_of(self, sample: Sample) -> StereoView:
        """Return the view of a sample; after a change of the camera only the path is kept."""
        if not isinstance(sample.value, FramePair):
            raise InputError(f"stereo: got a {type(sample.value).__name__}, expected a FramePair")
        view, last = StereoView.from_sample(sample), self._last
        if last is not None and view.stamp_ns <= last.stamp_ns:
            raise RefusedError("stamps must increase", [f"stamp_not_after:{last.stamp_ns}"])
        if last is not None and not view.has_same_camera(last):
            self._keyframe, self._last = None, None
            self._aligner.calibration.reset()
            self._gaps.close()
        self._prior.set_mounts(self.context, view.pair.left.T_robot_sensor, view.stamp_ns)
        return view

    def _repeat(self, view: StereoView) -> Output:
        """Publish the last pose again for identical images: the camera is frozen, or simulated at rest."""
        quality = Quality(
            Status.DEGRADED, ("repeated_image",), CovarianceKind.FORMAL, {"gaps": self._gaps.count}
        )
        return self._output(view.stamp_ns, (view.sample_id,), self._path.repeat(view.stamp_ns), quality)

    def _initialise(self, view: StereoView, sharpness: float) -> Output:
        """Make the first keyframe, at the origin; after a change of the camera, at the predicted pose."""
        after_camera_change = not self._path.is_empty
        pose = self._path.across_gap(view.stamp_ns) if after_camera_change else UncertainTransform.identity()
        self._keyframe, reasons = self._aligner.build(
            view, ConsiderState.independent(pose, CALIBRATION), sharpness
        )
        reasons += blur_reasons(sharpness) + (["camera_changed"] if after_camera_change else [])
        self._gaps.count += after_camera_change
        covariance = self._aligner.calibration.covariance_px2
        self._fixed(
            self._keyframe.pose, view.stamp_ns, covariance
        )  # the first fix defines the attitude of the frame
        self._path.add(view.stamp_ns, pose, after_gap=after_camera_change)
        metrics = {"sharpness": sharpness, "gaps": float(self._gaps.count)}
        return self._output(view.stamp_ns, (view.sample_id,), pose, self._quality(reasons, metrics))

    def _align(self, view: StereoView, keyframe: Keyframe, sharpness: float) -> Output:
        """Locate the camera relative to the keyframe; bridge a gap after repeated refusals."""
        bounds = self._prior.bounds(keyframe.view.stamp_ns, view.stamp_ns)
        predicted = se3.inverse(keyframe.pose.matrix) @ self._path.predict(view.stamp_ns)
        try:
            aligned = self._aligner.align(view, keyframe, predicted)
        except RefusedError:
            self._bridge_gap(view, sharpness)
            raise
        metrics = alignment_metrics(aligned)
        metrics["prior_ratio"] = 0.0 if bounds is None else bounds.ratio(aligned.motion)
        reasons = alignment_reasons(metrics) + blur_reasons(sharpness, keyframe.sharpness)
        reasons += ["gap"] if self._gaps.is_open else []
        calibration, change = (
            self._aligner.calibration,
            aligned.calibration - self._aligner.calibration.mean_px,
        )
        response = np.hstack([aligned.common_response, aligned.calibration_response])
        motion = ConsiderState(aligned.motion, aligned.noise_covariance, response)
        state = keyframe.pose.with_calibration_change(change) @ motion
        calibration.store(aligned.calibration, aligned.calibration_covariance)
        state, fix_reasons, is_fixed = self._fixed(state, view.stamp_ns, aligned.calibration_covariance)
        pose = state.to_transform(aligned.calibration_covariance)
        self._path.add(view.stamp_ns, pose, after_gap=self._gaps.is_open)
        self._gaps.close()
        inputs = (keyframe.view.sample_id, view.sample_id)
        if is_fixed or self._is_left(aligned, view):
            try:
                self._keyframe = self._aligner.build(view, state, sharpness)[0]
            except RefusedError as refusal:
                reasons += refusal.reasons
        metrics |= {"sharpness": sharpness, "gaps": float(self._gaps.count)} | calibration.metrics()
        return self._output(view.stamp_ns, inputs, pose, self._quality(reasons + fix_reasons, metrics))

    def _is_left(self, aligned: PhotometricMotionEstimationOutputs, view: StereoView) -> bool:
        """Return whether the keyframe is to be replaced."""
        allowed_px = self.config.keyframe_motion * view.left.shape[1]
        return aligned.overlap < self.config.keyframe_overlap or aligned.moved > allowed_px

    def _bridge_gap(self, view: StereoView, sharpness: float) -> None:
        """Count a refused pair; after several in a row make a keyframe at the predicted pose."""
        if self._gaps.refuse():
            pose = ConsiderState.independent(self._path.across_gap(view.stamp_ns), CALIBRATION)
            self._keyframe = self._aligner.build(view, pose, sharpness)[0]
            self._gaps.bridge()

    def _fixed(
        self, state: ConsiderState, stamp_ns: int, calibration_covariance: FloatArray | None
    ) -> tuple[ConsiderState, list[str], bool]:
        """Return a pose corrected by the latest attitude fix, reasons, and whether it was corrected."""
        mount = self._prior.T_base_left
        if mount is None or calibration_covariance is None:
            return state, [], False
        corrected, reasons = self._attitude.correct(state, mount, stamp_ns, calibration_covariance)
        return corrected, reasons, corrected is not state

    def _quality(self, reasons: list[str], metrics: dict[str, float]) -> Quality:
        return Quality.from_reasons(reasons, self.covariance_kind, metrics)

    def _output(
        self, stamp_ns: int, inputs: tuple[str, ...], pose: UncertainTransform | None, quality: Quality
    ) -> Output:
        names: dict[str, Any] = {"frame": self._parent, "child": self._child, "producer": self.name}
        return Output.of_pose("pose", pose, stamp_ns=stamp_ns, quality=quality, inputs=inputs, **names)
