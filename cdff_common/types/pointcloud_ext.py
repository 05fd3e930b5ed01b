# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of point clouds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.geometry.uncertain_transform import UncertainTransform
from cdff_common.types.message import Box, Message


def robot_base_of(frame: str) -> str:
    """Return the base frame of the robot of a sensor frame: ``mana/lidar`` -> ``mana/base``."""
    robot, slash, _ = frame.partition("/")
    return f"{robot}/base" if slash else "base"


def mounting(
    T_robot_sensor: UncertainTransform | None,
    T_fixed_robot: UncertainTransform | None,
    frame: str,
    stamp_ns: int,
) -> tuple[types.TransformWithCovariance, types.TransformWithCovariance]:
    """Return the two mounting poses of InFuse sensor messages; unknown ones are neutral, without frames."""
    base = robot_base_of(frame)
    unset = types.TransformWithCovariance()
    make = types.TransformWithCovariance.from_transform
    return (
        unset
        if T_robot_sensor is None
        else make(T_robot_sensor, parent=base, child=frame, stamp_ns=stamp_ns),
        unset if T_fixed_robot is None else make(T_fixed_robot, parent="site", child=base, stamp_ns=stamp_ns),
    )


class PointcloudExt(Message):
    """Point cloud in one frame at one time."""

    __slots__ = ()
    metadata: types.PointCloudMetadata
    data: types.PointCloudData

    @classmethod
    def from_points(
        cls,
        points_m: ArrayLike,
        *,
        frame: str,
        stamp_ns: int,
        intensity: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        sensor: str = "",
        T_robot_sensor: UncertainTransform | None = None,
        T_fixed_robot: UncertainTransform | None = None,
    ) -> types.Pointcloud:
        """Return the cloud of points ``(n, 3)`` in ``frame``, metres.

        Parameters
        ----------
        intensity : array_like of int, shape (n,), optional
        colors : array_like, shape (n, 3), optional
            Red, green, blue.
        T_robot_sensor, T_fixed_robot : UncertainTransform, optional
            Poses of the sensor on the robot (frame ``{robot}/base``), and of the robot in ``site``.
        """
        data = types.PointCloudData(
            np.asarray(points_m),
            np.zeros((0, 3)) if colors is None else np.asarray(colors),
            np.zeros(0, np.int32) if intensity is None else np.asarray(intensity),
        )
        robot_sensor, fixed_robot = mounting(T_robot_sensor, T_fixed_robot, frame, stamp_ns)
        metadata = types.PointCloudMetadata(
            sensor_id=sensor,
            frame_id=frame,
            time_stamp=types.Time.from_ns(stamp_ns),
            height=1,
            width=len(data.points),
            is_registered=T_robot_sensor is not None,
            has_fixed_transform=T_fixed_robot is not None,
            pose_robot_frame_sensor_frame=robot_sensor,
            pose_fixed_frame_robot_frame=fixed_robot,
        )
        return types.Pointcloud(metadata, data)

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Points ``(n, 3)`` in ``frame``, metres."""
        return self.data.points

    @property
    def intensity(self) -> NDArray[np.int32] | None:
        """Intensities ``(n,)``; None where the cloud has none."""
        return self.data.intensity if len(self.data.intensity) or not len(self.data.points) else None

    @property
    def colors(self) -> NDArray[np.float64] | None:
        """Colours ``(n, 3)`` red, green, blue; None where the cloud has none."""
        return self.data.colors if len(self.data.colors) or not len(self.data.points) else None

    @property
    def T_robot_sensor(self) -> UncertainTransform | None:
        """Pose of the sensor on the robot; None if unknown."""
        pose = self.metadata.pose_robot_frame_sensor_frame
        return pose.transform if pose.is_set else None

    @property
    def T_fixed_robot(self) -> UncertainTransform | None:
        """Pose of the robot in its fixed frame; None if unknown."""
        pose = self.metadata.pose_fixed_frame_robot_frame
        return pose.transform if pose.is_set and self.metadata.has_fixed_transform else None


class OctreeExt(Message):
    """Occupied leaves."""

    __slots__ = ()
    resolution: float
    point_cloud: types.Pointcloud

    @property
    def stamp_ns(self) -> int:
        """Time of the cloud, nanoseconds."""
        return self.point_cloud.stamp_ns

    def extent_m(self) -> Box | None:
        """Return the box of the leaves."""
        box = self.point_cloud.extent_m()
        if box is None:
            return None
        h = 0.5 * self.resolution
        return (box[0] - h, box[1] - h, box[2] - h, box[3] + h, box[4] + h, box[5] + h)
