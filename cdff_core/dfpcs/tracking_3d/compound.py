# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of Tracking3D: collect poses, fit the motion, publish state, motion and prediction."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError, ProductNotFoundError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import BodyMotion, BodyMotionKindT, ObjectTrack, Time, TransformWithCovariance
from cdff_core.dfns.body_motion_estimation.interface import BodyMotionEstimationInputs as Inputs
from cdff_core.dfns.body_motion_estimation.interface import BodyMotionEstimationOutputs as Motion
from cdff_core.dfpcs.tracking_3d.configuration import Tracking3DConfig
from cdff_core.dfpcs.tracking_3d.interface import Tracking3DInterface
from cdff_core.rigid_body.orbital_point import OrbitalAxesHistory, resting_motion
from cdff_core.rigid_body.sensor_attitude import SensorAttitude

#: Greatest number of states of one prediction.
_MAX_STATES = 10_000
#: Greatest number of poses listed as inputs of a product.
_MAX_INPUTS = 256
#: Last components of the names of frames that do not rotate with a robot.
_FIXED_FRAMES = ("inertial", "icrf", "site", "world", "odom", "map", "reference")


class Tracking3D(Tracking3DInterface):
    """Motion of a body without forces, from its poses."""

    Config = Tracking3DConfig
    config: Tracking3DConfig

    def setup(self) -> None:
        """Clear the poses, offer the store item."""
        self._attitude = SensorAttitude(self.context.frames, self.config.attitude_age_s)
        self._orbit = OrbitalAxesHistory()
        self._clear()
        self.store.offer("motion", lambda: self._motion)

    def _clear(self) -> None:
        """Create the DFN, clear poses and motion."""
        self._estimation = self.dfn("estimation")
        self._poses: deque[Sample] = deque(maxlen=self.config.max_poses)
        self._new_poses = 0  # since the last fit
        self._epoch_ns = 0  # time of the first pose
        self._motion: BodyMotion | None = None
        # Position of the point in orbital axes relative to which the last fit describes the motion.
        self._orbital_point_m: FloatArray | None = None

    def on_navigation(self, sample: Sample) -> Iterable[Output]:
        """Store the state of the carrier of the sensor."""
        self._orbit.give(sample)
        return ()

    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Store the attitude; with the first one, clear the poses in axes that may rotate."""
        is_first = not self._attitude.is_given
        self._attitude.give(sample)
        if is_first and self._poses and self._may_rotate:
            self._clear()
        return ()

    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Add the pose; publish the state, and motion and prediction after a new fit."""
        try:
            sample = self._without_rotation(sample)
            self._check(sample)
            if not self._poses:
                self._epoch_ns = sample.stamp_ns
            self._poses.append(sample)
            self._new_poses += 1
            needs_fit = self._new_poses >= self.config.refit_growth * len(self._poses)
            yield from self._publish(is_fitted=not needs_fit)
        except (InputError, RefusedError) as error:
            yield self._output("track", None, Quality.from_error(error), sample)

    def finish(self) -> Iterable[Output]:
        """Fit to all poses; publish motion and prediction."""
        if self._new_poses == 0 or self._motion is None:
            return []
        outputs = self._publish(is_fitted=False)
        return [output for output in outputs if output.port != "track"]

    def predict(self, t_ns: int) -> TransformWithCovariance:
        """Return the pose at a time; raises InputError before the newest pose."""
        self.get_motion()
        motion = self._estimate([t_ns], is_fitted=True)
        newest = self._poses[-1].value
        return TransformWithCovariance.from_transform(
            UncertainTransform(motion.poses[0], motion.covariances[0]),
            parent=newest.parent_frame,
            child=newest.child_frame,
            stamp_ns=t_ns,
            producer=self.name,
        )

    def predict_point(self, x_m: float, y_m: float, z_m: float, t_ns: int) -> ObjectTrack:
        """Return the motion of a point of the body; raises as `predict`, InputError for too long times."""
        self.get_motion()
        stamps_ns = self._stamps_ns(t_ns)
        motion = self._estimate(stamps_ns, is_fitted=True)
        arms = motion.poses[:, :3, :3] @ np.array([x_m, y_m, z_m])
        to_point = np.repeat(np.eye(6)[None], len(arms), axis=0)
        to_point[:, :3, 3:] = -se3.skew(arms)
        poses = motion.poses.copy()
        poses[:, :3, 3] += arms
        return ObjectTrack.from_arrays(
            1,
            stamps_ns,
            poses,
            frame=self._poses[-1].value.parent_frame,
            label=self._poses[-1].value.child_frame,
            velocities=(to_point @ motion.velocities[:, :, None])[:, :, 0],
            covariances=to_point @ motion.covariances @ np.swapaxes(to_point, 1, 2),
            velocity_covariances=to_point @ motion.velocity_covariances @ np.swapaxes(to_point, 1, 2),
            producer=self.name,
        )

    def get_motion(self) -> BodyMotion:
        """Return the last motion; raises ProductNotFoundError before the first fit."""
        if self._motion is None:
            raise ProductNotFoundError(f"{self.name}: {len(self._poses)} poses, no motion was fitted yet")
        return self._motion

    def _without_rotation(self, sample: Sample) -> Sample:
        """Return the pose in inertial axes with the origin of the sensor, if attitudes are given and its
        frame may rotate; raises RefusedError without an attitude at its time.
        """
        pose = sample.value
        if pose is None or not self._attitude.is_given or not _may_rotate(pose.parent_frame):
            return sample
        attitude = self._attitude.at(sample.stamp_ns, pose.parent_frame)
        rotated = TransformWithCovariance.from_transform(
            attitude.rotated(pose.transform),
            parent=attitude.frame,
            child=pose.child_frame,
            stamp_ns=sample.stamp_ns,
            producer=pose.metadata.producer_id,
        )
        return replace(sample, value=rotated)

    @property
    def _may_rotate(self) -> bool:
        """True if the stored poses are in a frame that may rotate, such as that of a sensor."""
        return _may_rotate(self._poses[-1].value.parent_frame)

    def _check(self, sample: Sample) -> None:
        """Raise InputError if the pose cannot continue the track."""
        pose = sample.value
        if pose is None:
            raise InputError(f"{self.name}: pose FAILED: {', '.join(sample.quality.reasons)}")
        if "coasting" in sample.quality.reasons:
            raise RefusedError(f"{self.name}: pose is a prediction of its tracker", ["pose_is_predicted"])
        if not self._poses:
            return
        newest = self._poses[-1]
        frames, expected = ((value.parent_frame, value.child_frame) for value in (pose, newest.value))
        if frames != expected:
            raise InputError(f"{self.name}: pose of frames {frames}, expected {expected}")
        if sample.stamp_ns <= newest.stamp_ns:
            raise InputError(
                f"{self.name}: pose at {sample.stamp_ns} ns, expected after {newest.stamp_ns} ns"
            )

    def _publish(self, *, is_fitted: bool) -> Iterable[Output]:
        """Yield the current track and, unless it is only fitted, body motion and prediction."""
        newest = self._poses[-1]
        later_ns = self._stamps_ns(newest.stamp_ns + round(1e9 * self.config.horizon_s))
        motion = self._estimate(later_ns[:1] if is_fitted else later_ns, is_fitted=is_fitted)
        quality = self._quality(motion, is_prediction=False)
        yield self._output("track", self._track(motion, later_ns[:1]), quality, newest)
        if is_fitted:
            return
        self._new_poses = 0
        self._motion = self._body_motion(motion)
        quality = self._quality(motion, is_prediction=True)
        yield self._output("motion", self._motion, quality, newest)
        yield self._output("prediction", self._track(motion, later_ns), quality, newest)

    def _estimate(self, queries_ns: Iterable[int] | IntArray, *, is_fitted: bool) -> Motion:
        """Return the motion at times, with the fit to the stored poses or the last one."""
        epoch_ns = self._epoch_ns
        covariances = [sample.value.transform.covariance for sample in self._poses]
        is_known = all(c is not None and np.linalg.matrix_rank(c) == 6 for c in covariances)
        n = len(self._poses)
        stamps_ns = np.array([sample.stamp_ns for sample in self._poses])
        queries_ns = np.asarray(queries_ns, dtype=np.int64)
        poses = np.stack([sample.value.transform.matrix for sample in self._poses])
        axes = None if self._may_rotate else self._orbit.at(np.append(stamps_ns, queries_ns))
        # A fit relative to a point in orbital axes is of no use without these axes.
        is_fitted = is_fitted and (axes is not None or self._orbital_point_m is None)
        point_m = self._orbital_point_m
        if not is_fitted:
            point_m = None if axes is None else axes[n - 1].rotation.T @ poses[-1, :3, 3]
        moved_m, moved_mps = np.zeros((2, n + len(queries_ns), 3))
        if axes is not None and point_m is not None:
            moved_m, moved_mps = resting_motion(axes, point_m)
        poses[:, :3, 3] -= moved_m[:n]
        inputs = Inputs(
            times_s=1e-9 * (stamps_ns - epoch_ns),
            poses=poses,
            covariances=np.stack(covariances) if is_known else np.repeat(np.eye(6)[None], n, axis=0),
            is_noise_known=is_known,
            queries_s=np.asarray(1e-9 * (queries_ns - epoch_ns)),
            is_fitted=is_fitted,
        )
        motion: Motion = self._estimation.process(inputs)
        self._orbital_point_m = point_m
        poses, velocities = motion.poses.copy(), motion.velocities.copy()
        poses[:, :3, 3] += moved_m[n:]
        velocities[:, :3] += moved_mps[n:]
        return replace(motion, poses=poses, velocities=velocities)

    def _stamps_ns(self, end_ns: int) -> IntArray:
        """Return the times from the newest pose to the end in steps of the configuration."""
        start_ns, step_ns = self._poses[-1].stamp_ns, 1000 * round(1e6 * self.config.step_s)
        count = (end_ns - start_ns) // step_ns + 1
        if not 1 <= count <= _MAX_STATES:
            raise InputError(
                f"{self.name}: prediction until {end_ns} ns has {count} states, expected 1 to {_MAX_STATES}"
            )
        return np.asarray(start_ns + step_ns * np.arange(count))

    def _quality(self, motion: Motion, *, is_prediction: bool) -> Quality:
        """Return the quality of an estimated motion: of the state at the newest pose, or of predictions."""
        config, n = self.config, len(self._poses)
        reasons = ["attitude_missing"] if self._may_rotate else []
        if motion.may_tumble and motion.axis is not None and is_prediction:
            reasons.append("tumble_undetermined")
        if motion.increment_rad > config.max_increment_rad:
            reasons.append(f"ambiguous_rotation:{motion.increment_rad:.2f}")
        if motion.noise_factor > config.max_noise_factor:
            reasons.append(f"noise_factor:{motion.noise_factor:.1f}")
        if motion.outliers > config.max_outlier_ratio * n:
            reasons.append(f"outliers:{motion.outliers}")
        status = Status.DEGRADED if reasons else Status.OK
        if motion.axis is None:
            reasons.append("rotation_unobservable")
        if motion.moment_ratios is None:
            reasons.append("inertia_unobservable")
        metrics = {"poses": n, "outliers": motion.outliers, "noise_factor": motion.noise_factor}
        return Quality(status, tuple(reasons), metrics=metrics, covariance_kind=self.covariance_kind)

    def _track(self, motion: Motion, stamps_ns: IntArray) -> ObjectTrack:
        """Return the states of a motion at the stamps, with which its states begin."""
        newest, n = self._poses[-1].value, len(stamps_ns)
        return ObjectTrack.from_arrays(
            1,
            stamps_ns,
            motion.poses[:n],
            frame=newest.parent_frame,
            label=newest.child_frame,
            status=1,
            score=1.0,
            velocities=motion.velocities[:n],
            covariances=motion.covariances[:n],
            velocity_covariances=motion.velocity_covariances[:n],
            producer=self.name,
        )

    def _body_motion(self, motion: Motion) -> BodyMotion:
        """Return the motion as a product; unobservable quantities are zero or NaN."""
        kind = BodyMotionKindT.MOTION_TUMBLING if motion.is_tumbling else BodyMotionKindT.MOTION_STEADY
        ratios, newest = motion.moment_ratios, self._poses[-1]
        return BodyMotion(
            time_stamp=Time.from_ns(newest.stamp_ns),
            producer_id=self.name,
            frame_id=newest.value.parent_frame,
            body_frame_id=newest.value.child_frame,
            kind=BodyMotionKindT.MOTION_RESTING if motion.axis is None else kind,
            axis=np.zeros(3) if motion.axis is None else motion.axis,
            axis_sigma=motion.axis_sigma_rad,
            rate=motion.rate_rad_s,
            rate_sigma=motion.rate_sigma_rad_s,
            centre=motion.centre_m,
            cov_centre=motion.centre_covariance,
            unobservable=motion.unobservable,
            moment_ratios=np.zeros(2) if ratios is None else ratios,
            cov_moment_ratios=_or_nan(motion.moment_ratios_covariance, 2),
            principal_axes=np.zeros((3, 3)) if motion.principal_axes is None else motion.principal_axes,
        )

    def _output(self, port: str, value: object, quality: Quality, newest: Sample) -> Output:
        inputs = tuple(sample.id for sample in list(self._poses)[-_MAX_INPUTS:]) or (newest.id,)
        first_ns = self._poses[0].stamp_ns if self._poses and value is not None else newest.stamp_ns
        frame = newest.value.parent_frame if newest.value is not None else newest.frame
        return Output(port, value, first_ns, newest.stamp_ns, frame, None, quality, inputs)


def _may_rotate(frame: str) -> bool:
    """Return whether a frame may rotate with a robot, as the frame of a sensor does."""
    return frame.rsplit("/", 1)[-1] not in _FIXED_FRAMES


def _or_nan(covariance: FloatArray | None, size: int) -> FloatArray:
    """Return a covariance, NaN if it is absent."""
    return np.full((size, size), np.nan) if covariance is None else covariance
