# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pixels of the stereo camera that show the robot: from images, or from the shapes of its URDF."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.urdf import read_urdf
from cdff_common.geometry.urdf_shapes import read_shapes
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.profile import URDF_MASK
from cdff_common.types import FramePair, Joints
from cdff_core.imaging.masks import camera_entry, check_size, decode_mask, eroded
from cdff_core.imaging.shape_projection import silhouettes

#: Half width of the patches of points, which must not contain pixels of the robot.
_PATCH_PX = 8

Masks = tuple[BoolArray | None, BoolArray | None]


class RobotMasks:
    """Masks of the left and the right image, by the sensors of the profile."""

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
        """Set the values of joints; without a mask by the URDF they have no effect."""
        if self._body is not None:
            self._body.set_joints(joints)

    def of_pair(self, pair: FramePair) -> Masks:
        """Return the usable pixels of both images, None where all are.

        Raises InputError if an image has another size, or the mount of the camera is unknown.
        """
        entry = camera_entry(self._sensors, pair.frame)
        if self._body is not None and entry.get("mask") == URDF_MASK:
            return self._body.masks(pair, str(entry["frame"]))
        left, right = (self._images.get(entry.get(side, "")) for side in ("mask", "mask_right"))
        for mask, name in ((left, "left"), (right, "right")):
            check_size(mask, pair.left.image, f"the {name} camera")
        return left, right


class RobotBody:
    """Shapes of the robot's links at the latest values of its joints; a joint without a value is at 0."""

    def __init__(self, context: DfpcContext) -> None:
        self._robot, self._frames = context.robot, context.frames
        self._model, self._shapes = read_urdf(context.urdf), read_shapes(context.urdf)
        self._values: dict[str, float] = {}

    def set_joints(self, joints: Joints) -> None:
        """Set the values of joints; raises InputError for one that is not movable in the URDF."""
        values = {name: state.position for name, state in zip(joints.names, joints.elements, strict=True)}
        movable = {joint.name for joint in self._model.joints if joint.movable}
        if unknown := sorted(set(values) - movable):
            known = ", ".join(sorted(movable)) or "none"
            raise InputError(f"joint {unknown[0]!r} is not movable in the URDF; movable are {known}")
        self._values |= values

    def masks(self, pair: FramePair, camera: str) -> tuple[BoolArray, BoolArray]:
        """Return the pixels of both images that do not show the robot."""
        mount = pair.left.T_robot_sensor
        try:
            mount = mount or self._frames.lookup(f"{self._robot}/base", camera, pair.stamp_ns)
        except FrameNotFoundError as error:
            raise InputError(f"mask by the URDF: {error}") from error
        T_left_base = se3.inverse(mount.matrix)
        shapes = [se3.transform_points(T_left_base, points) for points in self._points_in_base()]
        rows, columns = pair.left.image.shape[:2]
        to_right = np.array([pair.baseline, 0.0, 0.0])
        left, right = (
            eroded(~silhouettes(points, pair.camera_matrix, (rows, columns)), _PATCH_PX)
            for points in (shapes, [p - to_right for p in shapes])
        )
        return left, right

    def _points_in_base(self) -> list[FloatArray]:
        T_base_link = {self._model.root: np.eye(4)}
        for joint in self._model.joints:
            value = self._values.get(joint.name, 0.0)
            if joint.mimic is not None:
                value = joint.mimic[1] * self._values.get(joint.mimic[0], 0.0) + joint.mimic[2]
            T_base_link[joint.child] = T_base_link[joint.parent] @ joint.transform(value)
        return [se3.transform_points(T_base_link[s.link], s.points_m) for s in self._shapes]
