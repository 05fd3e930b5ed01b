# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masks of the pixels that show the robot, from images or from the shapes of its URDF."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.urdf import read_urdf
from cdff_common.geometry.urdf_shapes import read_shapes
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.sensor_profile import URDF_MASK
from cdff_common.types import FramePair, Joints
from cdff_core.imaging.masks import camera_entry, check_size, decode_mask, eroded
from cdff_core.imaging.shape_projection import silhouettes

#: Half width of the patch around a point, which must not contain pixels of the robot.
_PATCH_PX = 8

#: Usable pixels (rows, cols) of the left and the right image; None if all are usable.
Masks = tuple[BoolArray | None, BoolArray | None]


class RobotMasks:
    """Masks of stereo pairs, as the sensors of the profile state them."""

    def __init__(self, context: DfpcContext) -> None:
        self._sensors = context.sensors
        texts = {
            text: name
            for name, entry in context.sensors.items()
            for text in (entry.get("mask", ""), entry.get("mask_right", ""))
            if text
        }
        self._images: dict[str, BoolArray] = {
            text: eroded(decode_mask(text, f"sensor {name}"), _PATCH_PX)
            for text, name in texts.items()
            if text != URDF_MASK
        }
        self._body = RobotBody(context) if URDF_MASK in texts else None

    def set_joints(self, joints: Joints) -> None:
        """Set the positions of joints; they only affect masks computed from the URDF."""
        if self._body is not None:
            self._body.set_joints(joints)

    def of_pair(self, pair: FramePair) -> Masks:
        """Return the pixels of both images that do not show the robot, with a margin.

        Raises InputError if the sizes of mask and image differ, or if the mount of the camera is unknown.
        """
        entry = camera_entry(self._sensors, pair.frame)
        if self._body is not None and entry.get("mask") == URDF_MASK:
            return self._body.masks(pair, str(entry["frame"]))
        left, right = (self._images.get(entry.get(side, "")) for side in ("mask", "mask_right"))
        for mask, name in ((left, "left"), (right, "right")):
            check_size(mask, pair.left.image, f"the {name} camera")
        return left, right


class RobotBody:
    """Shapes of the robot's links at the latest joint positions; a joint without a position is at 0."""

    def __init__(self, context: DfpcContext) -> None:
        self._robot, self._frames = context.robot, context.frames
        self._model, self._shapes = read_urdf(context.urdf), read_shapes(context.urdf)
        self._values: dict[str, float] = {}

    def set_joints(self, joints: Joints) -> None:
        """Set the positions of joints, rad or m; raises InputError for a joint that is not movable."""
        values = {name: state.position for name, state in zip(joints.names, joints.elements, strict=True)}
        movable = {joint.name for joint in self._model.joints if joint.movable}
        if unknown := sorted(set(values) - movable):
            movable_names = ", ".join(sorted(movable)) or "none"
            raise InputError(f"joint {unknown[0]!r} is not movable in the URDF; movable are {movable_names}")
        self._values |= values

    def masks(self, pair: FramePair, camera: str) -> tuple[BoolArray, BoolArray]:
        """Return the usable pixels of both images; ``camera`` is the frame of the left camera."""
        mount = pair.left.T_robot_sensor
        try:
            mount = mount or self._frames.lookup(f"{self._robot}/base", camera, pair.stamp_ns)
        except FrameNotFoundError as error:
            raise InputError(f"mask by the URDF: {error}") from error
        T_left_base = se3.inverse(mount.matrix)
        shapes = [se3.transform_points(T_left_base, points) for points in self._points_in_base()]
        rows, columns = pair.left.image.shape[:2]
        left_to_right_m = np.array([pair.baseline, 0.0, 0.0])
        left, right = (
            eroded(~silhouettes(points, pair.camera_matrix, (rows, columns)), _PATCH_PX)
            for points in (shapes, [points - left_to_right_m for points in shapes])
        )
        return left, right

    def _points_in_base(self) -> list[FloatArray]:
        """Return the points (n, 3) of each shape in the base frame, metres."""
        T_base_link = {self._model.root: np.eye(4)}
        for joint in self._model.joints:
            value = self._values.get(joint.name, 0.0)
            if joint.mimic is not None:
                value = joint.mimic[1] * self._values.get(joint.mimic[0], 0.0) + joint.mimic[2]
            T_base_link[joint.child] = T_base_link[joint.parent] @ joint.transform(value)
        return [se3.transform_points(T_base_link[s.link], s.points_m) for s in self._shapes]
