# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes of a lidar with their clouds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.types import LidarMap
from cdff_core.keyframe_graph.graph import Float, KeyframeGraph


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Points observed around one pose of the lidar, whose frame is the frame of the keyframe."""

    stamp_ns: int  # end of the first sweep
    points_m: NDArray[np.float32]  # (n, 3)
    descriptor: NDArray[np.float32] | None = None  # (d,) by LoopDetection; None until completed


class KeyframeMap(KeyframeGraph[Keyframe]):
    """Graph of keyframes with clouds."""

    @property
    def point_bytes(self) -> int:
        """Memory of the clouds, bytes."""
        return sum(keyframe.points_m.nbytes for keyframe in self.keyframes.values())

    def start_component(self, stamp_ns: int, T_map_keyframe: Float) -> int:
        """Add an empty keyframe without an edge and return its id; the first of all becomes the root."""
        return self.insert_component(_empty(stamp_ns), T_map_keyframe)

    def add_successor(self, previous: int, stamp_ns: int, T_previous_keyframe: UncertainTransform) -> int:
        """Add an empty keyframe with an odometry edge from the previous one and return its id."""
        return self.insert_successor(previous, _empty(stamp_ns), T_previous_keyframe)

    def to_message(
        self, *, frame: str, sensor: str, producer: str, position: tuple[int, Float] | None
    ) -> LidarMap:
        """Return the whole map; ``position`` is the last keyframe with ``T_keyframe_lidar``."""
        graph = self.to_graph(frame=frame, producer=producer)
        clouds = [self.keyframes[int(k)].points_m for k in graph.vertices.ids]
        newest_ns = max((keyframe.stamp_ns for keyframe in self.keyframes.values()), default=0)
        return LidarMap.from_parts(
            graph, clouds, sensor=sensor, stamp_ns=newest_ns, position=position, producer=producer
        )

    def add_message(self, message: LidarMap) -> dict[int, int]:
        """Add a map as a separate component; return the new id of each keyframe by its id in the message."""
        stamps_ns = message.graph.vertices.stamps_ns.tolist()
        keyframes = [
            Keyframe(stamp_ns, np.array(points_m))
            for stamp_ns, points_m in zip(stamps_ns, message.clouds_m, strict=True)
        ]
        return self.insert_graph(message.graph, keyframes)


def _empty(stamp_ns: int) -> Keyframe:
    return Keyframe(stamp_ns, np.zeros((0, 3), np.float32))
