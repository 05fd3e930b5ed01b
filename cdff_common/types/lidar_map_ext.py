# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a lidar map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types.columns import pack_poses, unpack_poses
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.lidar_map import LidarMap, LidarMapClouds, LidarMapMetadata, LidarMapPosition
    from cdff_common.types.pose_graph import PoseGraph


class LidarMapCloudsExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        counts: NDArray[np.int64]
        points: NDArray[np.float32]

    def _check_together(self) -> None:
        """The counts, none below 0, sum up to the points."""
        if (self.counts < 0).any() or int(self.counts.sum()) != len(self.points):
            raise InputError(f"LidarMapClouds.counts: sum {self.counts.sum()}, expected the {len(self.points)} points")


class LidarMapPositionExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        vertices: NDArray[np.int64]
        poses: NDArray[np.float64]

    def _check_together(self) -> None:
        """One vertex and one pose, or none of both."""
        if len(self.vertices) != len(self.poses) or len(self.vertices) > 1:
            raise InputError(
                f"LidarMapPosition: {len(self.vertices)} vertices, {len(self.poses)} poses, expected 0 or 1"
            )


class LidarMapExt(Message):
    """Key frames with their clouds."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: LidarMapMetadata
        graph: PoseGraph
        clouds: LidarMapClouds
        position: LidarMapPosition

    def _check_together(self) -> None:
        """One cloud for each vertex; the position is at one of them."""
        ids = self.graph.vertices.ids
        if len(self.clouds.counts) != len(ids):
            raise InputError(f"LidarMap.clouds: {len(self.clouds.counts)} for {len(ids)} vertices, expected as many")
        if np.setdiff1d(self.position.vertices, ids).size:
            raise InputError(f"LidarMap.position: vertex {self.position.vertices[0]} is not in the graph")

    @classmethod
    def from_parts(
        cls,
        graph: PoseGraph,
        clouds_m: Sequence[ArrayLike],
        *,
        sensor: str,
        stamp_ns: int,
        position: tuple[int, ArrayLike] | None = None,
        producer: str = "",
    ) -> LidarMap:
        """Map of a graph and one cloud for each vertex.

        Parameters
        ----------
        graph : PoseGraph
        clouds_m : sequence of array_like, shapes (n, 3)
            Each in the frame of its vertex, metres, in the order of the vertices.
        sensor : str
            Frame of the lidar.
        stamp_ns : int
            Of the newest sweep in it.
        position : tuple of int and array_like, shape (4, 4), optional
            A vertex and ``T_vertex_lidar``: where the lidar was last.

        Raises
        ------
        InputError
            On sizes that differ, or a position at a vertex that is not there.
        """
        from cdff_common.types.lidar_map import LidarMap, LidarMapClouds, LidarMapMetadata, LidarMapPosition

        arrays = [np.asarray(c, dtype=np.float32).reshape(-1, 3) for c in clouds_m]
        points = np.concatenate(arrays) if arrays else np.zeros((0, 3), np.float32)
        clouds = LidarMapClouds(np.array([len(a) for a in arrays], dtype=np.int64), points)
        where = LidarMapPosition()
        if position is not None:
            pose = pack_poses(np.asarray(position[1])[None], "LidarMap position")
            where = LidarMapPosition(np.array([position[0]], dtype=np.int64), pose)
        metadata = LidarMapMetadata(producer_id=producer, sensor_id=sensor, time_stamp=Time.from_ns(stamp_ns))
        return LidarMap(metadata, graph, clouds, where)

    @property
    def frame(self) -> str:
        """Frame of the map."""
        return self.graph.frame

    @property
    def stamp_ns(self) -> int:
        """Time of the newest sweep, nanoseconds."""
        return self.metadata.time_stamp.ns

    @property
    def clouds_m(self) -> list[NDArray[np.float32]]:
        """The cloud ``(n, 3)`` of each vertex, in its frame."""
        return np.split(self.clouds.points, np.cumsum(self.clouds.counts)[:-1]) if len(self.clouds.counts) else []

    @property
    def points_m(self) -> NDArray[np.float64]:
        """All clouds in the frame of the map, one after the other, ``(n, 3)``."""
        placed = [
            se3.transform_points(T, cloud) for T, cloud in zip(self.graph.vertices.matrices, self.clouds_m, strict=True)
        ]
        return np.concatenate(placed) if placed else np.zeros((0, 3))

    @property
    def last_position(self) -> tuple[int, NDArray[np.float64]] | None:
        """Vertex and ``T_vertex_lidar`` (4, 4) of where the lidar was last; None where it is unknown."""
        if not len(self.position.vertices):
            return None
        return int(self.position.vertices[0]), unpack_poses(self.position.poses, "LidarMapPosition")[0]

    def extent_m(self) -> Box | None:
        """Box around all points, in the frame of the map."""
        return box_of_points(self.points_m)
