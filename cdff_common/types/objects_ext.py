# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of detections and tracks of objects."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.types.columns import pack_poses, pack_squares, stamps_us, unpack_poses
from cdff_common.types.message import Box, Message


class ObjectDetectionExt(Message):
    """Detection of one object in one measurement."""

    __slots__ = ()
    pose: types.TransformWithCovariance
    symmetric_poses: NDArray[np.float64]

    @classmethod
    def from_pose(
        cls,
        label: str,
        score: float,
        pose: types.TransformWithCovariance,
        *,
        size_m: ArrayLike = (0.0, 0.0, 0.0),
        symmetric: ArrayLike = (),
    ) -> types.ObjectDetection:
        """Return the detection of an object.

        Parameters
        ----------
        label : str
        score : float
            0 to 1.
        pose : TransformWithCovariance
            T_sensor_object.
        size_m : array_like, shape (3,)
            Size along the object's axes; 0 if unknown.
        symmetric : array_like, shape (n, 4, 4)
            T_sensor_object of the poses that the symmetry of the object makes equivalent.
        """
        equivalent = np.asarray(symmetric, np.float64).reshape(-1, 4, 4)
        return types.ObjectDetection(
            label=label,
            score=score,
            pose=pose,
            size=np.asarray(size_m, np.float64),
            symmetric_poses=pack_poses(equivalent, "ObjectDetection"),
        )

    @property
    def symmetric_matrices(self) -> NDArray[np.float64]:
        """``T_sensor_object (n, 4, 4)`` of the poses that the symmetry of the object makes equivalent."""
        return unpack_poses(self.symmetric_poses, "ObjectDetection")

    def extent_m(self) -> Box | None:
        """Return the object's origin in the sensor frame; None if only the image box is known."""
        return self.pose.extent_m() if self.pose.is_set else None


class ObjectTrackExt(Message):
    """Track of one object in one frame."""

    __slots__ = ()
    metadata: types.ObjectTrackMetadata
    data: types.ObjectTrackData

    @classmethod
    def from_arrays(
        cls,
        track_id: int,
        stamps_ns: ArrayLike,
        matrices: ArrayLike,
        *,
        frame: str,
        label: str = "",
        status: types.ObjectTrackStatusT | int = 0,
        score: float = 0.0,
        velocities: ArrayLike | None = None,
        covariances: ArrayLike | None = None,
        velocity_covariances: ArrayLike | None = None,
        size_m: ArrayLike = (0.0, 0.0, 0.0),
        producer: str = "",
    ) -> types.ObjectTrack:
        """Return the track of ``T_frame_object``.

        Parameters
        ----------
        stamps_ns : array_like of int, shape (n,)
            Ascending, multiples of 1000.
        matrices : array_like, shape (n, 4, 4)
        velocities : array_like, shape (n, 6), optional
            m/s and rad/s, in ``frame``.
        covariances : array_like, shape (n, 6, 6), optional
            Covariances of the poses: x y z rx ry rz, in ``frame``.
        velocity_covariances : array_like, shape (n, 6, 6), optional
            Covariances of the velocities, in ``frame``.
        size_m : array_like, shape (3,)
            Size along the object's axes; 0 if unknown.
        """
        stamps = stamps_us(stamps_ns, "ObjectTrack stamps")
        data = types.ObjectTrackData(
            stamps,
            pack_poses(matrices, "ObjectTrack"),
            np.zeros((0, 6)) if velocities is None else np.asarray(velocities),
            pack_squares(covariances, len(stamps), 6, "ObjectTrack covariances"),
            pack_squares(velocity_covariances, len(stamps), 6, "ObjectTrack velocity covariances"),
        )
        newest = types.Time(int(stamps[-1])) if stamps.size else types.Time()
        metadata = types.ObjectTrackMetadata(
            time_stamp=newest,
            producer_id=producer,
            frame_id=frame,
            track_id=track_id,
            label=label,
            status=status,  # type: ignore[arg-type]  # its number is valid too
            score=score,
            size=np.asarray(size_m),
        )
        return types.ObjectTrack(metadata, data)

    @classmethod
    def from_bearing(
        cls,
        track_id: int,
        stamp_ns: int,
        *,
        frame: str,
        bearing: ArrayLike,
        position_m: ArrayLike,
        position_covariance: ArrayLike,
        velocity: ArrayLike,
        pixel: ArrayLike,
        pixel_sigma: ArrayLike,
        label: str = "",
        status: types.ObjectTrackStatusT | int = 1,
        score: float = 0.0,
        size_m: ArrayLike = (0.0, 0.0, 0.0),
        producer: str = "",
    ) -> types.ObjectTrack:
        """Return one state of an object of which the direction is known, and perhaps the range.

        Parameters
        ----------
        bearing : array_like, shape (6,)
            Azimuth and elevation in ``frame``, their standard deviations across and up, radians; range
            and its
            standard deviation, metres, NaN while it is not observable.
        position_m : array_like, shape (3,)
            NaN while the range is not observable.
        position_covariance : array_like, shape (3, 3)
            Square metres; NaN while the range is not observable.
        velocity : array_like, shape (3,)
            Angular velocity of the direction, radians per second.
        pixel, pixel_sigma : array_like, shape (2,)
            Column and row, NaN outside the image.
        """
        covariance = np.full((6, 6), np.nan)
        covariance[:3, :3] = position_covariance
        data = types.ObjectTrackData(
            stamps=stamps_us([stamp_ns], "ObjectTrack stamps"),
            poses=np.concatenate([np.asarray(position_m, dtype=float), [0.0, 0.0, 0.0, 1.0]])[None],
            velocities=np.concatenate([np.full(3, np.nan), np.asarray(velocity, dtype=float)])[None],
            covariances=covariance.reshape(1, 36),
            bearings=np.asarray(bearing, dtype=float).reshape(1, 6),
            pixels=np.asarray(pixel, dtype=float).reshape(1, 2),
            pixel_sigmas=np.asarray(pixel_sigma, dtype=float).reshape(1, 2),
        )
        metadata = types.ObjectTrackMetadata(
            time_stamp=types.Time(int(data.stamps[-1])),
            producer_id=producer,
            frame_id=frame,
            track_id=track_id,
            label=label,
            status=status,  # type: ignore[arg-type]  # its number is valid too
            score=score,
            size=np.asarray(size_m),
        )
        return types.ObjectTrack(metadata, data)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times ``(n,)``, nanoseconds."""
        return self.data.stamps * 1000

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_object (n, 4, 4)``."""
        return unpack_poses(self.data.poses, "ObjectTrack")

    @property
    def velocities(self) -> NDArray[np.float64] | None:
        """Velocities ``(n, 6)``, m/s and rad/s, in the frame; None if the track has none."""
        return self.data.velocities if len(self.data.velocities) else None

    @property
    def covariances(self) -> NDArray[np.float64] | None:
        """Covariances of the poses ``(n, 6, 6)``; None if the track has none."""
        return self.data.covariances.reshape(-1, 6, 6) if len(self.data.covariances) else None

    @property
    def velocity_covariances(self) -> NDArray[np.float64] | None:
        """Covariances of the velocities ``(n, 6, 6)``; None if the track has none."""
        data = self.data.velocity_covariances
        return data.reshape(-1, 6, 6) if len(data) else None
