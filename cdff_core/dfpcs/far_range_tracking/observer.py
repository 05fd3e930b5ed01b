# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude and position of the camera at each image.

The attitude is given, or continued from the last one by the rotation between two registered images.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import FrameNotFoundError
from cdff_common.geometry import FrameGraph, OdometryBuffer, UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_core.bearing_tracking import wahba
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.bearing_tracking.track_output import Axes
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig

#: Time for which poses are stored, and time over which the newest one is extrapolated, nanoseconds.
_MEMORY_NS, _AHEAD_NS = 10_000_000_000, 300_000_000
#: Growth of the variance of an attitude that registration continues, rad² per image.
_DRIFT_RAD2 = (2.0e-4) ** 2
#: Number of rays along each axis of the image from which a rotation is computed.
_GRID = 5
_NO_STARS = np.zeros(0, bool)


@dataclass(frozen=True, slots=True, eq=False)
class Observer:
    """Camera at an image.

    Attributes
    ----------
    attitude : CameraAttitude
        Rotation from the camera to the frame; ``bias_rad`` is its error that is the same in many images.
    frame : str
        Frame of directions and positions; that of the camera without an attitude.
    axes : str
        Axes of the frame.
    position_m : ndarray (3,) or None
    position_covariance : ndarray (3, 3)
    has_origin : bool
        True if the frame has an origin of its own, in which the camera has a position.
    is_given : bool
        False if the rotation is that of the registration.
    reasons : tuple of str
    inputs : tuple of str
        Ids of the samples.
    """

    attitude: CameraAttitude
    frame: str
    axes: Axes
    position_m: FloatArray | None
    position_covariance: FloatArray
    is_given: bool
    has_origin: bool = False
    reasons: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()

    @property
    def rotation(self) -> FloatArray:
        """Rotation from the camera to axes that do not rotate, shape (3, 3)."""
        assert self.attitude.rotation is not None  # every observer has one
        return self.attitude.rotation

    @property
    def is_camera(self) -> bool:
        """True if directions are published in the camera frame."""
        return self.axes == "camera"


class ObserverTrack:
    """Attitude and position of the camera.

    Parameters
    ----------
    frames : FrameGraph
        Mounts of the sensors, and the pose of the site frame.

    Attributes
    ----------
    reasons : tuple of str
        Inputs that the last call of ``at`` could not use.
    """

    def __init__(self, config: FarRangeTrackingConfig, frames: FrameGraph) -> None:
        self._config, self._frames = config, frames
        self._poses = OdometryBuffer(_MEMORY_NS, _AHEAD_NS)
        self._pose_names: tuple[str, str] | None = None
        self._attitude: Sample | None = None
        self._pose_id = ""
        self.reasons: tuple[str, ...] = ()

    def give_attitude(self, sample: Sample) -> None:
        """Store an attitude for the image of its time."""
        self._attitude = sample

    def give_pose(self, sample: Sample) -> None:
        """Store a pose; poses of another pair of frames are removed first."""
        names = (
            sample.value.parent_frame or sample.frame,
            sample.value.child_frame or sample.child,
        )
        if names != self._pose_names:
            self._poses.clear()
            self._pose_names = names
        self._poses.insert(sample.stamp_ns, sample.value.transform)
        self._pose_id = sample.id

    def at(self, stamp_ns: int, camera_frame: str) -> Observer | None:
        """Return the observer from the pose, or else from the attitude; None if neither is known at this
        time.
        """
        self.reasons = ()
        return self._by_pose(stamp_ns, camera_frame) or self._by_attitude(stamp_ns, camera_frame)

    def _by_pose(self, stamp_ns: int, camera_frame: str) -> Observer | None:
        """Return the observer from the pose at a time, in the site frame if it is known; None without a
        pose.
        """
        pose = self._poses.pose(stamp_ns)
        if pose is None or self._pose_names is None:
            return None
        frame, child = self._pose_names
        try:
            if child != camera_frame:
                pose = pose @ self._frames.lookup(child, camera_frame, stamp_ns)
        except FrameNotFoundError:
            self.reasons += ("mount_of_pose_unknown",)
            return None
        if frame != "site":
            with suppress(FrameNotFoundError):
                pose, frame = self._frames.lookup("site", frame, stamp_ns) @ pose, "site"
        return self._observer(pose, frame, has_position=True, inputs=(self._pose_id,))

    def _by_attitude(self, stamp_ns: int, camera_frame: str) -> Observer | None:
        """Return the observer from the newest attitude; None if it is too old or its mount unknown."""
        attitude_sample = self._attitude
        if (
            attitude_sample is None
            or abs(stamp_ns - attitude_sample.stamp_ns) > self._config.attitude_age_s * 1e9
        ):
            return None
        frame = attitude_sample.value.parent_frame or attitude_sample.frame or "inertial"
        child = attitude_sample.value.child_frame or attitude_sample.child or camera_frame
        pose = attitude_sample.value.transform
        try:
            if child != camera_frame:
                pose = pose @ self._frames.lookup(child, camera_frame, stamp_ns)
        except FrameNotFoundError:
            self.reasons += ("mount_of_attitude_unknown",)
            return None
        return self._observer(pose, frame, has_position=False, inputs=(attitude_sample.id,))

    def _observer(
        self, pose: UncertainTransform, frame: str, *, has_position: bool, inputs: tuple[str, ...]
    ) -> Observer:
        """Return the observer at a pose; a missing covariance is replaced by the configured one, with a
        reason.
        """
        noise = np.eye(3) * self._config.attitude_noise_rad**2
        reasons: tuple[str, ...] = ()
        position_covariance = np.zeros((3, 3))
        if pose.covariance is None:
            bias = np.radians(self._config.attitude_sigma_deg)
            reasons = ("attitude_covariance_unknown",)
        else:
            bias = float(np.sqrt(np.trace(pose.covariance[3:, 3:]) / 3.0))
            position_covariance = pose.covariance[:3, :3]
        attitude = CameraAttitude(pose.matrix[:3, :3], noise, _NO_STARS, inputs=inputs, bias_rad=bias)
        position = np.array(pose.matrix[:3, 3]) if has_position else None
        return Observer(
            attitude,
            frame,
            "z_up",
            position,
            position_covariance,
            is_given=True,
            has_origin=has_position,
            reasons=reasons,
            inputs=inputs,
        )

    def start(self, camera_frame: str) -> Observer:
        """Return a camera whose attitude at the first image is the identity."""
        attitude = CameraAttitude(np.eye(3), np.zeros((3, 3)), _NO_STARS)
        return Observer(attitude, camera_frame, "camera", None, np.zeros((3, 3)), False)


def continue_attitude(previous: Observer, homography: FloatArray | None, camera: CameraModel) -> Observer:
    """Return the observer after the camera rotation that a homography from the previous image contains.

    If the homography is None, the rotation is unknown: it is assumed to be zero, and the variance grows.
    """
    R_current_previous = np.eye(3)
    if homography is not None:
        R_current_previous = _rotation_of(homography, camera)
    previous_attitude = previous.attitude
    has_turned = homography is None or not np.allclose(homography, np.eye(3))
    drift = _DRIFT_RAD2 if has_turned else 0.0
    attitude = replace(
        previous_attitude,
        rotation=previous.rotation @ R_current_previous.T,
        covariance=np.eye(3) * _DRIFT_RAD2,
        bias_rad=float(np.sqrt(previous_attitude.bias_rad**2 + drift)),
        inputs=(),
    )
    reasons = () if previous.is_camera else ("attitude_from_images",)
    # The registration does not measure the translation: the position is not known any more.
    return replace(previous, attitude=attitude, is_given=False, reasons=reasons, inputs=(), position_m=None)


def _rotation_of(homography: FloatArray, camera: CameraModel) -> FloatArray:
    """Return the rotation that maps the rays of a grid of pixels to the rays of the pixels moved by a
    homography.
    """
    u, v = np.meshgrid(np.linspace(0.0, camera.cols - 1.0, _GRID), np.linspace(0.0, camera.rows - 1.0, _GRID))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    transformed_pixels = np.column_stack([pixels, np.ones(len(pixels))]) @ homography.T
    before, after = camera.rays(pixels), camera.rays(transformed_pixels[:, :2] / transformed_pixels[:, 2:])
    has_rays = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    return wahba.rotation(before[has_rays], after[has_rays], np.ones(int(has_rays.sum())))


def rotation_homography(previous: Observer, current: Observer, camera: CameraModel) -> FloatArray:
    """Return the homography of pixels of a camera that rotates."""
    K = camera.matrix
    R = current.rotation.T @ previous.rotation
    return np.asarray(K @ R @ np.linalg.inv(K))
