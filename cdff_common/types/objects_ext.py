# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of detections and tracks of objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns, pack_poses, pack_squares, stamps_us, unpack_poses
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.pose_ext import box_of_boxes
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.objects import (
        ObjectDetection,
        ObjectTrack,
        ObjectTrackData,
        ObjectTrackMetadata,
        ObjectTrackStatusT,
    )
    from cdff_common.types.pose import TransformWithCovariance


class ObjectDetectionExt(Message):
    """One object in one measurement."""

    __slots__ = ()
    if TYPE_CHECKING:
        pose: TransformWithCovariance

    def extent_m(self) -> Box | None:
        """The object's origin in the sensor's frame; None where only the image is known."""
        return self.pose.extent_m() if self.pose.is_set else None


class ObjectDetectionsExt(Message):
    """All objects of one measurement."""

    __slots__ = ()
    if TYPE_CHECKING:
        time_stamp: Time
        detections: tuple[ObjectDetection, ...]

    @property
    def stamp_ns(self) -> int:
        """Time of capture, nanoseconds."""
        return self.time_stamp.ns

    def extent_m(self) -> Box | None:
        """Box around the objects' origins."""
        return box_of_boxes(d.extent_m() for d in self.detections)


class ObjectTrackDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        stamps: NDArray[np.int64]
        poses: NDArray[np.float64]
        velocities: NDArray[np.float64]
        covariances: NDArray[np.float64]

    def _check_together(self) -> None:
        """One pose for each stamp, rising stamps; velocities and covariances none, or one each."""
        optional = {"velocities": self.velocities, "covariances": self.covariances}
        check_columns("ObjectTrackData", len(self.stamps), {"poses": self.poses}, optional)
        if not (np.diff(self.stamps) > 0).all():
            raise InputError("ObjectTrackData.stamps: expected rising stamps")


class ObjectTrackExt(Message):
    """One object over time in one frame."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: ObjectTrackMetadata
        data: ObjectTrackData

    @classmethod
    def from_arrays(
        cls,
        track_id: int,
        stamps_ns: ArrayLike,
        matrices: ArrayLike,
        *,
        frame: str,
        label: str = "",
        status: ObjectTrackStatusT | int = 0,
        score: float = 0.0,
        velocities: ArrayLike | None = None,
        covariances: ArrayLike | None = None,
        size_m: ArrayLike = (0.0, 0.0, 0.0),
        producer: str = "",
    ) -> ObjectTrack:
        """Track of ``T_frame_object``.

        Parameters
        ----------
        stamps_ns : array_like of int, shape (n,)
            Rising, multiples of 1000.
        matrices : array_like, shape (n, 4, 4)
        velocities : array_like, shape (n, 6), optional
            m/s and rad/s, in ``frame``.
        covariances : array_like, shape (n, 6, 6), optional
            Of the poses: x y z rx ry rz, in ``frame``.
        size_m : array_like, shape (3,)
            Along the object's axes; 0 where unknown.
        """
        from cdff_common.types.objects import ObjectTrack, ObjectTrackData, ObjectTrackMetadata

        stamps = stamps_us(stamps_ns, "ObjectTrack stamps")
        data = ObjectTrackData(
            stamps,
            pack_poses(matrices, "ObjectTrack"),
            np.zeros((0, 6)) if velocities is None else np.asarray(velocities),
            pack_squares(covariances, len(stamps), 6, "ObjectTrack covariances"),
        )
        newest = Time(int(stamps[-1])) if stamps.size else Time()
        metadata = ObjectTrackMetadata(
            time_stamp=newest, producer_id=producer, frame_id=frame, track_id=track_id, label=label,
            status=status, score=score, size=np.asarray(size_m),  # type: ignore[arg-type]  # a number is taken too
        )  # fmt: skip
        return ObjectTrack(metadata, data)

    @property
    def frame(self) -> str:
        """Frame in which the object moves."""
        return self.metadata.frame_id

    @property
    def stamp_ns(self) -> int:
        """Time of the newest state, nanoseconds."""
        return self.metadata.time_stamp.ns

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times ``(n,)``, nanoseconds."""
        return self.data.stamps * 1000

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_object (n, 4, 4)``."""
        return unpack_poses(self.data.poses, "ObjectTrack")

    def extent_m(self) -> Box | None:
        """Box around the positions."""
        return box_of_points(self.data.poses[:, :3])
