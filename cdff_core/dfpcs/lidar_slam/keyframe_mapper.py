# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map under construction: the current keyframe, its loop closures and the trajectory."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import LidarMap
from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
from cdff_core.dfpcs.lidar_slam.keyframe_map import Keyframe, KeyframeMap
from cdff_core.dfpcs.lidar_slam.loop_closure import LoopCloser
from cdff_core.keyframe_graph.loops import Loop
from cdff_core.keyframe_graph.trajectory import Trajectory

if TYPE_CHECKING:
    from cdff_common.interfaces.dfpc import Dfpc
    from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
    from cdff_core.dfpcs.lidar_slam.scan_tracker import TrackingResult

Float = NDArray[np.float64]


class KeyframeMapper:
    """Collects sweeps in keyframes and closes loops between them.

    Attributes
    ----------
    keyframes : KeyframeMap
    trajectory : Trajectory
    current : int or None
        Id of the keyframe under construction; None before the first sweep.
    T_keyframe_lidar : UncertainTransform
        Pose of the lidar relative to the current keyframe, with accumulated drift.
    path_length_m : float
        Path length since the first sweep.
    """

    def __init__(self, dfpc: Dfpc, config: LidarSlamConfig) -> None:
        self._config = config
        self.closer = LoopCloser(dfpc, config.loops)
        self._thin_keyframe, self._thin_map = dfpc.dfn("thin_keyframe"), dfpc.dfn("thin_map")
        self._optimiser = dfpc.dfn("optimise")
        self.clear()

    def clear(self) -> None:
        """Start with an empty map."""
        self.keyframes, self.trajectory = KeyframeMap(), Trajectory()
        self.closer.clear()
        self.current: int | None = None
        self.T_keyframe_lidar = UncertainTransform.identity()
        self.path_length_m = 0.0
        self._start_lengths_m: dict[int, float] = {}  # path length at the start of each keyframe of this run
        self._new_points: list[Float] = []  # in the current keyframe, not yet merged into its cloud

    @property
    def imported(self) -> set[int]:
        """Keyframes with a known pose that this run did not create."""
        return self.keyframes.linked - set(self._start_lengths_m)

    @property
    def T_map_lidar(self) -> UncertainTransform | None:
        """Pose of the lidar in the map; None without a connection with the root."""
        if self.current is None or self.current not in self.keyframes.linked:
            return None
        return self.keyframes.pose(self.current) @ self.T_keyframe_lidar

    @property
    def is_keyframe_complete(self) -> bool:
        """True if the lidar is farther from the current keyframe than ``keyframe_distance_m``."""
        distance_m = np.linalg.norm(self.T_keyframe_lidar.matrix[:3, 3])
        return float(distance_m) > self._config.keyframe_distance_m

    def add_sweep(self, stamp_ns: int, tracking: TrackingResult) -> int:
        """Add a sweep to the current keyframe, which the first sweep starts; return the keyframe's id."""
        if self.current is None:
            self.current = self.keyframes.start_component(stamp_ns, tracking.T_odom_lidar)
            self._start_lengths_m[self.current] = self.path_length_m
        else:
            self.T_keyframe_lidar = self.T_keyframe_lidar @ tracking.increment
            self.path_length_m += float(np.linalg.norm(tracking.increment.matrix[:3, 3]))
        if not tracking.is_lost:
            points_m = tracking.points_m
            is_near = np.einsum("ij,ij->i", points_m, points_m) < self._config.keyframe_range_m**2
            if np.any(is_near):
                thinned = self._thin_keyframe.process(PointCloudDownsamplingInputs(points=points_m[is_near]))
                self._new_points.append(se3.transform_points(self.T_keyframe_lidar.matrix, thinned.points))
        return self.current

    def append_pose(self, stamp_ns: int, tracking: TrackingResult) -> None:
        """Append the pose of the lidar to the trajectory."""
        assert self.current is not None  # a sweep has been added
        self.trajectory.append(stamp_ns, self.current, tracking.with_pose_covariance(self.T_keyframe_lidar))

    def complete_keyframe(self) -> bool:
        """Describe the current keyframe and close its loops; return whether a loop was found."""
        assert self.current is not None  # a sweep has been added
        self.update_cloud()
        return self.close_loops(self.current)

    def start_keyframe(self, stamp_ns: int) -> None:
        """Start the next keyframe at the pose of the lidar."""
        assert self.current is not None  # a sweep has been added
        self.current = self.keyframes.add_successor(self.current, stamp_ns, self.T_keyframe_lidar)
        self._start_lengths_m[self.current] = self.path_length_m
        self.T_keyframe_lidar = UncertainTransform.identity()

    def update_cloud(self, *, with_descriptor: bool = True) -> None:
        """Merge the collected points into the current keyframe and, by
        default, update its place descriptor.
        """
        assert self.current is not None  # a sweep has been added
        keyframe = self.keyframes.keyframes[self.current]
        keyframe = Keyframe(keyframe.stamp_ns, self._current_points(), keyframe.descriptor)
        self._new_points.clear()
        self.closer.evict(self.current)
        if with_descriptor:
            keyframe = self.closer.with_place_descriptor(keyframe)
        self.keyframes.keyframes[self.current] = keyframe

    def close_loops(self, key: int, *, excluded: Collection[int] | None = None, merge: bool = True) -> bool:
        """Add the verified loops of a keyframe and optimise; return whether a loop was found.

        Keyframes in ``excluded`` are not compared; by default these are the keyframes of the last metres.
        With ``merge``, the keyframe is replaced by an older one that is closer than ``merge_distance_m``.
        """
        if excluded is None:
            since_m = self.path_length_m - 2.0 * self._config.loops.search_radius_m
            excluded = {k for k, start_m in self._start_lengths_m.items() if start_m > since_m}
        loops = list(self.closer.close(self.keyframes, key, excluded))
        if not loops:
            return False
        for loop in loops:
            self.keyframes.add_loop(loop.old, loop.new, loop.T)
        if key in self.keyframes.linked:
            self.keyframes.optimise(self._optimiser)
        nearest = min(loops, key=lambda loop: loop.distance_m)
        is_accepted = any({nearest.old, nearest.new} == set(e[:2]) for e in self.keyframes.edges)
        is_near = nearest.distance_m < self._config.merge_distance_m
        if merge and is_accepted and is_near and key != self.keyframes.root:
            self._replace_by_older(key, nearest.old, nearest.T)
        return True

    def replace_loops(self, loops: Iterable[Loop]) -> None:
        """Replace the loops of the current keyframe and optimise."""
        assert self.current is not None  # a sweep has been added
        self.keyframes.remove_loops(self.current)
        for loop in loops:
            self.keyframes.add_loop(loop.old, loop.new, loop.T)
        self.keyframes.optimise(self._optimiser)

    def import_map(self, message: LidarMap) -> dict[int, int]:
        """Add a map; it stays a separate component until a loop closure connects it. Return the new ids."""
        new_ids = self.keyframes.add_message(message)
        for key in new_ids.values():
            self.keyframes.keyframes[key] = self.closer.with_place_descriptor(self.keyframes.keyframes[key])
        if self.keyframes.root in new_ids.values():
            self.keyframes.optimise(self._optimiser)
        return new_ids

    def connect(self, keys: Collection[int]) -> None:
        """Search for loops of imported keyframes until one connects them with the root."""
        for key in keys:
            self.close_loops(key, excluded=keys)
            if key in self.keyframes.linked:
                return

    def cloud(self, voxel_m: float) -> Float:
        """Return the thinned points (n, 3) of all linked keyframes in the map
        frame; n is 0 without points.
        """
        clouds = [
            se3.transform_points(
                self.keyframes.poses[key],
                self._current_points() if key == self.current else self.keyframes.keyframes[key].points_m,
            )
            for key in sorted(self.keyframes.linked)
        ]
        points = np.concatenate([np.zeros((0, 3)), *clouds])
        if not len(points):  # no sweep had a point within range
            return points
        edge_m = voxel_m if voxel_m > 0.0 else None
        inputs = PointCloudDownsamplingInputs(points=points, edge_m=edge_m)
        points_m: Float = self._thin_map.process(inputs).points
        return points_m

    def local_points(self, radius_m: float) -> Float:
        """Return the map points (n, 3) of other keyframes within a radius of the current one."""
        assert self.current is not None  # a sweep has been added
        position_m = self.keyframes.poses[self.current][:3, 3]
        return np.concatenate(
            [
                se3.transform_points(self.keyframes.poses[key], self.keyframes.keyframes[key].points_m)
                for key in self.keyframes.linked - {self.current}
                if self.keyframes.distance_m(key, position_m) < radius_m
            ]
        )

    def _replace_by_older(self, key: int, older: int, T_older_key: UncertainTransform) -> None:
        """Replace a keyframe by an older one in graph and trajectory."""
        self.keyframes.replace_by(key, older, T_older_key)
        self.closer.evict(key)
        self._start_lengths_m.pop(key, None)
        self.trajectory.move(key, older, T_older_key.matrix)
        if self.current == key:
            self.current, self.T_keyframe_lidar = older, T_older_key @ self.T_keyframe_lidar

    def _current_points(self) -> NDArray[np.float32]:
        """Return the cloud of the current keyframe with the points collected so far."""
        assert self.current is not None  # a sweep has been added
        points_m = self.keyframes.keyframes[self.current].points_m
        clouds = ([np.asarray(points_m, dtype=np.float64)] if len(points_m) else []) + self._new_points
        if not clouds:
            return points_m
        thinned = self._thin_keyframe.process(PointCloudDownsamplingInputs(points=np.concatenate(clouds)))
        return np.asarray(thinned.points, dtype=np.float32)
