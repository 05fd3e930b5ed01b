# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of landmark maps and key frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns, check_unique, pack_squares
from cdff_common.types.frame import Array3D
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.frame import FrameIntrinsicT
    from cdff_common.types.landmarks import (
        KeyFrame,
        KeyFrameData,
        KeyFrameMetadata,
        LandmarkMap,
        LandmarkMapData,
        LandmarkMapMetadata,
    )
    from cdff_common.types.pose import TransformWithCovariance


def _check_descriptors(where: str, descriptors: Array3D, rows: int) -> None:
    if descriptors.rows not in (0, rows):
        raise InputError(f"{where}.descriptors: {descriptors.rows} rows, expected {rows}, or none")


def _packed(descriptors: NDArray[Any] | None) -> Array3D:
    return Array3D() if descriptors is None else Array3D.from_array(np.asarray(descriptors))


def _unpacked(descriptors: Array3D) -> NDArray[Any] | None:
    return descriptors.array if descriptors.rows else None


class LandmarkMapDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        ids: NDArray[np.int64]
        positions: NDArray[np.float64]
        covariances: NDArray[np.float64]
        observations: NDArray[np.uint32]
        descriptors: Array3D

    def _check_together(self) -> None:
        """One position for each landmark, the rest as many or none, and each landmark once."""
        optional: dict[str, NDArray[Any]] = {"covariances": self.covariances, "observations": self.observations}
        check_columns("LandmarkMapData", len(self.ids), {"positions": self.positions}, optional)
        check_unique("LandmarkMapData.ids", self.ids)
        _check_descriptors("LandmarkMapData", self.descriptors, len(self.ids))


class LandmarkMapExt(Message):
    """Landmarks in one frame."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: LandmarkMapMetadata
        data: LandmarkMapData

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
    ) -> LandmarkMap:
        """Map of ``n`` landmarks.

        Parameters
        ----------
        positions_m : array_like, shape (n, 3)
            In ``frame``.
        covariances : array_like, shape (n, 3, 3), optional
            m2; NaN where unknown.
        observations : array_like of int, shape (n,), optional
            How often each was seen.
        descriptors : ndarray, shape (n, d), optional
            One row each; uint8 for binary ones, else float32.
        """
        from cdff_common.types.landmarks import LandmarkMap, LandmarkMapData, LandmarkMapMetadata

        numbers = np.asarray(ids, dtype=np.int64)
        data = LandmarkMapData(
            numbers,
            np.asarray(positions_m, dtype=np.float64).reshape(-1, 3),
            pack_squares(covariances, len(numbers), 3, "LandmarkMap covariances"),
            np.zeros(0, np.uint32) if observations is None else np.asarray(observations),
            _packed(descriptors),
        )
        metadata = LandmarkMapMetadata(
            producer_id=producer, frame_id=frame, time_stamp=Time.from_ns(stamp_ns), descriptor_type=descriptor_type
        )
        return LandmarkMap(metadata, data)

    @property
    def frame(self) -> str:
        """Frame of the positions."""
        return self.metadata.frame_id

    @property
    def stamp_ns(self) -> int:
        """Time of the newest observation, nanoseconds."""
        return self.metadata.time_stamp.ns

    @property
    def covariances(self) -> NDArray[np.float64] | None:
        """``(n, 3, 3)``; None where the map has none."""
        return self.data.covariances.reshape(-1, 3, 3) if len(self.data.covariances) else None

    @property
    def descriptors(self) -> NDArray[Any] | None:
        """``(n, d)``; None where the map has none."""
        return _unpacked(self.data.descriptors)

    def extent_m(self) -> Box | None:
        """Box around the finite positions."""
        return box_of_points(self.data.positions)


class KeyFrameDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        keypoints: NDArray[np.float32]
        scales: NDArray[np.float32]
        landmarks: NDArray[np.int64]
        descriptors: Array3D

    def _check_together(self) -> None:
        """Scales, landmarks and descriptors are none, or one for each key point."""
        optional: dict[str, NDArray[Any]] = {"scales": self.scales, "landmarks": self.landmarks}
        check_columns("KeyFrameData", len(self.keypoints), {}, optional)
        _check_descriptors("KeyFrameData", self.descriptors, len(self.keypoints))


class KeyFrameExt(Message):
    """What a map keeps of an image."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: KeyFrameMetadata
        pose: TransformWithCovariance
        intrinsic: FrameIntrinsicT
        data: KeyFrameData

    @classmethod
    def from_arrays(
        cls,
        number: int,
        pose: TransformWithCovariance,
        keypoints_px: ArrayLike,
        *,
        stamp_ns: int,
        intrinsic: FrameIntrinsicT | None = None,
        scales_px: ArrayLike | None = None,
        landmarks: ArrayLike | None = None,
        descriptors: NDArray[Any] | None = None,
        descriptor_type: str = "",
        sensor: str = "",
    ) -> KeyFrame:
        """Key frame of ``n`` key points ``(n, 2)`` at ``pose`` = T_map_camera; a landmark of -1 is none."""
        from cdff_common.types.frame import FrameIntrinsicT
        from cdff_common.types.landmarks import KeyFrame, KeyFrameData, KeyFrameMetadata

        data = KeyFrameData(
            np.asarray(keypoints_px, dtype=np.float32).reshape(-1, 2),
            np.zeros(0, np.float32) if scales_px is None else np.asarray(scales_px),
            np.zeros(0, np.int64) if landmarks is None else np.asarray(landmarks),
            _packed(descriptors),
        )
        metadata = KeyFrameMetadata(
            id=number, sensor_id=sensor, time_stamp=Time.from_ns(stamp_ns), descriptor_type=descriptor_type
        )
        return KeyFrame(metadata, pose, FrameIntrinsicT() if intrinsic is None else intrinsic, data)

    @property
    def stamp_ns(self) -> int:
        """Time of capture, nanoseconds."""
        return self.metadata.time_stamp.ns

    @property
    def descriptors(self) -> NDArray[Any] | None:
        """``(n, d)``; None where it has none."""
        return _unpacked(self.data.descriptors)

    def extent_m(self) -> Box | None:
        """The camera's position as a box without size."""
        return self.pose.extent_m()
