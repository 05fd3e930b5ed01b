# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of landmark maps and keyframes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.types.columns import pack_squares
from cdff_common.types.message import Message


def _pack(descriptors: NDArray[Any] | None) -> types.Array3D:
    return types.Array3D() if descriptors is None else types.Array3D.from_array(np.asarray(descriptors))


def _unpack(descriptors: types.Array3D) -> NDArray[Any] | None:
    return descriptors.array if descriptors.rows else None


class LandmarkMapExt(Message):
    """Landmarks in one frame."""

    __slots__ = ()
    metadata: types.LandmarkMapMetadata
    data: types.LandmarkMapData

    @classmethod
    def from_arrays(
        cls,
        ids: ArrayLike,
        positions_m: ArrayLike,
        *,
        frame: str,
        stamp_ns: int,
        covariances: ArrayLike | None = None,
        observations: ArrayLike | None = None,
        descriptors: NDArray[Any] | None = None,
        descriptor_type: str = "",
        producer: str = "",
    ) -> types.LandmarkMap:
        """Return the map of ``n`` landmarks.

        Parameters
        ----------
        positions_m : array_like, shape (n, 3)
            Positions in ``frame``, metres.
        covariances : array_like, shape (n, 3, 3), optional
            m2; NaN where unknown.
        observations : array_like of int, shape (n,), optional
            Number of observations of each landmark.
        descriptors : ndarray, shape (n, d), optional
            One row per landmark; uint8 for binary descriptors, else float32.
        """
        numbers = np.asarray(ids, dtype=np.int64)
        data = types.LandmarkMapData(
            numbers,
            np.asarray(positions_m, dtype=np.float64).reshape(-1, 3),
            pack_squares(covariances, len(numbers), 3, "LandmarkMap covariances"),
            np.zeros(0, np.uint32) if observations is None else np.asarray(observations),
            _pack(descriptors),
        )
        metadata = types.LandmarkMapMetadata(
            producer_id=producer,
            frame_id=frame,
            time_stamp=types.Time.from_ns(stamp_ns),
            descriptor_type=descriptor_type,
        )
        return types.LandmarkMap(metadata, data)

    @property
    def covariances(self) -> NDArray[np.float64] | None:
        """Covariances ``(n, 3, 3)``, m2; None if the map has none."""
        return self.data.covariances.reshape(-1, 3, 3) if len(self.data.covariances) else None

    @property
    def descriptors(self) -> NDArray[Any] | None:
        """Descriptors ``(n, d)``; None if the map has none."""
        return _unpack(self.data.descriptors)


class KeyFrameExt(Message):
    """Keyframe of a visual map."""

    __slots__ = ()
    metadata: types.KeyFrameMetadata
    pose: types.TransformWithCovariance
    intrinsic: types.FrameIntrinsicT
    data: types.KeyFrameData

    @classmethod
    def from_arrays(
        cls,
        number: int,
        pose: types.TransformWithCovariance,
        keypoints_px: ArrayLike,
        *,
        stamp_ns: int,
        intrinsic: types.FrameIntrinsicT | None = None,
        scales_px: ArrayLike | None = None,
        landmarks: ArrayLike | None = None,
        descriptors: NDArray[Any] | None = None,
        descriptor_type: str = "",
        sensor: str = "",
    ) -> types.KeyFrame:
        """Return the keyframe of keypoints ``(n, 2)`` at ``pose`` = T_map_camera; landmark -1 means none."""
        data = types.KeyFrameData(
            np.asarray(keypoints_px, dtype=np.float32).reshape(-1, 2),
            np.zeros(0, np.float32) if scales_px is None else np.asarray(scales_px),
            np.zeros(0, np.int64) if landmarks is None else np.asarray(landmarks),
            _pack(descriptors),
        )
        metadata = types.KeyFrameMetadata(
            id=number,
            sensor_id=sensor,
            time_stamp=types.Time.from_ns(stamp_ns),
            descriptor_type=descriptor_type,
        )
        return types.KeyFrame(
            metadata, pose, types.FrameIntrinsicT() if intrinsic is None else intrinsic, data
        )

    @property
    def descriptors(self) -> NDArray[Any] | None:
        """Descriptors ``(n, d)``; None if the keyframe has none."""
        return _unpack(self.data.descriptors)
