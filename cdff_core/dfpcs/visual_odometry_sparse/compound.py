# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualOdometrySparse: assess, initialise or predict, locate, accept, replace the keyframe."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache, partial
from typing import Any

import numpy as np

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import FramePair, PoseTrajectory
from cdff_core.dfpcs.visual_odometry_sparse.configuration import VisualOdometrySparseConfig
from cdff_core.dfpcs.visual_odometry_sparse.interface import VisualOdometrySparseInterface
from cdff_core.dfpcs.visual_odometry_sparse.keyframe import Keyframe, KeyframeBuilder, KeyframeWindow
from cdff_core.dfpcs.visual_odometry_sparse.keyframe_tracker import KeyframeTracker
from cdff_core.dfpcs.visual_odometry_sparse.quality import (
    is_scene_uncertain,
)
from cdff_core.imaging.disparity_calibration import DisparityCalibration
from cdff_core.stereo_odometry.camera_path import CameraPath
from cdff_core.stereo_odometry.consider_state import ConsiderState
from cdff_core.stereo_odometry.gaps import Gaps
from cdff_core.stereo_odometry.image_acceptance import assess_pair
from cdff_core.stereo_odometry.limits import blur_reasons
from cdff_core.stereo_odometry.motion_prior import CAMERAS, MotionPrior
from cdff_core.stereo_odometry.robot_masks import RobotMasks
from cdff_core.stereo_odometry.stereo_view import StereoView


class VisualOdometrySparse(VisualOdometrySparseInterface):
    """Motion of a rectified stereo camera from points tracked against a keyframe."""

    Config = VisualOdometrySparseConfig
    config: VisualOdometrySparseConfig

    def setup(self) -> None:
        """Create the DFNs and an empty path; offer the store items."""
        self._parent = f"{self.context.robot}/vo"
        self._child = self.context.sensor_frame("navcam_left", *CAMERAS)
        dfn = cache(self.dfn)  # builder and tracker share stateful DFNs
        self._assessment = dfn("assessment")
        self._calibration = DisparityCalibration()
        self._builder = KeyframeBuilder(dfn, self._calibration)
        self._tracker = KeyframeTracker(dfn, (self._seeded("pnp"), self._seeded("pnp")), self._calibration)
        self._masks = RobotMasks(self.context)
        self._prior = MotionPrior(dfn("gyro"))
        self._path = CameraPath(self._prior.increment)
        self._keyframes = KeyframeWindow(self.config.window)
        self._last: StereoView | None = None
        self._gaps = Gaps()
        self.store.offer("keyframe", lambda: self._keyframes.newest and self._keyframes.newest.view.pair)
        self.store.offer("trajectory", lambda: self._path.trajectory(self._parent, self._child))

    def _seeded(self, dfn_id: str) -> Dfn[Any, Any, Any]:
        """Return a new DFN of a slot, with the seed of the context unless its parameters contain one."""
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

    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Update the joint positions from which the robot's links are masked."""
        self._masks.set_joints(sample.value)
        return ()

    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Locate the camera at a pair; the output is FAILED if the pair is refused."""
        try:
            view = self._view_of(sample)
            previous, self._last = self._last, view
            is_repeated, sharpness = assess_pair(self._assessment, view, previous)
            if is_repeated and not self._path.is_empty:
                return [self._repeat(view)]
            if self._keyframes.newest is None:
                return [self._initialise(view, sharpness)]
            return [self._track_keyframe(view, self._keyframes.newest, sharpness)]
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
        view, last = StereoView.from_sample(sample, self._masks), self._last
        if last is not None and view.stamp_ns <= last.stamp_ns:
            raise RefusedError("stamps must increase", [f"stamp_not_after:{last.stamp_ns}"])
        if last is not None and not view.has_same_camera(last):
            self._keyframes.restart(None)
            self._calibration.reset()
            self._last = None
            self._gaps.close()
        self._prior.set_mounts(self.context, view.pair.left.T_robot_sensor, view.stamp_ns)
        return view

    def _repeat(self, view: StereoView) -> Output:
        """Publish the last pose again for identical images: the camera is frozen, or simulated at rest."""
        metrics = {"gaps": self._gaps.count}
        quality = Quality(Status.DEGRADED, ("repeated_image",), CovarianceKind.FORMAL, metrics)
        return self._output(view.stamp_ns, (view.sample_id,), self._path.repeat(view.stamp_ns), quality)

    def _initialise(self, view: StereoView, sharpness: float) -> Output:
        """Make the first keyframe, at the origin; after a change of the camera, at the predicted pose."""
        after_camera_change = not self._path.is_empty
        pose = self._path.across_gap(view.stamp_ns) if after_camera_change else UncertainTransform.identity()
        keyframe, reasons = self._builder.build(view, self._independent(pose), sharpness)
        self._keyframes.restart(keyframe)
        reasons += blur_reasons(sharpness) + (["camera_changed"] if after_camera_change else [])
        self._gaps.count += after_camera_change
        self._path.add(view.stamp_ns, pose, after_gap=after_camera_change)
        metrics = {"features": len(keyframe.features), "sharpness": sharpness, "gaps": self._gaps.count}
        return self._output(view.stamp_ns, (view.sample_id,), pose, self._quality(reasons, metrics))

    def _track_keyframe(self, view: StereoView, keyframe: Keyframe, sharpness: float) -> Output:
        """Locate the camera relative to the keyframe; bridge a gap after repeated refusals."""
        # Since the keyframe: if earlier views followed an object, the wheels contradict it more and more.
        bounds = self._prior.bounds(keyframe.view.stamp_ns, view.stamp_ns)
        try:
            T_current_keyframe = se3.inverse(self._path.predict(view.stamp_ns)) @ keyframe.pose.matrix
            refined_motion, metrics, reasons = self._tracker.locate(
                view, keyframe, T_current_keyframe, bounds, is_continued=self._path.has_velocity
            )
        except RefusedError:
            self._bridge_gap(view, sharpness)
            raise
        reasons += blur_reasons(sharpness, keyframe.sharpness)
        reasons += keyframe.rectification
        reasons += ["gap"] if self._gaps.is_open else []
        motion = ConsiderState.from_motion(refined_motion)
        change = refined_motion.calibration - self._calibration.mean_px
        state = keyframe.pose.with_calibration_change(change) @ motion
        scene_points = metrics["features"] - metrics["other_motion_points"]
        is_renewed = metrics["inliers"] < self.config.keyframe_survival * scene_points
        is_renewed |= is_scene_uncertain(metrics)
        if is_renewed:
            state = self._keyframes.locate(motion, change, partial(self._locate, view)) or state
        pose = state.to_transform(refined_motion.calibration_covariance)
        self._calibration.store(refined_motion.calibration, refined_motion.calibration_covariance)
        self._path.add(view.stamp_ns, pose, after_gap=self._gaps.is_open)
        self._gaps.close()
        if is_renewed:
            try:
                self._keyframes.advance(self._builder.build(view, state, sharpness)[0], motion)
            except RefusedError as refusal:
                reasons += refusal.reasons
        metrics |= {"sharpness": sharpness, "gaps": self._gaps.count, "motion_prior": bounds is not None}
        metrics |= self._calibration.metrics() | {"row_offset_px": keyframe.row_offset_px}
        inputs = (keyframe.view.sample_id, view.sample_id)
        return self._output(view.stamp_ns, inputs, pose, self._quality(reasons, metrics))

    def _locate(
        self, view: StereoView, keyframe: Keyframe, T_keyframe_current: FloatArray
    ) -> ConsiderState | None:
        """Return the motion from an older keyframe; None if it has deficiencies."""
        refined_motion, _, reasons = self._tracker.locate(view, keyframe, se3.inverse(T_keyframe_current))
        return None if reasons else ConsiderState.from_motion(refined_motion)

    def _bridge_gap(self, view: StereoView, sharpness: float) -> None:
        """Count a refused pair; after several in a row make a keyframe at the predicted pose."""
        if self._gaps.refuse():
            pose = self._independent(self._path.across_gap(view.stamp_ns))
            self._keyframes.restart(self._builder.build(view, pose, sharpness)[0])
            self._gaps.bridge()

    def _independent(self, pose: UncertainTransform) -> ConsiderState:
        return ConsiderState.independent(pose, len(self._calibration.mean_px))

    def _quality(self, reasons: list[str], metrics: dict[str, float]) -> Quality:
        return Quality.from_reasons(reasons, self.covariance_kind, metrics)

    def _output(
        self, stamp_ns: int, inputs: tuple[str, ...], pose: UncertainTransform | None, quality: Quality
    ) -> Output:
        names: dict[str, Any] = {"frame": self._parent, "child": self._child, "producer": self.name}
        return Output.of_pose("pose", pose, stamp_ns=stamp_ns, quality=quality, inputs=inputs, **names)
