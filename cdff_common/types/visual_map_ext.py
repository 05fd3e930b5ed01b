# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a visual map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types.message import Message


@dataclass(frozen=True, slots=True, eq=False)
class KeyframePoints:
    """Points that the camera of a keyframe measured.

    Attributes
    ----------
    positions_m : ndarray, shape (n, 3)
        In the frame of the camera, metres.
    depth_sigmas_m : ndarray, shape (n,)
        Standard deviations of the depths, metres.
    descriptors : ndarray of uint8, shape (n, d)
    """

    positions_m: NDArray[np.float64]
    depth_sigmas_m: NDArray[np.float64]
    descriptors: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.positions_m)


class VisualMapPointsExt(Message):
    """Consistency of the column lengths."""

    __slots__ = ()
    counts: NDArray[np.int64]
    positions: NDArray[np.float32]
    depth_sigmas: NDArray[np.float32]
    descriptors: types.Array3D

    def _check_consistency(self) -> None:
        """Check that the counts add up to the number of points, and the columns for equal lengths."""
        n = len(self.positions)
        if (self.counts < 0).any() or int(self.counts.sum()) != n:
            raise InputError(f"VisualMapPoints.counts: sum {self.counts.sum()}, expected the {n} points")
        if len(self.depth_sigmas) != n or self.descriptors.rows != n:
            raise InputError(
                f"VisualMapPoints: {len(self.depth_sigmas)} depth sigmas and {self.descriptors.rows} "
                f"descriptors for {n} points, expected equal numbers"
            )


class VisualMapExt(Message):
    """Keyframes with their points."""

    __slots__ = ()
    metadata: types.VisualMapMetadata
    graph: types.PoseGraph
    points: types.VisualMapPoints

    def _check_consistency(self) -> None:
        """Check for one count per vertex."""
        counts, vertices = len(self.points.counts), len(self.graph.vertices.ids)
        if counts != vertices:
            raise InputError(
                f"VisualMap.points: {counts} counts for {vertices} vertices, expected equal numbers"
            )

    @classmethod
    def from_parts(
        cls,
        graph: types.PoseGraph,
        keyframes: Sequence[KeyframePoints],
        *,
        sensor: str,
        stamp_ns: int,
        descriptor_type: str,
        producer: str = "",
    ) -> types.VisualMap:
        """Return the map of a graph of poses ``T_map_camera`` and the points of each vertex, in its order.

        Raises
        ------
        InputError
            If array lengths differ.
        """
        positions = [np.asarray(k.positions_m, np.float32).reshape(-1, 3) for k in keyframes]
        descriptors = [np.asarray(k.descriptors, np.uint8) for k in keyframes if len(k)]
        points = types.VisualMapPoints(
            np.array([len(p) for p in positions], np.int64),
            np.concatenate(positions) if positions else np.zeros((0, 3), np.float32),
            np.concatenate(
                [np.asarray(k.depth_sigmas_m, np.float32) for k in keyframes] or [np.zeros(0, np.float32)]
            ),
            types.Array3D.from_array(np.concatenate(descriptors)) if descriptors else types.Array3D(),
        )
        metadata = types.VisualMapMetadata(
            producer_id=producer,
            sensor_id=sensor,
            time_stamp=types.Time.from_ns(stamp_ns),
            descriptor_type=descriptor_type,
        )
        return types.VisualMap(metadata, graph, points)

    @property
    def frame(self) -> str:
        """Frame of the map."""
        return self.graph.frame

    @property
    def keyframes(self) -> list[KeyframePoints]:
        """Points of each vertex."""
        if not len(self.points.counts):
            return []
        ends = np.cumsum(self.points.counts)[:-1]
        n = len(self.points.positions)
        descriptors = self.points.descriptors.array if n else np.zeros((0, 0), np.uint8)
        return [
            KeyframePoints(positions.astype(np.float64), sigmas.astype(np.float64), rows)
            for positions, sigmas, rows in zip(
                np.split(self.points.positions, ends),
                np.split(self.points.depth_sigmas, ends),
                np.split(descriptors, ends),
                strict=True,
            )
        ]

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Return all points in the frame of the map, ``(n, 3)``, metres."""
        parts = [
            se3.transform_points(T, keyframe.positions_m)
            for T, keyframe in zip(self.graph.vertices.matrices, self.keyframes, strict=True)
        ]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    @property
    def stamp_ns(self) -> int:
        """Time of the newest keyframe, nanoseconds."""
        return self.metadata.time_stamp.ns
