# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of point clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.uncertain import UncertainTransform
from cdff_common.types.message import Box, Message
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.pointcloud import Pointcloud, PointCloudData, PointCloudMetadata


def box_of_points(points_m: NDArray[np.floating]) -> Box | None:
    """Box around the finite points of ``(n, 3)``; None where there is none."""
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    if not len(finite):
        return None
    low, high = finite.min(axis=0), finite.max(axis=0)
    return (float(low[0]), float(low[1]), float(low[2]), float(high[0]), float(high[1]), float(high[2]))


def robot_base_of(frame: str) -> str:
    """Frame of the robot that a sensor's frame belongs to: ``mana/lidar`` -> ``mana/base``."""
    robot, slash, _ = frame.partition("/")
    return f"{robot}/base" if slash else "base"


def mounting(
    T_robot_sensor: UncertainTransform | None, T_fixed_robot: UncertainTransform | None, frame: str, stamp_ns: int
) -> tuple[TransformWithCovariance, TransformWithCovariance]:
    """The two poses InFuse's sensor messages carry; unset ones are neutral, without frames."""
    base = robot_base_of(frame)
    unset = TransformWithCovariance()
    make = TransformWithCovariance.from_transform
    return (
        unset if T_robot_sensor is None else make(T_robot_sensor, parent=base, child=frame, stamp_ns=stamp_ns),
        unset if T_fixed_robot is None else make(T_fixed_robot, parent="site", child=base, stamp_ns=stamp_ns),
    )


class PointCloudDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        points: NDArray[np.float64]
        colors: NDArray[np.float64]
        intensity: NDArray[np.int32]

    def _check_together(self) -> None:
        """Colours and intensities are none, or one for each point."""
        for name, array in (("colors", self.colors), ("intensity", self.intensity)):
            if len(array) not in (0, len(self.points)):
                raise InputError(
                    f"PointCloudData.{name}: {len(array)} for {len(self.points)} points, expected 0 or as many"
                )


class PointcloudExt(Message):
    """A cloud in one frame at one time."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: PointCloudMetadata
        data: PointCloudData

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
    ) -> Pointcloud:
        """Cloud of points ``(n, 3)`` in ``frame``, metres.

        Parameters
        ----------
        intensity : array_like of int, shape (n,), optional
        colors : array_like, shape (n, 3), optional
            Red, green, blue.
        T_robot_sensor, T_fixed_robot : UncertainTransform, optional
            Where the sensor sat on the robot (frame ``{robot}/base``), and the robot in ``site``.
        """
        from cdff_common.types.pointcloud import Pointcloud, PointCloudData, PointCloudMetadata

        data = PointCloudData(
            np.asarray(points_m),
            np.zeros((0, 3)) if colors is None else np.asarray(colors),
            np.zeros(0, np.int32) if intensity is None else np.asarray(intensity),
        )
        robot_sensor, fixed_robot = mounting(T_robot_sensor, T_fixed_robot, frame, stamp_ns)
        metadata = PointCloudMetadata(
            sensor_id=sensor,
            frame_id=frame,
            time_stamp=Time.from_ns(stamp_ns),
            height=1,
            width=len(data.points),
            is_registered=T_robot_sensor is not None,
            has_fixed_transform=T_fixed_robot is not None,
            pose_robot_frame_sensor_frame=robot_sensor,
            pose_fixed_frame_robot_frame=fixed_robot,
        )
        return Pointcloud(metadata, data)

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
    def frame(self) -> str:
        """Frame of the points."""
        return self.metadata.frame_id

    @property
    def stamp_ns(self) -> int:
        """Time of capture, nanoseconds."""
        return self.metadata.time_stamp.ns

    @property
    def T_robot_sensor(self) -> UncertainTransform | None:
        """Where the sensor sat on the robot; None where it is not stated."""
        pose = self.metadata.pose_robot_frame_sensor_frame
        return pose.transform if pose.is_set else None

    @property
    def T_fixed_robot(self) -> UncertainTransform | None:
        """Where the robot was in its fixed frame; None where it is not stated."""
        pose = self.metadata.pose_fixed_frame_robot_frame
        return pose.transform if pose.is_set and self.metadata.has_fixed_transform else None

    def extent_m(self) -> Box | None:
        """Box around the finite points in ``frame``."""
        return box_of_points(self.data.points)


class OctreeExt(Message):
    """Occupied leaves."""

    __slots__ = ()
    if TYPE_CHECKING:
        resolution: float
        point_cloud: Pointcloud

    @property
    def stamp_ns(self) -> int:
        """Time of the cloud, nanoseconds."""
        return self.point_cloud.stamp_ns

    def extent_m(self) -> Box | None:
        """Box around the leaves, half a leaf beyond their centres."""
        box = self.point_cloud.extent_m()
        if box is None:
            return None
        h = 0.5 * self.resolution
        return (box[0] - h, box[1] - h, box[2] - h, box[3] + h, box[4] + h, box[5] + h)
