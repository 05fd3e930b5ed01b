# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a lidar map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types.columns import pack_poses, unpack_poses
from cdff_common.types.message import Message


class LidarMapCloudsExt(Message):
    """Consistency of the column lengths."""

    __slots__ = ()
    counts: NDArray[np.int64]
    points: NDArray[np.float32]

    def _check_consistency(self) -> None:
        """Check that the counts add up to the number of points."""
        if (self.counts < 0).any() or int(self.counts.sum()) != len(self.points):
            raise InputError(
                f"LidarMapClouds.counts: sum {self.counts.sum()}, expected the {len(self.points)} points"
            )


class LidarMapPositionExt(Message):
    """Consistency of the column lengths."""

    __slots__ = ()
    vertices: NDArray[np.int64]
    poses: NDArray[np.float64]

    def _check_consistency(self) -> None:
        """Check for one vertex and one pose, or none."""
        if len(self.vertices) != len(self.poses) or len(self.vertices) > 1:
            raise InputError(
                f"LidarMapPosition: {len(self.vertices)} vertices, {len(self.poses)} poses, expected 0 or 1"
            )


class LidarMapExt(Message):
    """Keyframes with their clouds."""

    __slots__ = ()
    metadata: types.LidarMapMetadata
    graph: types.PoseGraph
    clouds: types.LidarMapClouds
    position: types.LidarMapPosition

    def _check_consistency(self) -> None:
        """Check that each vertex has one cloud, and that the graph contains the vertex of the position."""
        ids = self.graph.vertices.ids
        if len(self.clouds.counts) != len(ids):
            raise InputError(
                f"LidarMap.clouds: {len(self.clouds.counts)} for {len(ids)} vertices, expected equal numbers"
            )
        if np.setdiff1d(self.position.vertices, ids).size:
            raise InputError(f"LidarMap.position: vertex {self.position.vertices[0]} is not in the graph")

    @classmethod
    def from_parts(
        cls,
        graph: types.PoseGraph,
        clouds_m: Sequence[ArrayLike],
        *,
        sensor: str,
        stamp_ns: int,
        position: tuple[int, ArrayLike] | None = None,
        producer: str = "",
    ) -> types.LidarMap:
        """Return the map of a graph and one cloud per vertex.

        Parameters
        ----------
        graph : PoseGraph
        clouds_m : sequence of array_like, shapes (n, 3)
            Each in the frame of its vertex, metres, in the order of the vertices.
        sensor : str
            Frame of the lidar.
        stamp_ns : int
            Time of the newest sweep.
        position : tuple of int and array_like, shape (4, 4), optional
            Vertex and ``T_vertex_lidar`` of the last lidar pose.

        Raises
        ------
        InputError
            If array lengths differ, or a position refers to a missing vertex.
        """
        arrays = [np.asarray(c, dtype=np.float32).reshape(-1, 3) for c in clouds_m]
        points = np.concatenate(arrays) if arrays else np.zeros((0, 3), np.float32)
        clouds = types.LidarMapClouds(np.array([len(a) for a in arrays], dtype=np.int64), points)
        last_position = types.LidarMapPosition()
        if position is not None:
            pose = pack_poses(np.asarray(position[1])[None], "LidarMap position")
            last_position = types.LidarMapPosition(np.array([position[0]], dtype=np.int64), pose)
        metadata = types.LidarMapMetadata(
            producer_id=producer, sensor_id=sensor, time_stamp=types.Time.from_ns(stamp_ns)
        )
        return types.LidarMap(metadata, graph, clouds, last_position)

    @property
    def frame(self) -> str:
        """Frame of the map."""
        return self.graph.frame

    @property
    def clouds_m(self) -> list[NDArray[np.float32]]:
        """Return the cloud ``(n, 3)`` of each vertex, in its frame."""
        return (
            np.split(self.clouds.points, np.cumsum(self.clouds.counts)[:-1])
            if len(self.clouds.counts)
            else []
        )

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Return all clouds in the frame of the map, concatenated, ``(n, 3)``."""
        clouds = [
            se3.transform_points(T, cloud)
            for T, cloud in zip(self.graph.vertices.matrices, self.clouds_m, strict=True)
        ]
        return np.concatenate(clouds) if clouds else np.zeros((0, 3))

    @property
    def last_position(self) -> tuple[int, NDArray[np.float64]] | None:
        """Vertex and ``T_vertex_lidar`` (4, 4) of the last lidar pose; None if unknown."""
        if not len(self.position.vertices):
            return None
        return int(self.position.vertices[0]), unpack_poses(self.position.poses, "LidarMapPosition")[0]
